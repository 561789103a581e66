/* Small matrices, row by row, and copies; for the files of the filter alone. */
#ifndef SPINFILTER_MATRIX_H
#define SPINFILTER_MATRIX_H

#include "spinfilter_arithmetic.h"

/* Word by word: a library's memcpy may go byte by byte. */
static inline void sf_copy(sf_real *to, const sf_real *from, int count)
{
  /* in order, so that `to` may be `from` itself, as where a filter stays what it was */
  for (int k = 0; k < count; ++k) to[k] = from[k];
}

static inline void sf_clear(sf_real *to, int count)
{
  /* any shape: its entries are adjacent */
  for (int k = 0; k < count; ++k) to[k] = SF_R(0.0);
}

/* out = a b, of 3 x 3 and 3 x columns */
static inline void sf_multiply3(const sf_real *a, const sf_real *b, int columns, sf_real *out)
{
  /* entry (i, j): row i of a times column j of b, its three products written out */
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < columns; ++j)
      out[i * columns + j] = a[3 * i] * b[j] + a[3 * i + 1] * b[columns + j] + a[3 * i + 2] * b[2 * columns + j];
}

/* out += a b */
static inline void sf_add_multiply3(const sf_real *a, const sf_real *b, int columns, sf_real *out)
{
  /* entry (i, j), added: row i of a times column j of b */
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < columns; ++j)
      out[i * columns + j] += a[3 * i] * b[j] + a[3 * i + 1] * b[columns + j] + a[3 * i + 2] * b[2 * columns + j];
}

/* out = a b', 3 x 3 */
static inline void sf_multiply3_transposed(const sf_real *a, const sf_real *b, sf_real *out)
{
  /* entry (i, j): row i of a times row j of b */
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j)
      out[3 * i + j] = a[3 * i] * b[3 * j] + a[3 * i + 1] * b[3 * j + 1] + a[3 * i + 2] * b[3 * j + 2];
}

/* out = a' b, of 3 x 3 and 3 x columns */
static inline void sf_transposed_multiply3(const sf_real *a, const sf_real *b, int columns, sf_real *out)
{
  /* entry (i, j): column i of a times column j of b */
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < columns; ++j)
      out[i * columns + j] = a[i] * b[j] + a[3 + i] * b[columns + j] + a[6 + i] * b[2 * columns + j];
}

static inline void sf_cross(const sf_real *a, const sf_real *b, sf_real *out)
{
  out[0] = a[1] * b[2] - a[2] * b[1];
  out[1] = a[2] * b[0] - a[0] * b[2];
  out[2] = a[0] * b[1] - a[1] * b[0];
}

/* Lower Cholesky factor of a lower triangle, with the inverse of its diagonal there; 0 where it is not positive definite. */
static inline int sf_factor3(const sf_real *s, sf_real *root)
{
  const int good = s[0] > SF_R(0.0);
  root[0] = SF_R(1.0) / SF_SQRT(good ? s[0] : SF_R(1.0));
  root[3] = s[3] * root[0];
  root[6] = s[6] * root[0];
  const sf_real second = s[4] - root[3] * root[3];
  const int better = second > SF_R(0.0);
  root[4] = SF_R(1.0) / SF_SQRT(better ? second : SF_R(1.0));
  root[7] = (s[7] - root[6] * root[3]) * root[4];
  const sf_real third = s[8] - root[6] * root[6] - root[7] * root[7];
  const int best = third > SF_R(0.0);
  root[8] = SF_R(1.0) / SF_SQRT(best ? third : SF_R(1.0));
  return good & better & best;
}

/* right <- root^-1 right, of such a factor */
static inline void sf_forward3(const sf_real *root, sf_real *right, int columns)
{
  /* column k by forward substitution; the diagonal of root holds inverses, so nothing is divided */
  for (int k = 0; k < columns; ++k) {
    right[k] *= root[0];
    right[columns + k] = (right[columns + k] - root[3] * right[k]) * root[4];
    right[2 * columns + k] = (right[2 * columns + k] - root[6] * right[k] - root[7] * right[columns + k]) * root[8];
  }
}

/* lower triangle += a a', of 3 x columns, into 3 x 3 */
static inline void sf_add_squared(const sf_real *a, int columns, sf_real *lower)
{
  /* entry (i, j <= i): row i of a times row j of a; what lies above the diagonal stays */
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j <= i; ++j)
      for (int k = 0; k < columns; ++k) lower[3 * i + j] += a[i * columns + k] * a[j * columns + k];
}

#endif
