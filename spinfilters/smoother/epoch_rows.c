/* Rows of measurements epoch by epoch, for `epoch_rows.py`; types are those of `kernels.h`. Lines begin[k] .. begin[k + 1] are those of
 * epoch k, each [J | y] of c numbers and a last one. */

enum { WIDEST = 3 }; /* vectors of a line; longer ones are left to the caller */

/* Lines [J | y] of the measurements begin .. end from innovations y and Jacobians J [c], i lines each: divided by their component's scale,
 * if any, and times the measurement's weight. Those without a weight are zero, whatever they are. */
static inline __attribute__((always_inline)) void weigh_lines(integer begin, integer end, integer i, integer c, const double* innovation,
                                                              const double* jacobian, const double* scale, const double* weight,
                                                              double* rows) {
  const double *J = jacobian + begin * i * c, *y = innovation + begin * i;
  double* line = rows + begin * i * (c + 1);
  for (integer r = begin; r < end; ++r)
    for (integer n = 0; n < i; ++n, J += c, ++y, line += c + 1) {
      const double w = scale ? weight[r] / scale[n] : weight[r];
      for (integer a = 0; a < c; ++a) line[a] = w == 0 ? 0 : J[a] * w;
      line[c] = w == 0 ? 0 : *y * w;
    }
}

/* gram [w][w] = sum of line' line over some lines of w numbers, at most `vectors` vectors. What a vector holds behind its line is not
 * used; of a line beyond `last`, whose vectors would reach behind the rows, a copy is loaded. */
static inline __attribute__((always_inline)) void add_products(const int vectors, const integer w, integer lines, const double* line,
                                                               const double* last, double* gram) {
  lanes sum[WIDEST * LANES][WIDEST], v[WIDEST];
  for (integer a = 0; a < w; ++a)
    for (int j = 0; j < vectors; ++j) sum[a][j] = (lanes){0};
  for (integer n = 0; n < lines; ++n, line += w) {
    if (line > last)
      memcpy(memset(v, 0, sizeof v), line, w * sizeof(double));
    else
      for (int j = 0; j < vectors; ++j) v[j] = *(const loose*)(line + j * LANES);
    for (integer a = 0; a < w; ++a)
      for (int j = 0; j < vectors; ++j) sum[a][j] += line[a] * v[j];
  }
  for (integer a = 0; a < w; ++a) memcpy(gram + a * w, sum[a], w * sizeof(double));
}

/* The same of lines of seven numbers, those of poses, whose sums stay in registers. */
static void add_products_of_poses(integer lines, const double* line, const double* last, double* gram) {
  enum { W = 7, VECTORS = (W + LANES - 1) / LANES };
  lanes sum[W][VECTORS] = {{{0}}}, v[VECTORS];
  integer n = 0;
  for (; n < lines && line <= last; ++n, line += W) {
    for (int j = 0; j < VECTORS; ++j) v[j] = *(const loose*)(line + j * LANES);
    for (int a = 0; a < W; ++a)
      for (int j = 0; j < VECTORS; ++j) sum[a][j] += line[a] * v[j];
  }
  for (int a = 0; a < W; ++a) memcpy(gram + a * W, sum[a], W * sizeof(double));
  for (; n < lines; ++n, line += W)
    for (int a = 0; a < W; ++a)
      for (int b = 0; b < W; ++b) gram[a * W + b] += line[a] * line[b];
}

/* gram [w][w] = [J | y]'[J | y] of the lines begin .. end, w = c + 1. */
static void products_of_lines(integer begin, integer end, integer w, const double* rows, const double* last, double* gram) {
  const double* line = rows + begin * w;
  if (w == 7)
    add_products_of_poses(end - begin, line, last, gram);
  else if (w <= LANES)
    add_products(1, w, end - begin, line, last, gram);
  else if (w <= 2 * LANES)
    add_products(2, w, end - begin, line, last, gram);
  else
    add_products(3, w, end - begin, line, last, gram);
}

/* The last line whose vectors lie within rows of so many lines. */
static const double* last_line(integer lines, integer w, const double* rows) {
  const integer vectors = (w + LANES - 1) / LANES;
  return rows + lines * w - vectors * LANES;
}

/* Products of each epoch, gram [epochs][w][w]. */
void row_products(integer epochs, const integer* begin, integer w, const double* rows, double* gram) {
  const double* last = last_line(begin[epochs], w, rows);
  for (integer k = 0; k < epochs; ++k) products_of_lines(begin[k], begin[k + 1], w, rows, last, gram + k * w * w);
}

/* Lines of measurements and their products, epoch by epoch, while they are at hand. */
void weigh_rows(integer epochs, const integer* begin, integer i, integer c, const double* innovation, const double* jacobian,
                const double* scale, const double* weight, double* rows, double* gram) {
  const integer w = c + 1;
  const double* last = last_line(begin[epochs], w, rows);
  for (integer k = 0; k < epochs; ++k) {
    const integer from = begin[k] / i, to = begin[k + 1] / i;
    if (c == 6)
      weigh_lines(from, to, i, 6, innovation, jacobian, scale, weight, rows);
    else
      weigh_lines(from, to, i, c, innovation, jacobian, scale, weight, rows);
    products_of_lines(begin[k], begin[k + 1], w, rows, last, gram + k * w * w);
  }
}

/* J P J' of every line of poses, P [epochs][6][6] symmetric: its columns lie in vectors. */
static void variances_of_poses(integer begin, integer end, const double* rows, const double* P, double* made) {
  enum { C = 6, VECTORS = (C + LANES - 1) / LANES };
  lanes column[C][VECTORS] = {{{0}}}, across[VECTORS];
  for (int b = 0; b < C; ++b) memcpy(column[b], P + b * C, C * sizeof(double));
  for (integer n = begin; n < end; ++n) {
    const double* J = rows + n * (C + 1);
    for (int j = 0; j < VECTORS; ++j) across[j] = J[0] * column[0][j];
    for (int b = 1; b < C; ++b)
      for (int j = 0; j < VECTORS; ++j) across[j] += J[b] * column[b][j];
    double sum = 0;
    for (int a = 0; a < C; ++a) sum += across[a / LANES][a % LANES] * J[a];
    made[n] = sum;
  }
}

/* J P J' of every line, P [epochs][c][c] that of its epoch, symmetric: made [lines]. */
void row_variances(integer epochs, const integer* begin, integer c, const double* rows, const double* P, double* made) {
  for (integer k = 0; k < epochs; ++k, P += c * c) {
    if (c == 6) {
      variances_of_poses(begin[k], begin[k + 1], rows, P, made);
      continue;
    }
    for (integer n = begin[k]; n < begin[k + 1]; ++n) {
      const double* J = rows + n * (c + 1);
      made[n] = 0;
      for (integer a = 0; a < c; ++a)
        for (integer b = 0; b < c; ++b) made[n] += J[a] * P[a * c + b] * J[b];
    }
  }
}
