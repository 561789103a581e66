/* Loops over time; types and roots are those of `kernels.h`. */

/* to -= factor * from, over the columns low .. high and tail .. width. */
static void subtract_row(double* to, const double* from, double factor, integer low, integer high, integer tail, integer width) {
  for (integer j = low; j < high; ++j) to[j] -= factor * from[j];
  for (integer j = tail; j < width; ++j) to[j] -= factor * from[j]; /* constants and right-hand side */
}

/* Rows [d] of vectors [groups] divided by the root of what spreads them, noise noise' + floor^2 I with noise [d][q]; NaN
 * where it has none. */
static void whiten(integer d, integer groups, integer q, double floor, const double* noise, lanes* rows, double* root) {
  /* Q = noise noise' + floor^2 I, [d][d]. */
  for (integer a = 0; a < d; ++a)
    for (integer b = 0; b <= a; ++b) {
      double sum = a == b ? floor * floor : 0;
      for (integer c = 0; c < q; ++c) sum += noise[a * q + c] * noise[b * q + c];
      root[a * d + b] = root[b * d + a] = sum;
    }
  int good = cholesky(root, (int)d);
  /* Forward substitution L rows = rows, L L' = Q. */
  for (integer a = 0; a < d; ++a) {
    double scale = good ? 1 / root[a * d + a] : NAN;
    for (integer j = 0; j < groups; ++j) {
      lanes x = rows[a * groups + j];
      for (integer b = 0; b < a; ++b) x -= root[a * d + b] * rows[b * groups + j];
      rows[a * groups + j] = scale * x;
    }
  }
}

/* rows' rows of rows [d] of vectors [groups], as grams [w][w]. */
static void gram(integer d, integer groups, integer w, const lanes* rows, double* grams) {
  const double* numbers = (const double*)rows;
  enum { SOME = 4 };
  /* some rows of rows' rows, a vector of columns at a time; the last rows may be the same one several times */
  for (integer i = 0; i < w; i += SOME) {
    integer place[SOME];
    for (int r = 0; r < SOME; ++r) place[r] = i + r < w ? i + r : w - 1;
    for (integer j = 0; j < groups; ++j) {
      lanes sums[SOME] = {{0}};
      for (integer a = 0; a < d; ++a) {
        const double* row = numbers + a * groups * LANES;
        for (int r = 0; r < SOME; ++r) sums[r] += row[place[r]] * rows[a * groups + j];
      }
      for (int r = 0; r < SOME; ++r) {
        double* to = grams + place[r] * w + j * LANES;
        if ((j + 1) * LANES <= w) *(loose*)to = sums[r];
        else /* columns beyond w are cut off */
          for (integer l = 0; l < w - j * LANES; ++l) to[l] = sums[r][l];
      }
    }
  }
}

/* Whitened rows of K steps, [K][d][w]: errors of the d moving components here and there, of the c constants, and the defect; and
 * their grams [K][w][w]. Components are numbered in `moving` and `constant` among the n of defect [K][n], transition [K][n][n] and
 * noise [K][n][q]. */
int step_rows(integer K, integer n, integer d, integer c, integer q, const integer* moving, const integer* constant, double floor,
              const double* defect, const double* transition, const double* noise, double* rows, double* grams) {
  integer w = 2 * d + c + 1, groups = (w + LANES - 1) / LANES;
  void* raw = malloc(d * groups * sizeof(lanes) + d * (d + q) * sizeof(double) + 64);
  if (raw == 0) return 1;
  lanes* padded = (lanes*)(((size_t)raw + 63) & ~(size_t)63);
  double *root = (double*)(padded + d * groups), *spread = root + d * d;
  memset(padded, 0, d * groups * sizeof(lanes));
  /* step k: its rows, whitened by its noise, and their gram */
  for (integer k = 0; k < K; ++k, defect += n, transition += n * n, noise += n * q, rows += d * w, grams += w * w) {
    /* Row a: [-Phi_moving | I | -Phi_constant | defect], columns here (d), there (d), constants (c), right-hand side. */
    for (integer a = 0; a < d; ++a) {
      const double* T = transition + moving[a] * n;
      double* row = (double*)(padded + a * groups);
      for (integer b = 0; b < d; ++b) {
        row[b] = -T[moving[b]];
        row[d + b] = a == b;
      }
      for (integer b = 0; b < c; ++b) row[2 * d + b] = -T[constant[b]];
      row[w - 1] = defect[moving[a]];
      memcpy(spread + a * q, noise + moving[a] * q, q * sizeof(double));
    }
    whiten(d, groups, q, floor, spread, padded, root);
    /* rows without the columns that fill up a vector */
    for (integer a = 0; a < d; ++a) memcpy(rows + a * w, padded + a * groups, w * sizeof(double));
    gram(d, groups, w, padded, grams);
  }
  free(raw);
  return 0;
}

/* A run of a gram's components: count from `from` on. They remain at `to` .. of poses, constants and right-hand side, or are the
 * chained errors of the epoch -1 - to. */
typedef struct {
  integer from, count, to;
} Run;

/* Runs of the gram of epoch k, or of the step from it (`both`): of each epoch its pose, then its chained errors; then constants and
 * right-hand side. Returns how many. */
static int runs_of(integer k, int both, integer K, integer p, integer v, integer c, Run* run) {
  int runs = 0;
  integer from = 0;
  for (integer f = k; f <= k + both; ++f) {
    run[runs++] = (Run){from, p, f * p};
    run[runs++] = (Run){from + p, v, -1 - f};
    from += p + v;
  }
  run[runs++] = (Run){from, c + 1, K * p};
  return runs;
}

/* Grams of epochs (both = 0, the first `count`) or of steps (both = 1, count = K - 1) into M [kept + 1][kept], lower triangle and
 * right-hand side, and into D, E, G of the chain. Of M's diagonal blocks the upper triangles are added too. */
void add_information_blocks(integer count, integer both, integer K, integer p, integer v, integer c, const double* grams,
               double* M, double* D, double* E, double* G) {
  const integer kept = K * p + c, width = kept + 1, n = (1 + both) * (p + v) + c + 1;
  for (integer k = 0; k < count; ++k, grams += n * n) {
    Run run[5];
    const int runs = runs_of(k, (int)both, K, p, v, c, run);
    /* Block of rows r by columns q: into M where both remain; else, of rows of a chain, into G, D (same epoch) or E (next one). */
    for (int r = 0; r < runs; ++r)
      for (int q = 0; q < runs; ++q) {
        const integer row = run[r].to, column = run[q].to;
        integer pitch = v, columns = run[q].count;
        double* to;
        if (row >= 0) {
          if (column < 0 || column > row) continue;
          to = M + row * kept + column, pitch = kept;
          if (column + columns > kept) columns = kept - column; /* the right-hand side is a row alone */
        } else if (column >= 0) to = G + (-1 - row) * v * width + column, pitch = width;
        else if (column == row) to = D + (-1 - row) * v * v;
        else if (column < row) to = E + (-1 - row) * v * v;
        else continue;
        const double* g = grams + run[r].from * n + run[q].from;
        for (integer i = 0; i < run[r].count; ++i, to += pitch, g += n)
          for (integer j = 0; j < columns; ++j) to[j] += g[j];
      }
  }
}

/* First block of p columns of X that has not faded below `faded` of its largest element so far, counted from `low` on; top is room
 * for a number of every column. */
static integer not_faded(const double* X, double* largest, double* top, double faded, integer v, integer p, integer low, integer last,
                         integer high, integer width) {
  int fading = 1;
  /* largest element of each column */
  for (integer j = low * p; j < high * p; ++j) top[j] = 0;
  for (integer a = 0; a < v; ++a)
    for (integer j = low * p; j < high * p; ++j) {
      const double size = fabs(X[a * width + j]);
      top[j] = size > top[j] ? size : top[j];
    }
  /* block m: its largest element here and so far; blocks are dropped in one unbroken run from `low`, up to before `last` */
  for (integer m = low; m < high; ++m) {
    double most = 0;
    for (integer j = m * p; j < (m + 1) * p; ++j) most = top[j] > most ? top[j] : most;
    if (most > largest[m]) largest[m] = most;
    if (fading && m < last && most <= faded * largest[m]) low = m + 1;
    else fading = 0;
  }
  return low;
}

/* Block-tridiagonal elimination: D [K][v][v], E [K-1][v][v] (row k, column k + 1), G [K][v][width] (its coupling to what
 * remains) in place: G becomes X = L^-1 (G - F' X_before), D becomes L, E becomes F = L^-1 E. The first `blocks` blocks of p
 * columns are poses; row k knows those up to k + 1 and up to `reach`, and forgets those on the left that have faded: begin[k] is
 * the first it feels. Returns the number of a block that is not positive definite plus 1, or 0. */
integer eliminate_velocities(integer K, integer v, integer p, integer blocks, integer width, integer reach, double faded, double* D,
                        double* E, double* G, integer* begin) {
  double *largest = (double*)calloc(blocks * (p + 1) + 1, sizeof(double)), *top = largest + blocks;
  if (largest == 0) return -1;
  integer low = 0, failed = 0, tail = blocks * p;
  /* epoch k forwards: less what epoch k - 1 leaves behind, its root L_k, then its coupling to what remains and to k + 1 */
  for (integer k = 0; k < K; ++k) {
    double *T = D + k * v * v, *X = G + k * v * width;
    integer end = k + 2 > reach ? k + 2 : reach;
    integer last = end < blocks ? end : blocks;
    if (k > 0) {
      const double *F = E + (k - 1) * v * v, *before = X - v * width;
      /* Schur complement of epoch k - 1: D_k -= F' F, G_k -= F' X_k-1, F = F_k-1. */
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
    /* X_k = L_k^-1 G_k by forward substitution, over the columns that are not zero. */
    for (integer a = 0; a < v; ++a) {
      double *x = X + a * width, d = 1 / T[a * v + a];
      for (integer b = 0; b < a; ++b) subtract_row(x, X + b * width, T[a * v + b], low * p, last * p, tail, width);
      for (integer j = low * p; j < last * p; ++j) x[j] *= d;
      for (integer j = tail; j < width; ++j) x[j] *= d;
    }
    if (k + 1 < K) {
      double* e = E + k * v * v;
      /* F_k = L_k^-1 E_k. */
      for (integer a = 0; a < v; ++a) {
        for (integer b = 0; b < a; ++b)
          for (integer j = 0; j < v; ++j) e[a * v + j] -= T[a * v + b] * e[b * v + j];
        for (integer j = 0; j < v; ++j) e[a * v + j] /= T[a * v + a];
      }
    }
    begin[k] = low;
    low = not_faded(X, largest, top, faded, v, p, low, k, last, width);
  }
  free(largest);
  return failed;
}

/* Rows i .. i + rows of M [][n], columns low .. end: M -= X' X, X [v][n + 1]. The numbers of a few rows times two vectors of
 * columns stay in registers over all v. Up to `limit` further columns may be written: they lie above the diagonal, or X is zero. */
static inline __attribute__((always_inline)) void subtract_products(const int rows, integer v, integer n, const double* X, integer i,
                                                                    integer low, integer end, integer limit, double* M) {
  const integer whole = low + (end - low + 2 * LANES - 1) / (2 * LANES) * (2 * LANES);
  if (whole <= limit) end = whole;
  integer j = low;
  double* at = M + i * n;
  /* two vectors of columns at a time: loaded from M, less the products over all v, and stored */
  for (; j + 2 * LANES <= end; j += 2 * LANES) {
    lanes left[TALL], right[TALL];
    for (int r = 0; r < rows; ++r) {
      left[r] = *(const loose*)(at + r * n + j);
      right[r] = *(const loose*)(at + r * n + j + LANES);
    }
    for (integer a = 0; a < v; ++a) {
      const double* x = X + a * (n + 1);
      const lanes x0 = *(const loose*)(x + j), x1 = *(const loose*)(x + j + LANES);
      for (int r = 0; r < rows; ++r) {
        left[r] -= x[i + r] * x0;
        right[r] -= x[i + r] * x1;
      }
    }
    for (int r = 0; r < rows; ++r) {
      *(loose*)(at + r * n + j) = left[r];
      *(loose*)(at + r * n + j + LANES) = right[r];
    }
  }
  /* Columns that fill no two vectors. */
  for (; j < end; ++j)
    for (int r = 0; r < rows; ++r) {
      double sum = 0;
      for (integer a = 0; a < v; ++a) sum += X[a * (n + 1) + i + r] * X[a * (n + 1) + j];
      at[r * n + j] -= sum;
    }
}

/* The same for the rows low .. high of M, each up to its diagonal and no further than n, from column `from` on. */
static void subtract_triangle(integer v, integer n, const double* X, integer low, integer high, integer from, double* M) {
  integer i = low;
  /* some rows at a time, then single ones; a group runs up to the diagonal of its last row */
  for (; i + TALL <= high; i += TALL) subtract_products(TALL, v, n, X, i, from, i + TALL < n ? i + TALL : n, n, M);
  for (; i < high; ++i) subtract_products(1, v, n, X, i, from, i + 1 < n ? i + 1 : n, n, M);
}

enum { AT_ONCE = 4 }; /* epochs whose X are multiplied at once, so that M passes by more seldom */

/* Schur complement of the eliminated velocities on what remains, M [n + 1][n] -= X_k' X_k of every epoch: lower triangle and, in the
 * last row, right-hand side. X_k [v][n + 1] is zero right of its last pose and negligible left of begin[k]; the columns behind the
 * poses, of constants and right-hand side, count in every epoch. See `eliminate_velocities`. */
void reduce_velocities(integer K, integer v, integer p, integer blocks, integer n, integer reach, const integer* begin,
                       const double* X, double* M) {
  const integer tail = blocks * p;
  for (integer k = 0; k < K; k += AT_ONCE) {
    /* X of the next few epochs as one, [rows][n + 1], over the poses that any of them feels. */
    const integer after = k + AT_ONCE < K ? k + AT_ONCE : K, rows = (after - k) * v;
    const integer end = after + 1 > reach ? after + 1 : reach, low = begin[k] * p, high = (end < blocks ? end : blocks) * p;
    subtract_triangle(rows, n, X, low, high, low, M);
    subtract_triangle(rows, n, X, tail, n + 1, tail, M);
    /* Rows of constants and right-hand side by the poses. */
    integer i = tail;
    for (; i + TALL <= n + 1; i += TALL) subtract_products(TALL, rows, n, X, i, low, high, tail, M);
    for (; i <= n; ++i) subtract_products(1, rows, n, X, i, low, high, tail, M);
    X += rows * (n + 1);
  }
}

/* Sum of x_j step_j over the columns low .. high. */
static double product(const double* x, const double* step, integer low, integer high) {
  lanes sums[2] = {{0}, {0}};
  double sum = 0;
  integer j = low;
  for (; j + 2 * LANES <= high; j += 2 * LANES) {
    sums[0] += *(const loose*)(x + j) * *(const loose*)(step + j);
    sums[1] += *(const loose*)(x + j + LANES) * *(const loose*)(step + j + LANES);
  }
  for (; j < high; ++j) sum += x[j] * step[j];
  sums[0] += sums[1];
  for (int l = 0; l < LANES; ++l) sum += sums[0][l];
  return sum;
}

/* Behind a solution of what remains, step [n]: out [K][v] = L_k^-T (y_k - X_k step - F_k out_k+1), X_k [v][n + 1] with y_k as its last
 * column. X_k is zero outside of what `reduce_velocities` takes of it. */
void solve_velocities(integer K, integer v, integer p, integer blocks, integer n, integer reach, const integer* begin,
                      const double* X, const double* L, const double* F, const double* step, double* out) {
  const integer tail = blocks * p;
  /* backwards, as each epoch depends on the one behind it */
  for (integer k = K - 1; k >= 0; --k) {
    const double *T = L + k * v * v, *f = F + k * v * v, *after = out + (k + 1) * v;
    const integer end = k + 2 > reach ? k + 2 : reach, low = begin[k] * p, high = (end < blocks ? end : blocks) * p;
    double* x = out + k * v;
    for (integer a = 0; a < v; ++a) {
      const double* row = X + (k * v + a) * (n + 1);
      x[a] = row[n] - product(row, step, low, high) - product(row, step, tail, n);
    }
    if (k + 1 < K)
      /* less F_k out_k+1 */
      for (integer a = 0; a < v; ++a)
        for (integer b = 0; b < v; ++b) x[a] -= f[a * v + b] * after[b];
    /* Back substitution by L_k'. */
    for (integer a = v - 1; a >= 0; --a) {
      for (integer b = a + 1; b < v; ++b) x[a] -= T[b * v + a] * x[b];
      x[a] /= T[a * v + a];
    }
  }
}

/* Lower triangular root of I + below' below, below [v][v], by Householder's reflections of the rows [I; below]: products would lose
 * what is small compared with the rest. Column j of I is touched at its diagonal alone. */
static void root_beside_unit(integer v, double* below, double* root) {
  memset(root, 0, v * v * sizeof(double));
  /* the upper half of [I; below] is the identity */
  for (integer j = 0; j < v; ++j) root[j * v + j] = 1;
  /* Reflection j of column j of [I; below]; the root is kept transposed, lower triangular. */
  for (integer j = 0; j < v; ++j) {
    double sum = 0;
    for (integer i = 0; i < v; ++i) sum += below[i * v + j] * below[i * v + j];
    double head = root[j * v + j], length = sqrt(head * head + sum), pivot = head + length;
    root[j * v + j] = length;
    if (sum > 0) /* the reflection takes (head, below) to (-length, 0); the sign of a row of the root is free */
      for (integer c = j + 1; c < v; ++c) {
        double along = pivot * root[c * v + j];
        for (integer i = 0; i < v; ++i) along += below[i * v + j] * below[i * v + c];
        along *= 2 / (pivot * pivot + sum);
        root[c * v + j] = along * pivot - root[c * v + j];
        for (integer i = 0; i < v; ++i) below[i * v + c] -= along * below[i * v + j];
      }
  }
}

/* x [v][w] becomes L^-T x, L [v][v] lower triangular. */
static void solve_transposed(integer v, integer w, const double* L, double* x) {
  /* row a from the last: less L_ba x_b of the rows b behind it, then divided by L_aa */
  for (integer a = v - 1; a >= 0; --a) {
    for (integer b = a + 1; b < v; ++b)
      for (integer j = 0; j < w; ++j) x[a * w + j] -= L[b * v + a] * x[b * w + j];
    for (integer j = 0; j < w; ++j) x[a * w + j] /= L[a * v + a];
  }
}

/* Covariances along an eliminated chain, backwards: how its errors follow what remains, follow [K][v][r] = -L_k^-T (X_k + F_k
 * follow_k+1) of coupling X [K][v][r + 1], and roots own [K][v][v] of their own part, L_k^-T root(I + F_k own_k+1 own_k+1' F_k').
 * Returns 1 where there is no memory. */
int chained_covariances(integer K, integer v, integer r, const double* L, const double* F, const double* X, double* follow,
                        double* own) {
  double* below = (double*)malloc(v * v * sizeof(double) + 1);
  if (below == 0) return 1;
  /* epochs backwards: k depends on what remains, directly by X_k and through epoch k + 1 by F_k */
  for (integer k = K - 1; k >= 0; --k) {
    const double *T = L + k * v * v, *f = F + k * v * v;
    double *here = follow + k * v * r, *root = own + k * v * v;
    const double *there = here + v * r, *after = root + v * v;
    memset(below, 0, v * v * sizeof(double));
    /* follow_k starts as -X_k without the right-hand side (width r + 1). */
    for (integer a = 0; a < v; ++a)
      for (integer j = 0; j < r; ++j) here[a * r + j] = -X[(k * v + a) * (r + 1) + j];
    if (k + 1 < K)
      /* follow_k -= F_k follow_k+1; below = (F_k own_k+1)'. */
      for (integer a = 0; a < v; ++a)
        for (integer b = 0; b < v; ++b) {
          for (integer j = 0; j < r; ++j) here[a * r + j] -= f[a * v + b] * there[b * r + j];
          for (integer j = 0; j < v; ++j) below[j * v + a] += f[a * v + b] * after[b * v + j];
        }
    root_beside_unit(v, below, root);
    solve_transposed(v, r, T, here);
    solve_transposed(v, v, T, root);
  }
  free(below);
  return 0;
}
