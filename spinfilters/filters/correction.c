/* The square-root update that compiled filters share; `square_root.py` says what it computes. C columns of the state that an
 * observation depends on, M further ones, N rows of the largest factor, and LANES are defined in front of this text. Matrices are
 * row by row. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

typedef long long integer;
static const double TINY = 1e-280; /* a sum of squares that counts as zero: the inverse of a smaller one may be none */
enum { ALIGNMENT = 8 * LANES, Q = C + M, W = Q + 1 };
typedef double lane __attribute__((vector_size(ALIGNMENT), may_alias));
typedef lane loose __attribute__((aligned(8)));
typedef integer mask __attribute__((vector_size(ALIGNMENT), may_alias));

/* The loop of a `Vectorised` function. */
typedef void Sighted(integer count, const double* const* from, const integer* pitch, const integer* const* rows, double* const* to);

/* Numbers of item i of a group, in and out of its lanes. */
#define TAKE(FROM, COUNT, I, TO) \
  for (int p_ = 0; p_ < (COUNT); ++p_) ((double*)(TO))[p_ * LANES + (I)] = (FROM)[p_]
#define PUT(FROM, COUNT, I, TO, KIND) \
  for (int p_ = 0; p_ < (COUNT); ++p_) (TO)[p_] = (KIND)((const double*)(FROM))[p_ * LANES + (I)]

/* Householder reflections take columns `first` to `last` of `count` rows into the upper triangle R; what lies left
 * of `from` is zero. Each reflection finds the products of the next column on its way. All lengths are known to the compiler. */
static inline __attribute__((always_inline)) void absorb_columns(double* restrict R, double* restrict rows, int count, int first,
                                                                 int last, const int from, const int pitch) {
  enum { MOST = 128 / LANES };
  const int lanes = (pitch - from) / LANES;
  lane sum[MOST] = {{0}};
  /* Products of the first column with all columns of the rows: sum = rows[:, first]' rows. */
  for (int i = 0; i < count && first < last; ++i) {
    const lane* row = (const lane*)(rows + i * pitch + from);
    const double v = rows[i * pitch + first];
    for (int k = 0; k < lanes; ++k) sum[k] += v * row[k];
  }
  /* Reflection j takes (R[j][j], rows[:, j]) to (-+length, 0); sum holds rows[:, j]' rows. Top row: R[j] -= head step. */
  for (int j = first; j < last; ++j) {
    lane *top = (lane*)(R + j * pitch + from), step[MOST], next[MOST] = {{0}};
    const double square = ((const double*)sum)[j - from], old = R[j * pitch + j];
    const double length = sqrt(old * old + square), head = old > 0 ? old + length : old - length;
    const double scale = square < TINY ? 0 : 2 / (head * head + square);
    for (int k = 0; k < lanes; ++k) {
      step[k] = scale * (head * top[k] + sum[k]);
      top[k] -= head * step[k];
    }
    const int beside = j + 1 < last ? j + 1 : j;
    /* Rows below: rows -= rows[:, j] step; the products of column j + 1 are summed up in the same pass. */
    for (int i = 0; i < count; ++i) {
      lane* row = (lane*)(rows + i * pitch + from);
      const double v = rows[i * pitch + j];
      for (int k = 0; k < lanes; ++k) row[k] -= v * step[k];
      const double w = rows[i * pitch + beside];
      for (int k = 0; k < lanes; ++k) next[k] += w * row[k];
    }
    for (int k = 0; k < lanes; ++k) sum[k] = next[k];
  }
}

#define FROM(START, PITCH) \
  if (PITCH > START) absorb_columns(R, rows, count, START, n < START + 8 || PITCH <= START + 8 ? n : START + 8, START, PITCH)
#define ABSORB(NAME, PITCH)                                                       \
  static void NAME(double* restrict R, double* restrict rows, int count, int n) { \
    FROM(0, PITCH);                                                               \
    FROM(8, PITCH);                                                               \
    FROM(16, PITCH);                                                              \
    if (PITCH > 24) absorb_columns(R, rows, count, 24, n, 24, PITCH);             \
  }
enum { WP = (W + 7) / 8 * 8, NP = (N + 8) / 8 * 8 };
ABSORB(absorb_rows, WP)
ABSORB(absorb_factor, NP)

/* Rows of the factor times the inverse of the root U, and with them the error that the shift makes. */
static void divide(int size, const double* U, const double* shift, double* factor, double* error) {
  for (int first = 0; first < size; first += LANES) {
    const int some = size - first < LANES ? size - first : LANES;
    lane X[N], sum = {0};
    for (int i = 0; i < LANES; ++i) TAKE(factor + (first + (i < some ? i : 0)) * size, size, i, X);
    /* Forward substitution X U = factor, column by column, LANES rows at once; error = X shift. */
    for (int j = 0; j < size; ++j) {
      const double* u = U + j * NP;
      X[j] *= 1 / u[j];
      sum += X[j] * shift[j];
      for (int k = j + 1; k < size; ++k) X[k] -= X[j] * u[k];
    }
    for (int i = 0; i < some; ++i) {
      PUT(X, size, i, factor + (first + i) * size, double);
      error[first + i] = ((double*)&sum)[i];
    }
  }
}

/* The correction by rows, the innovation behind each, that `absorb_rows` has taken into R [W][WP]: factor [n][n] is replaced by
 * that after the update; returns the normalised innovation squared. root [n][n] upper triangular, shift [n] and behind it the
 * log determinant of the root, error [n]. */
static double correct_rows(const double* R, integer n, const integer* columns, double* factor, double* root, double* shift,
                           double* error) {
  double U[N * NP] __attribute__((aligned(ALIGNMENT))) = {0}, Y[Q * NP] __attribute__((aligned(ALIGNMENT))) = {0};
  double nis = R[Q * WP + Q] * R[Q * WP + Q];
  int size = (int)n;
  for (int j = 0; j < size; ++j) U[j * NP + j] = 1;
  /* Y = [R_c factor[columns] | rho]: the Q compressed rows in the coordinates of the factor, innovation behind them. */
  for (int a = 0; a < Q; ++a) {
    for (int b = a; b < Q; ++b) {
      const double s = R[a * WP + b], *row = factor + columns[b] * n;
      for (int k = 0; k < size; ++k) Y[a * NP + k] += s * row[k];
    }
    Y[a * NP + size] = R[a * WP + Q];
  }
  /* U'U = I + Y'Y by reflections of [I; Y]; column `size` of U becomes the shift U y, of Y what no state explains. */
  absorb_factor(U, Y, Q, size);
  for (int a = 0; a < Q; ++a) nis += Y[a * NP + size] * Y[a * NP + size];
  shift[size] = 0;
  /* Root U [n][n], shift, and log |det U| out of the padded rows. */
  for (int j = 0; j < size; ++j) {
    const double* u = U + j * NP;
    shift[size] += log(fabs(u[j]));
    memcpy(root + j * n, u, size * sizeof(double));
    shift[j] = u[size];
  }
  divide(size, U, shift, factor, error);
  return nis;
}
