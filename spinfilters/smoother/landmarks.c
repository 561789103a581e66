/* Loops over landmarks and their observations; types and roots are those of `kernels.h`. */

/* Information V (lower root on return) and gradient of a landmark from its observations; 0 where it is not well
 * constrained. A row's columns of the landmark and its innovation are read as one vector. */
static int landmark_root(integer first, integer last, const double* rows, const double* weight, double flattest,
                         double V[9], double y[3]) {
  int hits = 0;
  four sum[3] = {{0}, {0}, {0}};
  /* sum[a] = row a of [J' J | J' rho], J (3 x 3) by the landmark, over all observations with a weight. */
  for (integer i = first; i < last; ++i) {
    if (!(weight[i] > 0)) continue;
    ++hits;
    for (int r = 0; r < R; ++r) {
      four J = *(const four*)(rows + (i * R + r) * ROW + POSE), scaled = weight[i] * J;
      for (int a = 0; a < 3; ++a) sum[a] += J[a] * scaled;
    }
  }
  /* gradient J' rho, and V = J' J as a lower triangle, whose root follows */
  for (int a = 0; a < 3; ++a) {
    y[a] = sum[a][3];
    for (int b = 0; b < 3; ++b) V[3 * a + b] = b > a ? 0 : sum[a][b];
  }
  /* Scaled determinant det V / prod V_aa: near 0 where the observations leave the depth open. */
  double scale = V[0] * V[4] * V[8];
  if (hits < 2 || !cholesky(V, 3)) return 0;
  double root = V[0] * V[4] * V[8];
  if (!(root * root > flattest * scale)) return 0;
  /* Forward substitution: L y = J' rho. */
  y[0] /= V[0];
  y[1] = (y[1] - V[3] * y[0]) / V[4];
  y[2] = (y[2] - V[6] * y[0] - V[7] * y[1]) / V[8];
  return 1;
}

/* What one observation gives: J_x' J_x to the block H of its pose, J_x' rho to the gradient g, and its coupling
 * L^-1 J_p' J_x to Y [3][6], added to what is there with `again`; out holds 1 / diagonal of L. Six columns are one vector of four and one of two. */
static inline void one_observation(const double* rows, double weight, const double* L, const double out[3], double* H, double* g,
                                   int again, double* Y) {
  four x4[R], s4 = *(const four*)g, w4[3] = {{0}, {0}, {0}};
  two x2[R], s2 = *(const two*)(g + 4), w2[3] = {{0}, {0}, {0}};
  /* weighted Jacobian by the pose, six columns as four and two */
  for (int r = 0; r < R; ++r) {
    const double* J = rows + r * ROW;
    x4[r] = weight * *(const four*)J;
    x2[r] = weight * *(const two*)(J + 4);
  }
  /* Row a of the pose's block: H += J_x' J_x. */
  for (int a = 0; a < POSE; ++a) {
    four h4 = *(const four*)(H + a * POSE);
    two h2 = *(const two*)(H + a * POSE + 4);
    for (int r = 0; r < R; ++r) {
      h4 += rows[r * ROW + a] * x4[r];
      h2 += rows[r * ROW + a] * x2[r];
    }
    *(four*)(H + a * POSE) = h4;
    *(two*)(H + a * POSE + 4) = h2;
  }
  /* W = J_p' J_x, gradient += J_x' rho. */
  for (int r = 0; r < R; ++r) {
    const double* J = rows + r * ROW;
    for (int a = 0; a < 3; ++a) {
      w4[a] += J[POSE + a] * x4[r];
      w2[a] += J[POSE + a] * x2[r];
    }
    s4 += J[ROW - 1] * x4[r];
    s2 += J[ROW - 1] * x2[r];
  }
  *(four*)g = s4;
  *(two*)(g + 4) = s2;
  /* Y += L^-1 W by forward substitution. */
  w4[0] *= out[0];
  w2[0] *= out[0];
  w4[1] = (w4[1] - L[3] * w4[0]) * out[1];
  w2[1] = (w2[1] - L[3] * w2[0]) * out[1];
  w4[2] = (w4[2] - L[6] * w4[0] - L[7] * w4[1]) * out[2];
  w2[2] = (w2[2] - L[6] * w2[0] - L[7] * w2[1]) * out[2];
  /* Y of an epoch that observes the landmark more than once is the sum over these observations */
  for (int a = 0; a < 3; ++a) {
    *(four*)(Y + a * POSE) = again ? *(four*)(Y + a * POSE) + w4[a] : w4[a];
    *(two*)(Y + a * POSE + 4) = again ? *(two*)(Y + a * POSE + 4) + w2[a] : w2[a];
  }
}

/* The first two numbers of four. */
static inline two half(four x) {
  two first;
  memcpy(&first, &x, sizeof first);
  return first;
}

/* S [6][6] in rows of n -= left' right, left and right [3][6]. */
static inline void subtract_block(double* restrict S, integer n, const double* restrict left, const double* restrict right) {
  const four r0 = *(const four*)right, r1 = *(const four*)(right + POSE), r2 = *(const four*)(right + 2 * POSE);
  const two q0 = *(const two*)(right + 4), q1 = *(const two*)(right + POSE + 4), q2 = *(const two*)(right + 2 * POSE + 4);
  /* Row a: a number of the left block times the columns 0 .. 4, and half of the same vector times the columns 4 .. 6. */
  for (int a = 0; a < POSE; ++a, S += n) {
    const four l0 = left[a] - (four){0}, l1 = left[POSE + a] - (four){0}, l2 = left[2 * POSE + a] - (four){0};
    *(four*)S = *(const four*)S - l0 * r0 - l1 * r1 - l2 * r2;
    *(two*)(S + 4) = *(const two*)(S + 4) - half(l0) * q0 - half(l1) * q1 - half(l2) * q2;
  }
}

enum { TOGETHER = 8 }; /* epochs whose rows of M stay in the second cache, while the Y of their landmarks pass by once */

/* What is known of the observations that count, in the order in which their poses are coupled: by groups of TOGETHER epochs, and
 * in a group by landmark. begin, end [groups]: where a group begins and ends; number, first: an observation, and its landmark's
 * first one. */
typedef struct {
  integer groups, *begin, *end;
  int *number, *first;
} Order;

/* Schur complement of the landmarks, M_ij -= Y_i' Y_j for epochs j <= i; column[i]: first column of an observation's epoch. Y of
 * a landmark's earlier observations are adjacent and taken in one run; those of the next run are fetched meanwhile. */
static void couple_poses(const Order* order, integer n, const int* column, const double* Y, double* M) {
  /* observation i: block row of its epoch, by the columns of the same landmark's observations j <= i */
  for (integer g = 0; g < order->groups; ++g)
    for (integer e = order->begin[g]; e < order->end[g]; ++e) {
      const integer i = order->number[e];
      double* S = M + column[i] * n;
      if (e + 1 < order->end[g]) {
        const double *next = Y + (integer)order->first[e + 1] * 3 * POSE, *end = Y + ((integer)order->number[e + 1] + 1) * 3 * POSE;
        for (; next < end; next += 8) __builtin_prefetch(next);
      }
      for (integer j = order->first[e]; j <= i; ++j) subtract_block(S + column[j], n, Y + i * 3 * POSE, Y + j * 3 * POSE);
    }
}

/* Landmarks [L] with observations start[l] .. start[l + 1], sorted by epoch. Out: told [L], root [L][9], y [L][3], Y [N][18]
 * (zero for an observation that is not the first of its landmark in its epoch), M (zero before): lower triangle over poses, six
 * rows of n an epoch; gradient [epochs][6]; whether each observation counts, used [N]; the fall of the cost by landmarks alone. */
int eliminate_landmarks(integer landmarks, integer epochs, integer n, const integer* start, const integer* epoch,
                        const double* rows, const double* weight, double flattest, unsigned char* told, double* root, double* y,
                        double* Y, double* M, double* gradient, unsigned char* used, double* fall) {
  const integer count = start[landmarks], groups = (epochs + TOGETHER - 1) / TOGETHER;
  char* room = (char*)calloc(epochs * POSE * POSE * sizeof(double) + (2 * groups + 1) * sizeof(integer) + 3 * count * sizeof(int), 1);
  if (room == 0) return 1;
  double* H = (double*)room;
  integer *begin = (integer*)(H + epochs * POSE * POSE), *end = begin + groups + 1;
  int *number = (int*)(end + groups), *first = number + count, *column = first + count;
  /* begin[g + 1]: observations of group g, then of all groups up to it: room for every one; end[g] is where its next one goes. */
  for (integer i = 0; i < count; ++i) {
    ++begin[epoch[i] / TOGETHER + 1];
    column[i] = (int)epoch[i] * POSE;
  }
  /* running sum: begin[g] is where group g begins */
  for (integer g = 0; g < groups; ++g) {
    begin[g + 1] += begin[g];
    end[g] = begin[g];
  }
  memset(gradient, 0, epochs * POSE * sizeof(double));
  *fall = 0;
  /* landmark by landmark: its root, then the information of its poses, their coupling through it, and their gradients */
  for (integer l = 0; l < landmarks; ++l) {
    double *V = root + 9 * l, *v = y + 3 * l;
    told[l] = landmark_root(start[l], start[l + 1], rows, weight, flattest, V, v);
    for (integer i = start[l]; i < start[l + 1]; ++i) used[i] = told[l] && weight[i] > 0;
    if (!told[l]) {
      memset(Y + start[l] * 3 * POSE, 0, (start[l + 1] - start[l]) * 3 * POSE * sizeof(double));
      continue;
    }
    *fall += v[0] * v[0] + v[1] * v[1] + v[2] * v[2];
    const double out[3] = {1 / V[0], 1 / V[4], 1 / V[8]};
    integer seen = -1;
    /* One Y per epoch that saw the landmark: observations of one epoch are adjacent and share that of the first. */
    for (integer i = start[l]; i < start[l + 1]; ++i) {
      const integer f = epoch[i];
      const int counts = weight[i] > 0, again = seen >= 0 && epoch[seen] == f;
      if (!counts || again) memset(Y + i * 3 * POSE, 0, 3 * POSE * sizeof(double));
      if (!counts) continue;
      if (!again) {
        integer* place = end + f / TOGETHER;
        number[*place] = (int)i;
        first[(*place)++] = (int)start[l];
        seen = i;
      }
      one_observation(rows + i * R * ROW, weight[i], V, out, H + f * POSE * POSE, gradient + f * POSE, again, Y + seen * 3 * POSE);
    }
    /* gradient_i -= Y_i' y. */
    for (integer i = start[l]; i < start[l + 1]; ++i)
      for (int a = 0; a < POSE; ++a) {
        const double* x = Y + i * 3 * POSE + a;
        gradient[column[i] + a] -= v[0] * x[0] + v[1] * x[POSE] + v[2] * x[2 * POSE];
      }
  }
  /* Diagonal blocks of M: J_x' J_x of each pose. */
  for (integer f = 0; f < epochs; ++f)
    for (int a = 0; a < POSE; ++a) memcpy(M + (f * POSE + a) * n + f * POSE, H + (f * POSE + a) * POSE, POSE * sizeof(double));
  const Order order = {groups, begin, end, number, first};
  couple_poses(&order, n, column, Y, M);
  free(room);
  return 0;
}

/* Back-substitution of a pose step to the landmarks: L^-T (y - sum Y e); zero where a landmark is not well constrained. */
void follow_poses(integer landmarks, const integer* start, const integer* epoch, const unsigned char* told, const double* root,
                  const double* y, const double* Y, const double* poses, double* step) {
  /* landmark l: z = y - sum of Y e over its observations, then its step L^-T z */
  for (integer l = 0; l < landmarks; ++l) {
    double z[3] = {y[3 * l], y[3 * l + 1], y[3 * l + 2]};
    const double* L = root + 9 * l;
    double* out = step + 3 * l;
    out[0] = out[1] = out[2] = 0;
    if (!told[l]) continue;
    four left[3] = {{0}, {0}, {0}};
    two right[3] = {{0}, {0}, {0}};
    /* Y e in two parts, columns 0 .. 4 and 4 .. 6 of the pose. */
    for (integer i = start[l]; i < start[l + 1]; ++i) {
      const double *row = Y + 3 * POSE * i, *e = poses + POSE * epoch[i];
      four e0 = *(const four*)e;
      two e4 = *(const two*)(e + 4);
      for (int a = 0; a < 3; ++a) {
        left[a] += *(const four*)(row + POSE * a) * e0;
        right[a] += *(const two*)(row + POSE * a + 4) * e4;
      }
    }
    for (int a = 0; a < 3; ++a)
      z[a] -= (left[a][0] + left[a][1]) + (left[a][2] + left[a][3]) + (right[a][0] + right[a][1]);
    /* Back substitution by L'. */
    out[2] = z[2] / L[8];
    out[1] = (z[1] - L[7] * out[2]) / L[4];
    out[0] = (z[0] - L[3] * out[1] - L[6] * out[2]) / L[0];
  }
}
