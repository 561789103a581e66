/* Root of a large matrix, blocks of columns after one another; types are those of `kernels.h`. */

enum { DEEP = 64, WIDE = 2 * LANES }; /* columns of a block, and of a tile in registers */

/* C [TALL][WIDE] in rows of pitch -= sum over k < depth of A_k' B_k, A_k [TALL] and B_k [WIDE] each the next row of a strip. */
static inline __attribute__((always_inline)) void subtract_tile(integer depth, const double* A, const double* B, integer pitch,
                                                                double* C) {
  lanes left[TALL], right[TALL];
  for (int r = 0; r < TALL; ++r) {
    left[r] = *(const loose*)(C + r * pitch);
    right[r] = *(const loose*)(C + r * pitch + LANES);
  }
  for (integer k = 0; k < depth; ++k, A += WIDE, B += WIDE) {
    const lanes b0 = *(const lanes*)B, b1 = *(const lanes*)(B + LANES);
    for (int r = 0; r < TALL; ++r) {
      left[r] -= A[r] * b0;
      right[r] -= A[r] * b1;
    }
  }
  for (int r = 0; r < TALL; ++r) {
    *(loose*)(C + r * pitch) = left[r];
    *(loose*)(C + r * pitch + LANES) = right[r];
  }
}

/* Rows m .. m + TALL of a strip [DEEP][WIDE], less the products of the rows before and divided by the root of the block's own
 * rows, which begin at `own`; out holds 1 / diagonal. With `diagonal` the strip is that of these rows, and their root is made here: of
 * so many rows at most, for those that fill up the tile are none and become zero. Returns the number of a row whose pivot is not
 * positive and finite plus 1, or 0. */
static inline int solve_strip(integer m, const double* own, int diagonal, double* strip, double* out) {
  subtract_tile(m, own, strip, WIDE, strip + m * WIDE);
  double* x = strip + m * WIDE;
  const double* T = own + m * WIDE;
  /* row q less those before it; T [p][q] = L_qp of this tile, p < q */
  for (int q = 0; q < TALL; ++q) {
    lanes x0 = *(const lanes*)(x + q * WIDE), x1 = *(const lanes*)(x + q * WIDE + LANES);
    for (int p = 0; p < q; ++p) {
      x0 -= T[p * WIDE + q] * *(const lanes*)(x + p * WIDE);
      x1 -= T[p * WIDE + q] * *(const lanes*)(x + p * WIDE + LANES);
    }
    if (diagonal) {
      *(lanes*)(x + q * WIDE) = x0;
      *(lanes*)(x + q * WIDE + LANES) = x1;
      const double pivot = T[q * WIDE + q];
      if (q < diagonal && !(pivot > 0 && pivot < INFINITY)) return q + 1;
      out[q] = q < diagonal ? 1 / sqrt(pivot) : 0;
    }
    *(lanes*)(x + q * WIDE) = out[q] * x0;
    *(lanes*)(x + q * WIDE + LANES) = out[q] * x1;
  }
  return 0;
}

/* Strips of columns first .. of M, transposed: row i of M is a column of strip (i - first) / WIDE. Zero above the diagonal, behind
 * the last row, and behind the last column of the last block. */
static void take_strips(integer rows, integer n, integer first, integer columns, integer strips, const double* M, double* strip) {
  const integer deep = columns < DEEP ? (columns + TALL - 1) / TALL * TALL : DEEP;
  for (integer i = 0; i < strips * WIDE; ++i) {
    double* to = strip + i / WIDE * DEEP * WIDE + i % WIDE;
    const double* from = M + (first + i) * n + first;
    const integer known = first + i >= rows ? 0 : i + 1 < columns ? i + 1 : columns;
    for (integer k = 0; k < known; ++k) to[k * WIDE] = from[k];
    for (integer k = known; k < deep; ++k) to[k * WIDE] = 0;
  }
}

/* M [rows][n], rows >= n: its first n rows, a lower triangle, become their lower root L, and each row behind them r becomes
 * L^-1 r. What lies above the diagonal is overwritten. Returns the number of a row that is not positive definite plus 1, 0, or -1
 * where there is no memory. */
integer root_of_rows(integer rows, integer n, double* M) {
  const integer most = (rows + WIDE - 1) / WIDE + 1;
  void* raw = malloc(most * DEEP * WIDE * sizeof(double) + 64);
  if (raw == 0) return -1;
  double *all = (double*)(((size_t)raw + 63) & ~(size_t)63), out[DEEP];
  for (integer first = 0; first < n; first += DEEP) {
    const integer columns = n - first < DEEP ? n - first : DEEP, deep = (columns + TALL - 1) / TALL * TALL;
    const integer strips = ((rows - first > deep ? rows - first : deep) + WIDE - 1) / WIDE, size = DEEP * WIDE;
    take_strips(rows, n, first, columns, strips, M, all);
    /* The block's own strips, whose roots the others need, then the others. The last block may end within a strip, or its further
     * rows may lie in it: they are solved with it. */
    const integer inner = (deep + WIDE - 1) / WIDE;
    for (integer m = 0; m < deep; m += TALL) {
      const double* own = all + m / WIDE * size + m % WIDE;
      const int failed = solve_strip(m, own, (int)(columns - m), all + m / WIDE * size, out + m);
      if (failed) {
        free(raw);
        return first + m + failed;
      }
      for (integer s = m / WIDE + 1; s < inner; ++s) solve_strip(m, own, 0, all + s * size, out + m);
    }
    for (integer s = inner; s < strips; ++s)
      for (integer m = 0; m < deep; m += TALL) solve_strip(m, all + m / WIDE * size + m % WIDE, 0, all + s * size, out + m);
    /* Back to M. */
    for (integer i = 0; first + i < rows; ++i) {
      const double* from = all + i / WIDE * size + i % WIDE;
      double* to = M + (first + i) * n + first;
      for (integer k = 0; k < columns && k <= i; ++k) to[k] = from[k * WIDE];
    }
    /* What is behind the block, less its products: strips of columns, and of each the rows from its first one on. */
    for (integer s = DEEP / WIDE; first + s * WIDE < n; ++s)
      for (integer i = s * WIDE; first + i < rows; i += TALL) {
        const integer row = first + i, column = first + s * WIDE;
        const double* own = all + i / WIDE * size + i % WIDE;
        double* to = M + row * n + column;
        if (row + TALL <= rows && column + WIDE <= n) {
          subtract_tile(DEEP, own, all + s * size, n, to);
          continue;
        }
        /* a tile at the edge, by a copy */
        lanes room[TALL * 2] = {{0}};
        double* tile = (double*)room;
        const integer high = rows - row < TALL ? rows - row : TALL, wide = n - column < WIDE ? n - column : WIDE;
        for (integer r = 0; r < high; ++r) memcpy(tile + r * WIDE, to + r * n, wide * sizeof(double));
        subtract_tile(DEEP, own, all + s * size, WIDE, tile);
        for (integer r = 0; r < high; ++r) memcpy(to + r * n, tile + r * WIDE, wide * sizeof(double));
      }
  }
  free(raw);
  return 0;
}
