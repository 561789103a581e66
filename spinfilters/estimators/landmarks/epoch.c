/* The steps of an epoch's observations of landmarks; `steps.py` says what they compute, `reference.py` computes it in NumPy where there
 * is no compiler. D components of an observation, C columns of the state that it depends on, M modes, N rows of the factor and `stored`,
 * float or double, are defined in front of this text. Matrices are row by row. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

typedef long long integer;
enum { Q = C + M, W = Q + 1, LINEAR = C + 4, BAND = 96 };

/* Householder reflections take `count` rows into the upper triangle R of order n, all with `width` >= n columns in rows of `pitch`. */
static inline void absorb(double* R, double* rows, int count, int n, int width, int pitch) {
  for (int j = 0; j < n; ++j) {
    double square = 0, *top = R + j * pitch, sum[128];
    for (int i = 0; i < count; ++i) square += rows[i * pitch + j] * rows[i * pitch + j];
    if (square == 0) continue;
    double length = sqrt(top[j] * top[j] + square), head = top[j] > 0 ? top[j] + length : top[j] - length;
    double scale = 1 / (head * head + square);
    for (int k = j; k < width; ++k) sum[k] = head * top[k];
    for (int i = 0; i < count; ++i) {
      const double *row = rows + i * pitch, v = row[j];
      for (int k = j; k < width; ++k) sum[k] += v * row[k];
    }
    for (int k = j; k < width; ++k) sum[k] *= 2 * scale;
    for (int k = j; k < width; ++k) top[k] -= head * sum[k];
    for (int i = 0; i < count; ++i) {
      double *row = rows + i * pitch, v = row[j];
      for (int k = j; k < width; ++k) row[k] -= v * sum[k];
    }
  }
}

/* Lower triangular L (3 x 3) with L L' = the sum of products of the columns of `count` rows of three numbers. */
static inline void own_root(double* rows, int count, stored* L) {
  double R[9] = {0};
  absorb(R, rows, count, 3, 3, 3);
  for (int a = 0; a < 3; ++a)
    for (int b = 0; b < 3; ++b) L[3 * a + b] = (stored)(b > a ? 0 : R[3 * b + a]);
}

/* `LandmarkMap.refresh`: landmarks in these rows, to the present modes. */
void refresh(integer count, const integer* at, integer now, integer slots, integer* epoch, const double* transform,
             const double* spread, const double* shift, double* points, stored* modes, stored* roots) {
  for (integer i = 0; i < count; ++i) {
    integer k = at[i];
    if (epoch[k] == now) continue;
    integer slot = epoch[k] % slots;
    const double *T = transform + slot * M * M, *S = spread + slot * M * M, *b = shift + slot * M;
    double A[3 * M], moved[3 * M] = {0}, AS[3 * M] = {0}, P[9];
    for (int a = 0; a < 3 * M; ++a) A[a] = modes[k * 3 * M + a];
    for (int a = 0; a < 3; ++a) {
      double sum = 0;
      for (int m = 0; m < M; ++m) {
        double s = A[a * M + m];
        sum += s * b[m];
        for (int l = 0; l < M; ++l) {
          moved[a * M + l] += s * T[m * M + l];
          AS[a * M + l] += s * S[m * M + l];
        }
      }
      points[3 * k + a] += sum;
    }
    for (int a = 0; a < 3; ++a)
      for (int c = 0; c < 3; ++c) {
        double sum = 0;
        for (int m = 0; m < M; ++m) sum += AS[a * M + m] * A[c * M + m];
        P[3 * a + c] = sum;
      }
    /* rows of a root of P: by elimination, pivots that rounding has made negative count as zero */
    double rows[18] = {0};
    for (int j = 0; j < 3; ++j) {
      double pivot = P[4 * j] > 0 ? sqrt(P[4 * j]) : 0;
      if (pivot > 0) {
        for (int a = j; a < 3; ++a) rows[3 * j + a] = P[3 * a + j] / pivot;
        for (int a = j + 1; a < 3; ++a)
          for (int c = j + 1; c < 3; ++c) P[3 * a + c] -= rows[3 * j + a] * rows[3 * j + c];
      }
    }
    for (int a = 0; a < 3; ++a)
      for (int c = 0; c < 3; ++c) rows[9 + 3 * a + c] = roots[9 * k + 3 * c + a];
    own_root(rows, 6, roots + 9 * k);
    for (int a = 0; a < 3 * M; ++a) modes[k * 3 * M + a] = (stored)moved[a];
    epoch[k] = now;
  }
}

/* `LandmarkMap.advance`: transformations of all slots, one step on. */
void compose(integer slots, const double* step, const double* dropped, const double* by, double* transform, double* spread,
             double* shift) {
  for (integer s = 0; s < slots; ++s) {
    double *T = transform + s * M * M, *S = spread + s * M * M, moved[M * M], f[M * C];
    for (int a = 0; a < M; ++a) {
      double sum = 0, row[M] = {0}, other[C] = {0};
      for (int m = 0; m < M; ++m) {
        double t = T[a * M + m];
        sum += t * by[m];
        for (int l = 0; l < M; ++l) row[l] += t * step[m * M + l];
        for (int l = 0; l < C; ++l) other[l] += t * dropped[m * C + l];
      }
      shift[s * M + a] += sum;
      memcpy(moved + a * M, row, sizeof row);
      for (int l = 0; l < C; ++l) f[l * M + a] = other[l];
    }
    for (int a = 0; a < M; ++a)
      for (int l = 0; l < C; ++l) {
        double v = f[l * M + a];
        for (int c = 0; c < M; ++c) S[a * M + c] += v * f[l * M + c];
      }
    memcpy(T, moved, sizeof moved);
  }
}

/* `whitened`: rows [count][D][W], spread and gram [count][D][3], log_noise [count]. */
void whiten(integer count, const double* linear, const double* weights, const integer* at, const stored* modes,
            const stored* roots, double* rows, double* spread, double* gram, double* log_noise) {
  for (integer i = 0; i < count; ++i) {
    double root = sqrt(weights[i]), every[D * (W + 3)], R[D * D] = {0}, turned[3 * D];
    const stored *A = modes + at[i] * 3 * M, *L = roots + at[i] * 9;
    for (int d = 0; d < D; ++d) {
      const double *from = linear + (i * D + d) * LINEAR, h0 = root * from[C], h1 = root * from[C + 1], h2 = root * from[C + 2];
      double* to = every + d * (W + 3);
      for (int k = 0; k < C; ++k) to[k] = root * from[k];
      for (int k = 0; k < M; ++k) to[C + k] = h0 * A[k] + h1 * A[M + k] + h2 * A[2 * M + k];
      to[Q] = root * from[C + 3];
      for (int k = 0; k < 3; ++k) {
        double x = h0 * L[k] + h1 * L[3 + k] + h2 * L[6 + k];
        to[W + k] = gram[(i * D + d) * 3 + k] = turned[k * D + d] = x;
      }
      R[d * D + d] = 1;
    }
    absorb(R, turned, 3, D, D, D);
    double volume = 1;
    for (int d = 0; d < D; ++d) {
      double* to = every + d * (W + 3);
      for (int e = 0; e < d; ++e) {
        const double s = R[e * D + d], *from = every + e * (W + 3);
        for (int k = 0; k < W + 3; ++k) to[k] -= s * from[k];
      }
      double out = 1 / R[d * D + d];
      for (int k = 0; k < W + 3; ++k) to[k] *= out;
      volume *= fabs(R[d * D + d]);
      memcpy(rows + (i * D + d) * W, to, W * sizeof(double));
      memcpy(spread + (i * D + d) * 3, to + W, 3 * sizeof(double));
    }
    log_noise[i] = log(volume);
  }
}

/* The same for columns `first` to `last` of rows of a fixed length, a multiple of eight; what lies left of `from` is zero. All lengths
 * are known to the compiler, so that it works with whole vectors throughout. */
static inline void absorb_columns(double* restrict R, double* restrict rows, int count, int first, int last, const int from,
                                  const int pitch) {
  for (int j = first; j < last; ++j) {
    double square = 0, sum[64], *top = R + j * pitch;
    for (int i = 0; i < count; ++i) square += rows[i * pitch + j] * rows[i * pitch + j];
    if (square == 0) continue;
    const double length = sqrt(top[j] * top[j] + square), head = top[j] > 0 ? top[j] + length : top[j] - length;
    const double scale = 2 / (head * head + square);
    for (int k = from; k < pitch; ++k) sum[k] = head * top[k];
    for (int i = 0; i < count; ++i) {
      const double *row = rows + i * pitch, v = row[j];
      for (int k = from; k < pitch; ++k) sum[k] += v * row[k];
    }
    for (int k = from; k < pitch; ++k) {
      sum[k] *= scale;
      top[k] -= head * sum[k];
    }
    for (int i = 0; i < count; ++i) {
      double *row = rows + i * pitch, v = row[j];
      for (int k = from; k < pitch; ++k) row[k] -= v * sum[k];
      row[j] = 0;
    }
  }
}

#define ABSORB(NAME, PITCH)                                                                    \
  static void NAME(double* restrict R, double* restrict rows, int count, int n) {              \
    absorb_columns(R, rows, count, 0, n < 8 ? n : 8, 0, PITCH);                                \
    if (PITCH > 8) absorb_columns(R, rows, count, 8, n < 16 ? n : 16, 8, PITCH);               \
    if (PITCH > 16) absorb_columns(R, rows, count, 16, n < 24 ? n : 24, 16, PITCH);            \
    if (PITCH > 24) absorb_columns(R, rows, count, 24, n, 24, PITCH);                          \
  }
enum { WP = (W + 7) / 8 * 8, NP = (N + 8) / 8 * 8 };
ABSORB(absorb_rows, WP)
ABSORB(absorb_factor, NP)

/* `corrected`: factor [n][n] is replaced by that after the update; returns the normalised innovation squared. root [n][n] upper
 * triangular, shift [n] and behind it the log determinant of the root, error [n]. */
double correct(integer count, integer n, const double* rows, const integer* columns, double* factor, double* root, double* shift,
               double* error) {
  double R[W * WP] = {0}, block[BAND * WP], U[N * NP] = {0}, Y[Q * NP] = {0};
  for (integer first = 0; first < count * D; first += BAND) {
    int some = (int)(count * D - first < BAND ? count * D - first : BAND);
    for (int i = 0; i < some; ++i) {
      memcpy(block + i * WP, rows + (first + i) * W, W * sizeof(double));
      memset(block + i * WP + W, 0, (WP - W) * sizeof(double));
    }
    absorb_rows(R, block, some, W);
  }
  double nis = R[Q * WP + Q] * R[Q * WP + Q];
  int size = (int)n;
  for (int j = 0; j < size; ++j) U[j * NP + j] = 1;
  for (int a = 0; a < Q; ++a) {
    for (int b = a; b < Q; ++b) {
      const double s = R[a * WP + b], *row = factor + columns[b] * n;
      for (int k = 0; k < size; ++k) Y[a * NP + k] += s * row[k];
    }
    Y[a * NP + size] = R[a * WP + Q];
  }
  absorb_factor(U, Y, Q, size);
  for (int a = 0; a < Q; ++a) nis += Y[a * NP + size] * Y[a * NP + size];
  shift[size] = 0;
  for (int j = 0; j < size; ++j) {
    const double *u = U + j * NP, out = 1 / u[j];
    shift[size] += log(fabs(u[j]));
    memcpy(root + j * n, u, size * sizeof(double));
    shift[j] = u[size];
    for (int i = 0; i < size; ++i) {
      double *row = factor + i * n, s = row[j] *= out;
      for (int k = j + 1; k < size; ++k) row[k] -= s * u[k];
    }
  }
  for (int i = 0; i < size; ++i) {
    double sum = 0;
    for (int j = 0; j < size; ++j) sum += factor[i * n + j] * shift[j];
    error[i] = sum;
  }
  return nis;
}

/* Rows a and b of V, turned. */
static inline void turn(double* restrict a, double* restrict b, double c, double s) {
  for (int k = 0; k < Q; ++k) {
    const double x = a[k], y = b[k];
    a[k] = c * x - s * y;
    b[k] = s * x + c * y;
  }
}

/* Eigenvalues d of a symmetric A (order Q, overwritten), eigenvectors in the rows of V: Householder's reflections to three diagonals,
 * then QL with implicit shifts (Wilkinson and Reinsch, 1971). */
static void eigenvectors(double* A, double* d, double* V) {
  double e[Q] = {0};
  memset(V, 0, Q * Q * sizeof(double));
  for (int j = 0; j < Q; ++j) V[j * (Q + 1)] = 1;
  for (int j = 0; j + 2 < Q; ++j) {
    double v[Q] = {0}, w[Q] = {0}, z[Q] = {0}, square = 0, along = 0;
    for (int k = j + 1; k < Q; ++k) v[k] = A[j * Q + k];
    for (int k = j + 2; k < Q; ++k) square += v[k] * v[k];
    if (square == 0) continue;
    const double length = sqrt(square + v[j + 1] * v[j + 1]);
    v[j + 1] += v[j + 1] > 0 ? length : -length;
    const double scale = 2 / (square + v[j + 1] * v[j + 1]);
    for (int a = j; a < Q; ++a)
      for (int k = 0; k < Q; ++k) {
        w[k] += scale * v[a] * A[a * Q + k];
        z[k] += scale * v[a] * V[a * Q + k];
      }
    for (int k = 0; k < Q; ++k) along += 0.5 * scale * v[k] * w[k];
    for (int k = 0; k < Q; ++k) w[k] -= along * v[k];
    for (int a = j; a < Q; ++a)
      for (int k = 0; k < Q; ++k) {
        A[a * Q + k] -= v[a] * w[k] + w[a] * v[k];
        V[a * Q + k] -= v[a] * z[k];
      }
  }
  for (int j = 0; j < Q; ++j) d[j] = A[j * (Q + 1)];
  for (int j = 0; j + 1 < Q; ++j) e[j] = A[j * (Q + 1) + 1];
  for (int l = 0; l < Q; ++l)
    for (int sweep = 0; sweep < 60; ++sweep) {
      int m = l;
      while (m + 1 < Q && !(fabs(e[m]) <= 1e-16 * (fabs(d[m]) + fabs(d[m + 1])))) ++m;
      if (m == l) break;
      double g = (d[l + 1] - d[l]) / (2 * e[l]), r = sqrt(g * g + 1), s = 1, c = 1, p = 0;
      g = d[m] - d[l] + e[l] / (g > 0 ? g + r : g - r);
      int i = m - 1;
      for (; i >= l; --i) {
        const double f = s * e[i], b = c * e[i];
        e[i + 1] = r = sqrt(f * f + g * g);
        if (r == 0) break;
        s = f / r;
        c = g / r;
        g = d[i + 1] - p;
        r = (d[i] - g) * s + 2 * c * b;
        p = s * r;
        d[i + 1] = g + p;
        g = c * r - b;
        turn(V + i * Q, V + (i + 1) * Q, c, s);
      }
      if (i >= l) d[i + 1] -= p;
      else {
        d[l] -= p;
        e[l] = g;
      }
      e[m] = 0;
    }
}

/* Rows of `from` (Q x n) by reflections from the right: lower triangular R (Q x Q), and the reflections. */
static void lower_by_reflections(const double* from, int n, double* R, double* reflect) {
  memcpy(reflect, from, Q * n * sizeof(double));
  memset(R, 0, Q * Q * sizeof(double));
  for (int j = 0; j < Q; ++j) {
    double *u = reflect + j * n, square = 0;
    for (int k = 0; k < j; ++k) {
      R[j * Q + k] = u[k];
      u[k] = 0;
    }
    for (int k = j; k < n; ++k) square += u[k] * u[k];
    double length = u[j] > 0 ? -sqrt(square) : sqrt(square);
    R[j * Q + j] = length;
    u[j] -= length;
    square = 2 * (square - length * (length + u[j]));
    if (!(square > 0)) {
      memset(u, 0, n * sizeof(double));
      continue;
    }
    double scale = sqrt(2 / square);
    for (int k = j; k < n; ++k) u[k] *= scale;
    for (int i = j + 1; i < Q; ++i) {
      double *row = reflect + i * n, sum = 0;
      for (int k = j; k < n; ++k) sum += row[k] * u[k];
      for (int k = j; k < n; ++k) row[k] -= sum * u[k];
    }
  }
}

/* What an observation's rows (D x W) make of its landmark: X' rows (3 x W). */
static inline void pulled(const double* rows, const double* X, double* out) {
  for (int a = 0; a < 3; ++a)
    for (int k = 0; k < W; ++k) {
      double sum = 0;
      for (int d = 0; d < D; ++d) sum += X[3 * d + a] * rows[d * W + k];
      out[a * W + k] = sum;
    }
}

static inline void add_square(const double* s, int rows, int width, double scale, double* G) {
  for (int a = 0; a < width; ++a)
    for (int d = 0; d < rows; ++d) {
      const double *row = s + d * width, v = scale * row[a];
      for (int b = 0; b < width; ++b) G[a * Q + b] += v * row[b];
    }
}

/* `compress`: turned [Q][Q] of kept and dropped side by side, mode_rows [M][n], explained [M] (in: what is remembered). */
void compress(integer count, const double* rows, const double* spread, integer fresh, const double* scaled, double share, integer n,
              const double* both, double* explained, double* turned, double* mode_rows) {
  double G[Q * Q] = {0}, R[Q * Q], A[Q * Q] = {0}, d[Q], V[Q * Q], T[Q * Q] = {0}, reflect[Q * N];
  for (integer i = 0; i < count; ++i) {
    const double *row = rows + i * D * W, *X = spread + i * D * 3;
    double pull[3 * W], seen[D * Q];
    pulled(row, X, pull);
    for (int d = 0; d < D; ++d)
      for (int k = 0; k < Q; ++k)
        seen[d * Q + k] = (k < C ? 0 : row[d * W + k]) -
                          (X[3 * d] * pull[k] + X[3 * d + 1] * pull[W + k] + X[3 * d + 2] * pull[2 * W + k]);
    add_square(seen, D, Q, 1, G);
  }
  for (integer i = 0; i < fresh; ++i) add_square(scaled + i * 3 * C, 3, C, share, G);
  for (int m = 0; m < M; ++m) G[(C + m) * (Q + 1)] += explained[m];
  lower_by_reflections(both, (int)n, R, reflect);
  for (int a = 0; a < Q; ++a)
    for (int b = 0; b < Q; ++b)
      for (int k = 0; k <= b; ++k) T[a * Q + k] += G[a * Q + b] * R[b * Q + k];
  for (int b = 0; b < Q; ++b)
    for (int a = 0; a <= b; ++a)
      for (int k = 0; k < Q; ++k) A[a * Q + k] += R[b * Q + a] * T[b * Q + k];
  eigenvectors(A, d, V);
  int order[Q];
  for (int j = 0; j < Q; ++j) {
    int at = j;
    for (; at > 0 && d[order[at - 1]] < d[j]; --at) order[at] = order[at - 1];
    order[at] = j;
  }
  double side[N * M] = {0}; /* the modes' rows side by side */
  for (int j = 0; j < Q; ++j) {
    const double* v = V + order[j] * Q;
    for (int a = 0; a < Q; ++a) {
      double sum = 0;
      for (int b = 0; b <= a; ++b) sum += R[a * Q + b] * v[b];
      turned[a * Q + j] = sum;
      if (j < M) side[a * M + j] = v[a];
    }
    if (j < M) explained[j] = d[order[j]];
  }
  for (int k = Q - 1; k >= 0; --k) {
    const double* u = reflect + k * n;
    double sum[M] = {0};
    for (int l = k; l < n; ++l)
      for (int m = 0; m < M; ++m) sum[m] += u[l] * side[l * M + m];
    for (int l = k; l < n; ++l)
      for (int m = 0; m < M; ++m) side[l * M + m] -= u[l] * sum[m];
  }
  for (int m = 0; m < M; ++m)
    for (int l = 0; l < n; ++l) mode_rows[m * n + l] = side[l * M + m];
}

/* Dependence on the new modes and own root of a landmark that depended on (pose, modes) by `both` (3 x width) and on itself by `own`. */
static inline void settle(const double* both, int width, const double* own, const double* turned, stored* modes, stored* root) {
  double by[3 * Q] = {0}, rows[(C + 3) * 3];
  for (int k = 0; k < width; ++k) {
    const double *row = turned + k * Q, x = both[k], y = both[width + k], z = both[2 * width + k];
    for (int m = 0; m < Q; ++m) {
      by[m] += x * row[m];
      by[Q + m] += y * row[m];
      by[2 * Q + m] += z * row[m];
    }
  }
  for (int a = 0; a < 3; ++a) {
    for (int m = 0; m < M; ++m) modes[a * M + m] = (stored)by[a * Q + m];
    for (int c = 0; c < C; ++c) rows[3 * c + a] = by[a * Q + M + c];
    for (int b = 0; b < 3; ++b) rows[3 * (C + b) + a] = own[3 * a + b];
  }
  own_root(rows, C + 3, root);
}

/* `observed`: landmarks in rows `at`, in place. error [Q] of pose and modes. */
void observe(integer count, const double* rows, const double* spread, const double* gram, const integer* at, const double* error,
             const double* turned, integer now, integer* epoch, double* points, stored* modes, stored* roots) {
  for (integer i = 0; i < count; ++i) {
    integer l = at[i];
    stored *A = modes + l * 3 * M, *L = roots + l * 9;
    double pull[3 * W], both[3 * Q], own[9], U[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1}, block[D * 3];
    pulled(rows + i * D * W, spread + i * D * 3, pull);
    memcpy(block, gram + i * D * 3, sizeof block);
    absorb(U, block, D, 3, 3, 3);
    for (int a = 0; a < 3; ++a) {
      double root[3] = {L[3 * a], L[3 * a + 1], L[3 * a + 2]}, step = 0;
      for (int k = 0; k < Q; ++k) {
        double sum = root[0] * pull[k] + root[1] * pull[W + k] + root[2] * pull[2 * W + k];
        both[a * Q + k] = (k < C ? 0 : A[a * M + k - C]) - sum;
        step += both[a * Q + k] * error[k];
      }
      step += root[0] * pull[Q] + root[1] * pull[W + Q] + root[2] * pull[2 * W + Q];
      points[3 * l + a] += step;
      own[3 * a] = root[0] / U[0];
      own[3 * a + 1] = (root[1] - own[3 * a] * U[1]) / U[4];
      own[3 * a + 2] = (root[2] - own[3 * a] * U[2] - own[3 * a + 1] * U[5]) / U[8];
    }
    settle(both, Q, own, turned, A, L);
    epoch[l] = now;
  }
}

/* The same for new landmarks, which depend on the pose by [count][3][C] and have their own roots. */
void settle_new(integer count, const double* by_pose, const double* own, const double* turned, stored* modes, stored* roots) {
  for (integer i = 0; i < count; ++i) settle(by_pose + i * 3 * C, C, own + i * 9, turned, modes + i * 3 * M, roots + i * 9);
}

/* `Steps.close`: everything after the correction of an epoch, in the order of its NumPy reference. fresh: new landmarks, by_pose
 * [fresh][3][C] and own [fresh][3][3]; places: begin and end of the rows whose turn it is. */
void close_epoch(integer count, const double* rows, const double* spread, const double* gram, const integer* at, const double* error,
                 integer fresh, const double* by_pose, const double* own, double share, integer n, const double* both,
                 double* explained, double* turned, double* mode_rows, stored* new_modes, stored* new_roots, integer total,
                 integer begin, integer end, integer slots, integer now, integer* epoch, double* transform, double* dropped,
                 double* shift, double* points, stored* modes, stored* roots) {
  double step[M * M], left[M * C], *scaled = (double*)malloc((fresh * 3 * C + 1) * sizeof(double));
  if (scaled == 0) abort();
  for (integer i = 0; i < fresh; ++i)
    for (int k = 0; k < C; ++k) {
      const double *L = own + 9 * i, *x = by_pose + i * 3 * C + k;
      double *y = scaled + i * 3 * C + k, a = x[0] / L[0], b = (x[C] - L[3] * a) / L[4];
      y[0] = a;
      y[C] = b;
      y[2 * C] = (x[2 * C] - L[6] * a - L[7] * b) / L[8];
    }
  compress(count, rows, spread, fresh, scaled, share, n, both, explained, turned, mode_rows);
  free(scaled);
  for (integer i = 0; i < total; ++i)
    if ((i >= begin && i < end) || epoch[i] < now - (slots - 2))
      refresh(1, &i, now, slots, epoch, transform, dropped, shift, points, modes, roots);
  for (int a = 0; a < M; ++a) {
    memcpy(step + a * M, turned + (C + a) * Q, M * sizeof(double));
    memcpy(left + a * C, turned + (C + a) * Q + M, C * sizeof(double));
  }
  compose(slots, step, left, error + C, transform, dropped, shift);
  const integer slot = ++now % slots;
  memset(transform + slot * M * M, 0, M * M * sizeof(double));
  memset(dropped + slot * M * M, 0, M * M * sizeof(double));
  memset(shift + slot * M, 0, M * sizeof(double));
  for (int a = 0; a < M; ++a) transform[slot * M * M + a * M + a] = 1;
  observe(count, rows, spread, gram, at, error, turned, now, epoch, points, modes, roots);
  settle_new(fresh, by_pose, own, turned, new_modes, new_roots);
}
