/* Loops of the smoother over sightings and over time. `elimination.py` and `chain.py` say what they compute, and say it again in
 * NumPy for machines without a compiler. Matrices are row by row. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { R = 3, POSE = 6, WIDE = 8, ROW = POSE + 3 + 1 };
typedef long long integer;
typedef double wide __attribute__((vector_size(8 * WIDE), aligned(8 * WIDE)));
typedef double unaligned_wide __attribute__((vector_size(8 * WIDE), aligned(8)));
typedef double four __attribute__((vector_size(32), aligned(8)));
typedef double two __attribute__((vector_size(16), aligned(8)));

static int cholesky(double* a, int n) {
  for (int j = 0; j < n; ++j) {
    for (int k = 0; k < j; ++k) a[j * n + j] -= a[j * n + k] * a[j * n + k];
    if (!(a[j * n + j] > 0)) return 0;
    a[j * n + j] = sqrt(a[j * n + j]);
    for (int i = j + 1; i < n; ++i) {
      for (int k = 0; k < j; ++k) a[i * n + j] -= a[i * n + k] * a[j * n + k];
      a[i * n + j] /= a[j * n + j];
      a[j * n + i] = 0;
    }
  }
  return 1;
}

/* Information V (lower root on return) and gradient of a landmark from its sightings; 0 where it is not told. What a row has by the
 * landmark and its innovation are read as one vector. */
static int landmark_root(integer first, integer last, const double* rows, const double* weight, double flattest,
                         double V[9], double y[3]) {
  int hits = 0;
  four sum[3] = {{0}, {0}, {0}};
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
  double scale = V[0] * V[4] * V[8];
  if (hits < 2 || !cholesky(V, 3)) return 0;
  double root = V[0] * V[4] * V[8];
  if (!(root * root > flattest * scale)) return 0;
  y[0] /= V[0];
  y[1] = (y[1] - V[3] * y[0]) / V[4];
  y[2] = (y[2] - V[6] * y[0] - V[7] * y[1]) / V[8];
  return 1;
}

/* What one sighting gives its pose, and its coupling L^-1 J_p' J_x, added to Y (3 rows of WIDE); out holds 1 / diagonal of L. A row is
 * read as one vector: its last two lanes, of the landmark, are carried along and never looked at. */
static void one_sighting(const double* rows, double weight, const double* L, const double out[3], wide* H, wide* g, wide Y[3]) {
  wide W[3] = {{0}, {0}, {0}}, h[POSE], slope = *g;
  for (int a = 0; a < POSE; ++a) h[a] = H[a];
  for (int r = 0; r < R; ++r) {
    const double* J = rows + r * ROW;
    wide x = *(const unaligned_wide*)J, scaled = weight * x;
    for (int a = 0; a < POSE; ++a) h[a] += J[a] * scaled;
    for (int a = 0; a < 3; ++a) W[a] += J[POSE + a] * scaled;
    slope += J[ROW - 1] * scaled;
  }
  for (int a = 0; a < POSE; ++a) H[a] = h[a];
  *g = slope;
  wide y0 = W[0] * out[0], y1 = (W[1] - L[3] * y0) * out[1];
  Y[0] += y0;
  Y[1] += y1;
  Y[2] += (W[2] - L[6] * y0 - L[7] * y1) * out[2];
}

static void subtract_block(wide* S, const wide* left, const wide* right) {
  wide r0 = right[0], r1 = right[1], r2 = right[2];
  for (int a = 0; a < POSE; ++a) S[a] -= left[0][a] * r0 + left[1][a] * r1 + left[2][a] * r2;
}

/* Landmarks [L] with sightings start[l] .. start[l + 1], sorted by frame. Out: told [L], root [L][9], y [L][3], Y [N][18] (zero for
 * a sighting that is not the first of its landmark in its frame), S: pairs of frames i >= j, block i (i + 1) / 2 + j, [6][8];
 * gradient [frames][6]. */
int eliminate_landmarks(integer landmarks, integer frames, const integer* start, const integer* frame, const double* rows,
                        const double* weight, double flattest, unsigned char* told, double* root, double* y, double* Y,
                        double* blocks, double* gradient) {
  integer most = 1;
  for (integer l = 0; l < landmarks; ++l)
    if (start[l + 1] - start[l] > most) most = start[l + 1] - start[l];
  void* raw = malloc((most * 3 + frames) * sizeof(wide) + most * sizeof(integer) + 64);
  if (raw == 0) return 1;
  wide* couple = (wide*)(((size_t)raw + 63) & ~(size_t)63);
  wide* slope = couple + 3 * most;
  integer* seen = (integer*)(slope + frames);
  wide* S = (wide*)blocks;
  memset(blocks, 0, frames * (frames + 1) / 2 * POSE * sizeof(wide));
  memset(slope, 0, frames * sizeof(wide));
  for (integer l = 0; l < landmarks; ++l) {
    double *V = root + 9 * l, *v = y + 3 * l;
    memset(Y + start[l] * 18, 0, (start[l + 1] - start[l]) * 18 * sizeof(double));
    told[l] = landmark_root(start[l], start[l + 1], rows, weight, flattest, V, v);
    if (!told[l]) continue;
    const double out[3] = {1 / V[0], 1 / V[4], 1 / V[8]};
    integer count = 0;
    for (integer i = start[l]; i < start[l + 1]; ++i) {
      if (!(weight[i] > 0)) continue;
      int again = count && frame[seen[count - 1]] == frame[i];
      wide* mine = couple + 3 * (count - again);
      if (!again) {
        mine[0] = mine[1] = mine[2] = (wide){0};
        seen[count++] = i;
      }
      integer f = frame[i];
      one_sighting(rows + i * R * ROW, weight[i], V, out, S + (f * (f + 1) / 2 + f) * POSE, slope + f, mine);
    }
    for (integer i = 0; i < count; ++i) {
      integer f = frame[seen[i]];
      const wide* left = couple + 3 * i;
      slope[f] -= v[0] * left[0] + v[1] * left[1] + v[2] * left[2];
      for (int a = 0; a < 3; ++a) memcpy(Y + seen[i] * 18 + a * POSE, left + a, POSE * sizeof(double));
      wide* line = S + f * (f + 1) / 2 * POSE;
      for (integer j = 0; j <= i; ++j) subtract_block(line + frame[seen[j]] * POSE, left, couple + 3 * j);
    }
  }
  for (integer f = 0; f < frames; ++f) memcpy(gradient + f * POSE, slope + f, POSE * sizeof(double));
  free(raw);
  return 0;
}

/* Blocks of pairs of frames into the lower triangle of a matrix with rows of n. */
void spread_blocks(integer frames, integer n, const double* blocks, double* M) {
  for (integer i = 0; i < frames; ++i)
    for (integer j = 0; j <= i; ++j) {
      const double* block = blocks + (i * (i + 1) / 2 + j) * POSE * WIDE;
      for (int a = 0; a < POSE; ++a) memcpy(M + (i * POSE + a) * n + j * POSE, block + a * WIDE, POSE * sizeof(double));
    }
}

/* How landmarks follow a step of the poses: L^-T (y - sum Y e); zero where a landmark is not told. */
void follow_poses(integer landmarks, const integer* start, const integer* frame, const unsigned char* told, const double* root,
                  const double* y, const double* Y, const double* poses, double* step) {
  for (integer l = 0; l < landmarks; ++l) {
    double z[3] = {y[3 * l], y[3 * l + 1], y[3 * l + 2]};
    const double* L = root + 9 * l;
    double* out = step + 3 * l;
    out[0] = out[1] = out[2] = 0;
    if (!told[l]) continue;
    four left[3] = {{0}, {0}, {0}};
    two right[3] = {{0}, {0}, {0}};
    for (integer i = start[l]; i < start[l + 1]; ++i) {
      const double *row = Y + 3 * POSE * i, *e = poses + POSE * frame[i];
      four e0 = *(const four*)e;
      two e4 = *(const two*)(e + 4);
      for (int a = 0; a < 3; ++a) {
        left[a] += *(const four*)(row + POSE * a) * e0;
        right[a] += *(const two*)(row + POSE * a + 4) * e4;
      }
    }
    for (int a = 0; a < 3; ++a)
      z[a] -= (left[a][0] + left[a][1]) + (left[a][2] + left[a][3]) + (right[a][0] + right[a][1]);
    out[2] = z[2] / L[8];
    out[1] = (z[1] - L[7] * out[2]) / L[4];
    out[0] = (z[0] - L[3] * out[1] - L[6] * out[2]) / L[0];
  }
}

/* to -= factor * from, over the columns low .. high and tail .. width. */
static void subtract_row(double* to, const double* from, double factor, integer low, integer high, integer tail, integer width) {
  for (integer j = low; j < high; ++j) to[j] -= factor * from[j];
  for (integer j = tail; j < width; ++j) to[j] -= factor * from[j];
}

/* Rows [d] of vectors [wides] divided by the root of what spreads them, noise noise' + floor^2 I with noise [d][q]; NaN where it has
 * none. */
static void whiten(integer d, integer wides, integer q, double floor, const double* noise, wide* rows, double* root) {
  for (integer a = 0; a < d; ++a)
    for (integer b = 0; b <= a; ++b) {
      double sum = a == b ? floor * floor : 0;
      for (integer c = 0; c < q; ++c) sum += noise[a * q + c] * noise[b * q + c];
      root[a * d + b] = root[b * d + a] = sum;
    }
  int good = cholesky(root, (int)d);
  for (integer a = 0; a < d; ++a) {
    double scale = good ? 1 / root[a * d + a] : NAN;
    for (integer j = 0; j < wides; ++j) {
      wide x = rows[a * wides + j];
      for (integer b = 0; b < a; ++b) x -= root[a * d + b] * rows[b * wides + j];
      rows[a * wides + j] = scale * x;
    }
  }
}

/* rows' rows of rows [d] of vectors [wides], as grams [w][w]. */
static void gram(integer d, integer wides, integer w, const wide* rows, double* grams) {
  const double* numbers = (const double*)rows;
  for (integer i = 0; i < w; ++i)
    for (integer j = 0; j < wides; ++j) {
      wide sum = {0};
      for (integer a = 0; a < d; ++a) sum += numbers[a * wides * WIDE + i] * rows[a * wides + j];
      integer left = w - j * WIDE;
      memcpy(grams + i * w + j * WIDE, &sum, (left < WIDE ? left : WIDE) * sizeof(double));
    }
}

/* Whitened rows of K steps, [K][d][w]: errors of the d moving components here and there, of the c constants, and the defect; and
 * their grams [K][w][w]. Components are numbered in `moving` and `constant` among the n of defect [K][n], transition [K][n][n] and
 * noise [K][n][q]. */
int step_rows(integer K, integer n, integer d, integer c, integer q, const integer* moving, const integer* constant, double floor,
              const double* defect, const double* transition, const double* noise, double* rows, double* grams) {
  integer w = 2 * d + c + 1, wides = (w + WIDE - 1) / WIDE;
  void* raw = malloc(d * wides * sizeof(wide) + d * (d + q) * sizeof(double) + 64);
  if (raw == 0) return 1;
  wide* padded = (wide*)(((size_t)raw + 63) & ~(size_t)63);
  double *root = (double*)(padded + d * wides), *spread = root + d * d;
  memset(padded, 0, d * wides * sizeof(wide));
  for (integer k = 0; k < K; ++k, defect += n, transition += n * n, noise += n * q, rows += d * w, grams += w * w) {
    for (integer a = 0; a < d; ++a) {
      const double* T = transition + moving[a] * n;
      double* row = (double*)(padded + a * wides);
      for (integer b = 0; b < d; ++b) {
        row[b] = -T[moving[b]];
        row[d + b] = a == b;
      }
      for (integer b = 0; b < c; ++b) row[2 * d + b] = -T[constant[b]];
      row[w - 1] = defect[moving[a]];
      memcpy(spread + a * q, noise + moving[a] * q, q * sizeof(double));
    }
    whiten(d, wides, q, floor, spread, padded, root);
    for (integer a = 0; a < d; ++a) memcpy(rows + a * w, padded + a * wides, w * sizeof(double));
    gram(d, wides, w, padded, grams);
  }
  free(raw);
  return 0;
}

/* Where a component of a gram goes: poses, constants and the right-hand side by their place in what remains, chained errors by
 * -1 - frame, with their place in `at`. A frame's gram has pose, chain, constants, right-hand side; a step's has pose and chain twice. */
static integer place_components(integer k, integer both, integer K, integer p, integer v, integer c, integer* to, integer* at) {
  integer n = 0;
  for (integer f = k; f <= k + both; ++f) {
    for (integer a = 0; a < p; ++a) to[n++] = f * p + a;
    for (integer a = 0; a < v; ++a) {
      to[n] = -1 - f;
      at[n++] = a;
    }
  }
  for (integer a = 0; a <= c; ++a) to[n++] = K * p + a;
  return n;
}

/* Grams of frames (both = 0, count = K) or of steps (both = 1, count = K - 1) into M [kept + 1][kept], lower triangle and right-hand
 * side, and into D, E, G of the chain. */
void add_grams(integer count, integer both, integer K, integer p, integer v, integer c, const double* grams, double* M, double* D,
               double* E, double* G) {
  integer kept = K * p + c, width = kept + 1, most = 2 * (p + v) + c + 1;
  integer* to = (integer*)malloc(2 * most * sizeof(integer));
  if (to == 0) return;
  integer* at = to + most;
  for (integer k = 0; k < count; ++k) {
    integer n = place_components(k, both, K, p, v, c, to, at);
    const double* g = grams + k * n * n;
    for (integer i = 0; i < n; ++i, g += n) {
      if (to[i] >= 0) {
        for (integer j = 0; j < n; ++j)
          if (to[j] >= 0 && to[j] <= to[i] && to[j] < kept) M[to[i] * kept + to[j]] += g[j];
        continue;
      }
      integer f = -1 - to[i];
      double *row = G + (f * v + at[i]) * width, *own = D + (f * v + at[i]) * v, *next = E + (f * v + at[i]) * v;
      for (integer j = 0; j < n; ++j) {
        if (to[j] >= 0) row[to[j]] += g[j];
        else if (to[j] == to[i]) own[at[j]] += g[j];
        else if (to[j] < to[i]) next[at[j]] += g[j];
      }
    }
  }
  free(to);
}

/* First block of p columns of X that has not faded below `faded` of its largest element so far, counted from `low` on. */
static integer not_faded(const double* X, double* largest, double faded, integer v, integer p, integer low, integer last,
                         integer high, integer width) {
  int fading = 1;
  for (integer m = low; m < high; ++m) {
    double most = 0;
    for (integer a = 0; a < v; ++a)
      for (integer j = m * p; j < (m + 1) * p; ++j) most = fmax(most, fabs(X[a * width + j]));
    if (most > largest[m]) largest[m] = most;
    if (fading && m < last && most <= faded * largest[m]) low = m + 1;
    else fading = 0;
  }
  return low;
}

/* Block-tridiagonal elimination: D [K][v][v], E [K-1][v][v] (row k, column k + 1), G [K][v][width] (its coupling to what remains) in
 * place: G becomes X = L^-1 (G - F' X_before), D becomes L, E becomes F = L^-1 E. The first `blocks` blocks of p columns are poses;
 * row k knows those up to k + 1 and up to `reach`, and forgets those on the left that have faded: begin[k] is the first it feels.
 * Returns the number of a block that is not positive definite plus 1, or 0. */
integer eliminate_chain(integer K, integer v, integer p, integer blocks, integer width, integer reach, double faded, double* D,
                        double* E, double* G, integer* begin) {
  double* largest = (double*)calloc(blocks + 1, sizeof(double));
  if (largest == 0) return -1;
  integer low = 0, failed = 0, tail = blocks * p;
  for (integer k = 0; k < K; ++k) {
    double *T = D + k * v * v, *X = G + k * v * width;
    integer end = k + 2 > reach ? k + 2 : reach;
    integer last = end < blocks ? end : blocks;
    if (k > 0) {
      const double *F = E + (k - 1) * v * v, *before = X - v * width;
      for (integer c = 0; c < v; ++c)
        for (integer a = 0; a < v; ++a) {
          for (integer b = 0; b < v; ++b) T[a * v + b] -= F[c * v + a] * F[c * v + b];
          subtract_row(X + a * width, before + c * width, F[c * v + a], low * p, last * p, tail, width);
        }
    }
    if (!cholesky(T, (int)v)) {
      failed = k + 1;
      break;
    }
    for (integer a = 0; a < v; ++a) {
      double *x = X + a * width, d = 1 / T[a * v + a];
      for (integer b = 0; b < a; ++b) subtract_row(x, X + b * width, T[a * v + b], low * p, last * p, tail, width);
      for (integer j = low * p; j < last * p; ++j) x[j] *= d;
      for (integer j = tail; j < width; ++j) x[j] *= d;
    }
    if (k + 1 < K) {
      double* e = E + k * v * v;
      for (integer a = 0; a < v; ++a) {
        for (integer b = 0; b < a; ++b)
          for (integer j = 0; j < v; ++j) e[a * v + j] -= T[a * v + b] * e[b * v + j];
        for (integer j = 0; j < v; ++j) e[a * v + j] /= T[a * v + a];
      }
    }
    begin[k] = low;
    low = not_faded(X, largest, faded, v, p, low, k, last, width);
  }
  free(largest);
  return failed;
}

/* Behind a solution of what remains: right [K][v] becomes L_k^-T (right_k - F_k out_k+1). */
void solve_chain(integer K, integer v, const double* L, const double* F, double* right) {
  for (integer k = K - 1; k >= 0; --k) {
    const double *T = L + k * v * v, *f = F + k * v * v, *after = right + (k + 1) * v;
    double* x = right + k * v;
    if (k + 1 < K)
      for (integer a = 0; a < v; ++a)
        for (integer b = 0; b < v; ++b) x[a] -= f[a * v + b] * after[b];
    for (integer a = v - 1; a >= 0; --a) {
      for (integer b = a + 1; b < v; ++b) x[a] -= T[b * v + a] * x[b];
      x[a] /= T[a * v + a];
    }
  }
}
