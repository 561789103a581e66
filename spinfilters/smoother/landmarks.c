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

/* What one observation gives its pose, and its coupling L^-1 J_p' J_x, added to Y (3 rows of WIDE); out holds 1 / diagonal of L.
 * A row is read as one vector: its last two lanes, of the landmark, are computed and never used. */
static void one_observation(const double* rows, double weight, const double* L, const double out[3], wide* H, wide* g, wide Y[3]) {
  wide W[3] = {{0}, {0}, {0}}, h[POSE], slope = *g;
  for (int a = 0; a < POSE; ++a) h[a] = H[a];
  /* Row r: H += J_x' J_x (pose), W += J_p' J_x, gradient += J_x' rho. */
  for (int r = 0; r < R; ++r) {
    const double* J = rows + r * ROW;
    wide x = *(const unaligned_wide*)J, scaled = weight * x;
    for (int a = 0; a < POSE; ++a) h[a] += J[a] * scaled;
    for (int a = 0; a < 3; ++a) W[a] += J[POSE + a] * scaled;
    slope += J[ROW - 1] * scaled;
  }
  for (int a = 0; a < POSE; ++a) H[a] = h[a];
  *g = slope;
  /* Y += L^-1 W by forward substitution. */
  wide y0 = W[0] * out[0], y1 = (W[1] - L[3] * y0) * out[1];
  Y[0] += y0;
  Y[1] += y1;
  Y[2] += (W[2] - L[6] * y0 - L[7] * y1) * out[2];
}

/* S [6][8] -= left' right, left and right [3][8]. */
static void subtract_block(wide* S, const wide* left, const wide* right) {
  wide r0 = right[0], r1 = right[1], r2 = right[2];
  for (int a = 0; a < POSE; ++a) S[a] -= left[0][a] * r0 + left[1][a] * r1 + left[2][a] * r2;
}

/* Landmarks [L] with observations start[l] .. start[l + 1], sorted by epoch. Out: told [L], root [L][9], y [L][3], Y [N][18]
 * (zero for an observation that is not the first of its landmark in its epoch), S: pairs of epochs i >= j, block i (i + 1) / 2 +
 * j, [6][8]; gradient [epochs][6]. */
int eliminate_landmarks(integer landmarks, integer epochs, const integer* start, const integer* epoch, const double* rows,
                        const double* weight, double flattest, unsigned char* told, double* root, double* y, double* Y,
                        double* blocks, double* gradient) {
  integer most = 1;
  for (integer l = 0; l < landmarks; ++l)
    if (start[l + 1] - start[l] > most) most = start[l + 1] - start[l];
  void* raw = malloc((most * 3 + epochs) * sizeof(wide) + most * sizeof(integer) + 64);
  if (raw == 0) return 1;
  wide* couple = (wide*)(((size_t)raw + 63) & ~(size_t)63);
  wide* slope = couple + 3 * most;
  integer* seen = (integer*)(slope + epochs);
  wide* S = (wide*)blocks;
  memset(blocks, 0, epochs * (epochs + 1) / 2 * POSE * sizeof(wide));
  memset(slope, 0, epochs * sizeof(wide));
  for (integer l = 0; l < landmarks; ++l) {
    double *V = root + 9 * l, *v = y + 3 * l;
    memset(Y + start[l] * 18, 0, (start[l + 1] - start[l]) * 18 * sizeof(double));
    told[l] = landmark_root(start[l], start[l + 1], rows, weight, flattest, V, v);
    if (!told[l]) continue;
    const double out[3] = {1 / V[0], 1 / V[4], 1 / V[8]};
    integer count = 0;
    /* One Y per epoch that saw the landmark: observations of one epoch are adjacent and share it. */
    for (integer i = start[l]; i < start[l + 1]; ++i) {
      if (!(weight[i] > 0)) continue;
      int again = count && epoch[seen[count - 1]] == epoch[i];
      wide* mine = couple + 3 * (count - again);
      if (!again) {
        mine[0] = mine[1] = mine[2] = (wide){0};
        seen[count++] = i;
      }
      integer f = epoch[i];
      one_observation(rows + i * R * ROW, weight[i], V, out, S + (f * (f + 1) / 2 + f) * POSE, slope + f, mine);
    }
    /* Schur complement: S_ij -= Y_i' Y_j for j <= i, gradient_i -= Y_i' y. */
    for (integer i = 0; i < count; ++i) {
      integer f = epoch[seen[i]];
      const wide* left = couple + 3 * i;
      slope[f] -= v[0] * left[0] + v[1] * left[1] + v[2] * left[2];
      for (int a = 0; a < 3; ++a) memcpy(Y + seen[i] * 18 + a * POSE, left + a, POSE * sizeof(double));
      wide* line = S + f * (f + 1) / 2 * POSE;
      for (integer j = 0; j <= i; ++j) subtract_block(line + epoch[seen[j]] * POSE, left, couple + 3 * j);
    }
  }
  for (integer f = 0; f < epochs; ++f) memcpy(gradient + f * POSE, slope + f, POSE * sizeof(double));
  free(raw);
  return 0;
}

/* Blocks of pairs of epochs into the lower triangle of a matrix with rows of n. */
void spread_blocks(integer epochs, integer n, const double* blocks, double* M) {
  for (integer i = 0; i < epochs; ++i)
    for (integer j = 0; j <= i; ++j) {
      const double* block = blocks + (i * (i + 1) / 2 + j) * POSE * WIDE;
      for (int a = 0; a < POSE; ++a) memcpy(M + (i * POSE + a) * n + j * POSE, block + a * WIDE, POSE * sizeof(double));
    }
}

/* Back-substitution of a pose step to the landmarks: L^-T (y - sum Y e); zero where a landmark is not well constrained. */
void follow_poses(integer landmarks, const integer* start, const integer* epoch, const unsigned char* told, const double* root,
                  const double* y, const double* Y, const double* poses, double* step) {
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
