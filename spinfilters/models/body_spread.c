/* `body_spread` and `widest_departures` of `body_spread.py`, which says what they are, of one body after another: its points side by
 * side in the lanes of vectors. LANES, STEPS, SEARCHES and the numbers of `body_spread.py` are defined in front of this text. */
#include <float.h>
#include <math.h>
#include <string.h>

typedef long long integer;
enum { ALIGNMENT = 8 * LANES, SWEEPS = 12, ROUND = 4, AXES = 10, MOST = 64 };
typedef double lane __attribute__((vector_size(ALIGNMENT), may_alias));
typedef integer mask __attribute__((vector_size(ALIGNMENT), may_alias));
static const double NEGLIGIBLE = 1e-18; /* of the diagonal: what lies beside it is rounding of rounding */
/* Moments (ascending) of the log ratios y: numerator and denominator. Axes that a turn about each axis takes into each other. */
static const int UPPER[3] = {0, 1, 0}, LOWER[3] = {2, 2, 1}, AFTER[3] = {1, 2, 0}, LAST[3] = {2, 0, 1};

static inline lane chosen(mask is, lane yes, lane no) { return (lane)(((mask)yes & is) | ((mask)no & ~is)); }
static inline lane sizes(lane x) { return chosen(x < 0, -x, x); }
static inline int any(mask is) {
  integer found = 0;
  for (int l = 0; l < LANES; ++l) found |= is[l];
  return found != 0;
}
#define OF_LANES(NAME, FUNCTION)                               \
  static inline lane NAME(lane x) {                            \
    lane y;                                                    \
    for (int l = 0; l < LANES; ++l) y[l] = FUNCTION(x[l]);     \
    return y;                                                  \
  }
OF_LANES(roots, sqrt)
OF_LANES(exponentials, exp)
OF_LANES(logarithms, log)

/* Jacobi's rotation that makes A[p][q] zero, in A and in the columns of V. */
static inline void rotate(lane A[3][3], lane V[3][3], int p, int q) {
  const int r = 3 - p - q;
  const lane gap = A[q][q] - A[p][p], twice = 2 * A[p][q];
  const lane below = sizes(gap) + roots(gap * gap + twice * twice), ratio = twice / chosen(below == 0, (lane){0} + 1, below);
  const lane t = chosen(gap < 0, -ratio, ratio), c = 1 / roots(1 + t * t), s = t * c;
  const lane arp = A[r][p], arq = A[r][q];
  A[p][p] -= t * A[p][q];
  A[q][q] += t * A[p][q];
  A[p][q] = A[q][p] = (lane){0};
  A[r][p] = A[p][r] = c * arp - s * arq;
  A[r][q] = A[q][r] = s * arp + c * arq;
  for (int i = 0; i < 3; ++i) {
    const lane vp = V[i][p], vq = V[i][q];
    V[i][p] = c * vp - s * vq;
    V[i][q] = s * vp + c * vq;
  }
}

/* Puts eigenvalues p < q into ascending order, with their columns of V. */
static inline void sort(lane values[3], lane V[3][3], int p, int q) {
  const mask wrong = values[q] < values[p];
  const lane low = chosen(wrong, values[q], values[p]);
  values[q] = chosen(wrong, values[p], values[q]);
  values[p] = low;
  for (int i = 0; i < 3; ++i) {
    const lane first = chosen(wrong, V[i][q], V[i][p]);
    V[i][q] = chosen(wrong, V[i][p], V[i][q]);
    V[i][p] = first;
  }
}

/* Eigenvalues of symmetric A, ascending, and eigenvectors as columns of V; A is overwritten. */
static void eigen(lane A[3][3], lane values[3], lane V[3][3]) {
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) V[i][j] = (lane){0} + (i == j);
  for (int sweep = 0; sweep < SWEEPS; ++sweep) {
    const lane beside = sizes(A[0][1]) + sizes(A[0][2]) + sizes(A[1][2]);
    if (!any(beside > NEGLIGIBLE * (sizes(A[0][0]) + sizes(A[1][1]) + sizes(A[2][2])))) break;
    rotate(A, V, 0, 1);
    rotate(A, V, 0, 2);
    rotate(A, V, 1, 2);
  }
  for (int i = 0; i < 3; ++i) values[i] = A[i][i];
  sort(values, V, 0, 1);
  sort(values, V, 1, 2);
  sort(values, V, 0, 1);
}

/* A body: factor L of its second moments, steps F of its errors [error][u], and axes as columns, all row by row. */
typedef struct {
  const double *L, *steps, *axes;
} Body;

/* At the errors F u of the points u: l and V of D, B = L V, and S = B exp(diag l) B'. */
static void second_moments(const Body* body, const lane u[5], lane values[3], lane V[3][3], lane B[3][3], lane S[3][3]) {
  lane d[5], D[3][3], scaled[3][3];
  for (int i = 0; i < 5; ++i) {
    d[i] = (lane){0};
    for (int k = 0; k < 5; ++k) d[i] += body->steps[5 * i + k] * u[k];
  }
  D[0][0] = d[0];
  D[1][1] = d[1];
  D[2][2] = -d[0] - d[1];
  D[0][1] = D[1][0] = d[2];
  D[0][2] = D[2][0] = d[3];
  D[1][2] = D[2][1] = d[4];
  eigen(D, values, V);
  for (int k = 0; k < 3; ++k) {
    const lane half = exponentials(values[k] / 2);
    for (int i = 0; i < 3; ++i) {
      B[i][k] = (lane){0};
      for (int j = 0; j <= i; ++j) B[i][k] += body->L[3 * i + j] * V[j][k];
      scaled[i][k] = B[i][k] * half;
    }
  }
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j <= i; ++j)
      S[i][j] = S[j][i] = scaled[i][0] * scaled[j][0] + scaled[i][1] * scaled[j][1] + scaled[i][2] * scaled[j][2];
}

/* Second moments and axes of S, by ascending moments of inertia. */
static void principal(lane S[3][3], lane p[3], lane vectors[3][3]) {
  lane ascending[3], V[3][3];
  eigen(S, ascending, V);
  const lane floor = DBL_EPSILON * ascending[2];
  for (int k = 0; k < 3; ++k) {
    p[k] = chosen(ascending[2 - k] < floor, floor, ascending[2 - k]);
    for (int i = 0; i < 3; ++i) vectors[i][k] = V[i][2 - k];
  }
}

/* The rotation vector of the short way round of R: the column of 4 q q' whose diagonal element is largest, normalised. */
static void rotation_vector(const double R[3][3], double out[3]) {
  const double x = R[2][1] - R[1][2], y = R[0][2] - R[2][0], z = R[1][0] - R[0][1];
  const double xy = R[0][1] + R[1][0], yz = R[1][2] + R[2][1], zx = R[2][0] + R[0][2];
  const double r0 = R[0][0], r1 = R[1][1], r2 = R[2][2];
  const double columns[4][4] = {{1 + r0 - r1 - r2, xy, zx, x},
                                {xy, 1 - r0 + r1 - r2, yz, y},
                                {zx, yz, 1 - r0 - r1 + r2, z},
                                {x, y, z, 1 + r0 + r1 + r2}};
  int largest = 0;
  for (int k = 1; k < 4; ++k)
    if (columns[k][k] > columns[largest][largest]) largest = k;
  const double* q = columns[largest];
  const double norm = sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
  const double sine = sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2]) / norm, scalar = fabs(q[3]) / norm;
  /* angle / sin(angle / 2): 2 where the angle vanishes to rounding */
  const double share = (q[3] < 0 ? -1 : 1) / norm * (sine < 1e-9 ? 2 : 2 * atan2(sine, scalar) / sine);
  for (int k = 0; k < 3; ++k) out[k] = share * q[k];
}

/* Components of the columns of V along the axes. */
static void along_axes(const Body* body, lane V[3][3], lane R[3][3]) {
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j)
      R[i][j] = body->axes[i] * V[0][j] + body->axes[3 + i] * V[1][j] + body->axes[6 + i] * V[2][j];
}

/* The shortest rotation vectors from the axes to eigenvectors of whatever signs. */
static void axis_turns(const Body* body, lane V[3][3], lane turns[3]) {
  static const double SIGNS_OF[4][3] = {{1, 1, 1}, {1, -1, -1}, {-1, 1, -1}, {-1, -1, 1}};
  lane R[3][3];
  along_axes(body, V, R);
  for (int l = 0; l < LANES; ++l) {
    double own[3][3], turn[3];
    const double det = V[0][0][l] * (V[1][1][l] * V[2][2][l] - V[1][2][l] * V[2][1][l]) -
                       V[0][1][l] * (V[1][0][l] * V[2][2][l] - V[1][2][l] * V[2][0][l]) +
                       V[0][2][l] * (V[1][0][l] * V[2][1][l] - V[1][1][l] * V[2][0][l]);
    const double side = det < 0 ? -1 : 1;
    /* right-handed signs of the largest trace */
    int best = 0;
    double trace = 0;
    for (int k = 0; k < 4; ++k) {
      const double other = side * (SIGNS_OF[k][0] * R[0][0][l] + SIGNS_OF[k][1] * R[1][1][l] + SIGNS_OF[k][2] * R[2][2][l]);
      if (k == 0 || other > trace) {
        best = k;
        trace = other;
      }
    }
    for (int i = 0; i < 3; ++i)
      for (int j = 0; j < 3; ++j) own[i][j] = side * SIGNS_OF[best][j] * R[i][j][l];
    rotation_vector((const double(*)[3])own, turn);
    for (int k = 0; k < 3; ++k) turns[k][l] = turn[k];
  }
}

/* Log ratios of the moments of inertia of second moments p. */
static void log_ratios(const lane p[3], lane y[3]) {
  lane logs[3];
  for (int k = 0; k < 3; ++k) logs[k] = logarithms(p[0] + p[1] + p[2] - p[k]);
  for (int k = 0; k < 3; ++k) y[k] = logs[UPPER[k]] - logs[LOWER[k]];
}

/* y at points. */
static void values_at(const Body* body, const lane u[5], lane y[6]) {
  lane values[3], V[3][3], B[3][3], S[3][3], p[3], vectors[3][3];
  second_moments(body, u, values, V, B, S);
  principal(S, p, vectors);
  log_ratios(p, y);
  axis_turns(body, vectors, y + 3);
}

/* Of each lane's y `sought`, times its sign: the value at a point, and the direction of its steepest ascent by u. */
static lane ascent(const Body* body, const lane u[5], const int* sought, const double* sign, lane slope[5]) {
  lane l[3], V[3][3], B[3][3], S[3][3], p[3], vectors[3][3], R[3][3], w[3][3], phi[3][3], y[6], slopes[6][5];
  second_moments(body, u, l, V, B, S);
  principal(S, p, vectors);
  along_axes(body, vectors, R);
  for (int k = 0; k < 3; ++k) {
    /* signs that are nearest to the axes */
    const mask turned = R[k][k] < 0;
    for (int i = 0; i < 3; ++i) {
      vectors[i][k] = chosen(turned, -vectors[i][k], vectors[i][k]);
      R[i][k] = chosen(turned, -R[i][k], R[i][k]);
    }
  }
  log_ratios(p, y);
  for (int k = 0; k < 3; ++k)
    for (int n = 0; n < LANES; ++n) y[3 + k][n] = atan2(R[LAST[k]][AFTER[k]][n], R[AFTER[k]][AFTER[k]][n]);
  /* w_k = B' a_k; Phi of the eigenvalues of D */
  for (int k = 0; k < 3; ++k)
    for (int j = 0; j < 3; ++j) w[k][j] = vectors[0][k] * B[0][j] + vectors[1][k] * B[1][j] + vectors[2][k] * B[2][j];
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j <= i; ++j) {
      const lane half = (l[i] - l[j]) / 2;
      lane quotient;
      for (int n = 0; n < LANES; ++n) quotient[n] = half[n] == 0 ? 1 : sinh(half[n]) / half[n];
      phi[i][j] = phi[j][i] = quotient * exponentials(half + l[j]);
    }
  for (int k = 0; k < 6; ++k) {
    const lane *one = w[k < 3 ? k : LAST[k - 3]], *other = w[k < 3 ? k : AFTER[k - 3]];
    lane product[3][3], G[3][3], by[5];
    /* G = V (Phi o one other') V', then its derivative by the five components of D, then by u */
    for (int i = 0; i < 3; ++i)
      for (int j = 0; j < 3; ++j) {
        product[i][j] = (lane){0};
        for (int m = 0; m < 3; ++m) product[i][j] += V[i][m] * phi[m][j] * one[m] * other[j];
      }
    for (int i = 0; i < 3; ++i)
      for (int j = 0; j < 3; ++j)
        G[i][j] = product[i][0] * V[j][0] + product[i][1] * V[j][1] + product[i][2] * V[j][2];
    by[0] = G[0][0] - G[2][2];
    by[1] = G[1][1] - G[2][2];
    by[2] = G[1][0] + G[0][1];
    by[3] = G[2][0] + G[0][2];
    by[4] = G[2][1] + G[1][2];
    for (int j = 0; j < 5; ++j) {
      slopes[k][j] = (lane){0};
      for (int i = 0; i < 5; ++i) slopes[k][j] += by[i] * body->steps[5 * i + j];
    }
  }
  lane value = {0}, square = {0};
  for (int j = 0; j < 5; ++j) {
    const lane sum = slopes[0][j] + slopes[1][j] + slopes[2][j];
    lane relative[3];
    for (int k = 0; k < 3; ++k) relative[k] = (sum - slopes[k][j]) / (p[0] + p[1] + p[2] - p[k]);
    for (int n = 0; n < LANES; ++n) {
      const int k = sought[n];
      if (k < 3) {
        slope[j][n] = sign[n] * (relative[UPPER[k]][n] - relative[LOWER[k]][n]);
      } else {
        const double gap = p[AFTER[k - 3]][n] - p[LAST[k - 3]][n], floor = SMALLEST_GAP * p[0][n];
        slope[j][n] = sign[n] * slopes[k][j][n] / (fabs(gap) < floor ? floor : gap);
      }
      value[n] = sign[n] * y[k][n];
    }
    square += slope[j] * slope[j];
  }
  const lane length = roots(square);
  for (int j = 0; j < 5; ++j) slope[j] /= chosen(length > 0, length, (lane){0} + 1);
  return value;
}

/* The points on the sphere of radius REACH where searches end that begin at u [LANES]. */
static void search(const Body* body, lane u[5], const int* sought, const double* sign) {
  lane slope[5], share = (lane){0} + 1, value = ascent(body, u, sought, sign, slope);
  for (int step = 0; step < STEPS; ++step) {
    lane moved[5], steeper[5], square = {0};
    for (int j = 0; j < 5; ++j) {
      moved[j] = u[j] + share * REACH * slope[j];
      square += moved[j] * moved[j];
    }
    const lane length = roots(square), scale = REACH / chosen(length > DBL_MIN, length, (lane){0} + DBL_MIN);
    for (int j = 0; j < 5; ++j) moved[j] *= scale;
    const lane reached = ascent(body, moved, sought, sign, steeper);
    const mask better = reached > value;
    for (int j = 0; j < 5; ++j) {
      u[j] = chosen(better, moved[j], u[j]);
      slope[j] = chosen(better, steeper[j], slope[j]);
    }
    value = chosen(better, reached, value);
    share = chosen(better, share, share / 3);
  }
}

/* y of `count` points; lanes without a point repeat the last. */
static void values_of(const Body* body, const double (*u)[5], int count, double (*y)[6]) {
  for (int first = 0; first < count; first += LANES) {
    lane at[5], found[6];
    for (int l = 0; l < LANES; ++l)
      for (int j = 0; j < 5; ++j) at[j][l] = u[first + l < count ? first + l : count - 1][j];
    values_at(body, at, found);
    for (int l = 0; l < LANES && first + l < count; ++l)
      for (int k = 0; k < 6; ++k) y[first + l][k] = found[k][l];
  }
}

/* The sphere and the discs in deviations, at the errors D that lead to them; at the mean where they are out of reach. */
static void round_bodies(const double* steps, const double* errors, double sphere_reach, double (*u)[5]) {
  for (int k = 0; k < ROUND; ++k) {
    double length = 0;
    for (int j = 0; j < 5; ++j) {
      double square = 0, along = 0;
      for (int i = 0; i < 5; ++i) {
        square += steps[5 * i + j] * steps[5 * i + j];
        along += errors[5 * k + i] * steps[5 * i + j]; /* columns are orthogonal */
      }
      u[k][j] = square > 0 ? along / square : INFINITY;
      length += u[k][j] * u[k][j];
    }
    if (!(sqrt(length) <= (k ? REACH : sphere_reach))) memset(u[k], 0, sizeof(u[k]));
  }
}

static inline double larger(double largest, double other) { return largest != largest || other <= largest ? largest : other; }

/* Departures of `bodies` bodies, L [3][3], F [5][5] and axes [3][3], with the errors [4][5] that make them round: of each the moments
 * of the first two [2], of log ratios [2] and of axes [3]. `fractions` [3] of the points found are looked at. */
void widest_departures(integer bodies, const double* L, const double* steps, const double* axes, const double* errors,
                       double sphere_reach, const double* fractions, double* departures) {
  for (integer n = 0; n < bodies; ++n, L += 9, steps += 25, axes += 9, errors += 20, departures += 7) {
    const Body body = {L, steps, axes};
    double begin[AXES][5] = {{0}}, y[MOST][6], u[MOST][5], found[SEARCHES + LANES][5];
    /* +-REACH along each direction: searches begin from the one that lies farthest out */
    for (int k = 0; k < AXES; ++k) begin[k][k % 5] = k < 5 ? REACH : -REACH;
    values_of(&body, begin, AXES, y);
    for (int first = 0; first < SEARCHES; first += LANES) {
      lane at[5];
      int sought[LANES];
      double sign[LANES];
      for (int l = 0; l < LANES; ++l) {
        /* the largest of each y, then the smallest */
        const int which = first + l < SEARCHES ? first + l : SEARCHES - 1;
        int farthest = 0;
        sought[l] = which % 6;
        sign[l] = which < 6 ? 1 : -1;
        for (int k = 1; k < AXES; ++k)
          if (sign[l] * y[k][sought[l]] > sign[l] * y[farthest][sought[l]]) farthest = k;
        for (int j = 0; j < 5; ++j) at[j][l] = begin[farthest][j];
      }
      search(&body, at, sought, sign);
      for (int l = 0; l < LANES; ++l)
        for (int j = 0; j < 5; ++j) found[first + l][j] = at[j][l];
    }
    /* round bodies, parts of the ways to where searches ended, and the mean */
    int count = ROUND;
    round_bodies(steps, errors, sphere_reach, u);
    for (int f = 0; f < 3; ++f)
      for (int k = 0; k < SEARCHES; ++k, ++count)
        for (int j = 0; j < 5; ++j) u[count][j] = fractions[f] * found[k][j];
    memset(u[count++], 0, sizeof(u[0]));
    values_of(&body, (const double(*)[5])u, count, y);
    const double* mean = y[count - 1];
    double largest[7] = {0};
    for (int k = 0; k < count; ++k) {
      double square = 0;
      for (int j = 0; j < 5; ++j) square += u[k][j] * u[k][j];
      const double distance = sqrt(square);
      double share = distance >= NEAREST ? 1 / distance : 0;
      if (k == 0) share *= sphere_reach / REACH;
      for (int c = 0; c < 2; ++c) {
        largest[c] = larger(largest[c], fabs(exp(y[k][c]) - exp(mean[c])) * share);
        largest[2 + c] = larger(largest[2 + c], fabs(y[k][1 + c] - mean[1 + c]) * share);
      }
      for (int c = 0; c < 3; ++c) largest[4 + c] = larger(largest[4 + c], fabs(y[k][3 + c] - mean[3 + c]) / REACH);
    }
    /* no moment is farther from its own than the ends of what it may be */
    for (int c = 0; c < 2; ++c) {
      const double scaled = exp(mean[c]), farthest = fmax(1 - scaled, scaled - (c ? 0.5 : 0.0)) / REACH;
      if (largest[c] > farthest) largest[c] = farthest;
    }
    memcpy(departures, largest, sizeof(largest));
  }
}

/* Second moments about y at the mean, which comes first, of `bodies` bodies over `points` points [5] with these weights: of the
 * moments [3][3], log ratios [2][2] and turns [3][3]. y [points][8] is room. */
void body_spread(integer bodies, const double* L, const double* steps, const double* axes, integer points, const double* offsets,
                 const double* weights, double (*y)[8], double* moments, double* ratios, double* turns) {
  for (integer n = 0; n < bodies; ++n, L += 9, steps += 25, axes += 9, moments += 9, ratios += 4, turns += 9) {
    const Body body = {L, steps, axes};
    for (integer first = 0; first < points; first += LANES) {
      lane u[5], l[3], V[3][3], B[3][3], S[3][3], J[3][3], own[3], found[8];
      for (int k = 0; k < LANES; ++k)
        for (int j = 0; j < 5; ++j) u[j][k] = offsets[5 * (first + k < points ? first + k : points - 1) + j];
      second_moments(&body, u, l, V, B, S);
      const lane trace = S[0][0] + S[1][1] + S[2][2];
      for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j) J[i][j] = (i == j ? trace : (lane){0}) - S[i][j];
      eigen(J, own, V);
      /* none to rounding: its axes are left where nothing is a number */
      const lane sum = (own[0] + own[1] + own[2]) * 0;
      const mask known = sum == 0, is_body = known & (own[0] > 0) & (own[1] > 0) & (own[2] > 0);
      for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j) V[i][j] = chosen(known, V[i][j], (lane){0} + (i == j));
      for (int k = 0; k < 3; ++k) own[k] = chosen(is_body, own[k], (lane){0} + NAN);
      for (int k = 0; k < 3; ++k) found[k] = own[k] / own[2];
      found[3] = logarithms(own[2] / own[1]);
      found[4] = logarithms(own[1] / own[0]);
      axis_turns(&body, V, found + 5);
      for (int k = 0; k < LANES && first + k < points; ++k)
        for (int j = 0; j < 8; ++j) y[first + k][j] = found[j][k];
    }
    double square[8][8] = {{0}};
    for (integer k = 1; k < points; ++k)
      for (int i = 0; i < 8; ++i)
        for (int j = 0; j <= i; ++j) square[i][j] += weights[k] * (y[k][i] - y[0][i]) * (y[k][j] - y[0][j]);
    for (int i = 0; i < 3; ++i)
      for (int j = 0; j < 3; ++j) {
        const int high = i > j ? i : j, low = i + j - high;
        moments[3 * i + j] = square[high][low];
        turns[3 * i + j] = square[5 + high][5 + low];
        if (i < 2 && j < 2) ratios[2 * i + j] = square[3 + high][3 + low];
      }
  }
}
