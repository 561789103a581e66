/* The reset after an update: the error goes into the state, and the covariance along with it. */
#include "spinfilter_internal.h"
#include "spinfilter_model.h"

#define BLOCK 5 /* components of the largest block that a reset transforms */

/* b <- A^-1 b, A = I + a: Gauss without pivots, a is small; a is lost. */
static void solve_near_identity(sf_real (*a)[BLOCK], sf_real (*b)[BLOCK], int n)
{
  /* elimination: pivot 1 + a_kk, and its row off the rows below, in a right of the pivot and in all of b */
  for (int k = 0; k < n; ++k) {
    const sf_real inverse = SF_R(1.0) / (SF_R(1.0) + a[k][k]);
    for (int i = k + 1; i < n; ++i) {
      const sf_real share = a[i][k] * inverse;
      for (int j = k + 1; j < n; ++j) a[i][j] -= share * a[k][j];
      for (int j = 0; j < n; ++j) b[i][j] -= share * b[k][j];
    }
  }
  /* back substitution, last row first: b_k = (b_k - sum over i > k of a_ki b_i) / (1 + a_kk) */
  for (int k = n - 1; k >= 0; --k) {
    const sf_real inverse = SF_R(1.0) / (SF_R(1.0) + a[k][k]);
    for (int j = 0; j < n; ++j) {
      sf_real sum = b[k][j];
      for (int i = k + 1; i < n; ++i) sum -= a[k][i] * b[i][j];
      b[k][j] = sum * inverse;
    }
  }
}

/* at += matrix at */
static void add_transformed(sf_real *at, const sf_real *matrix, int size)
{
  sf_real moved[BLOCK];
  /* moved = matrix at, apart, because each of its rows reads all of `at` */
  for (int i = 0; i < size; ++i) {
    moved[i] = SF_R(0.0);
    for (int k = 0; k < size; ++k) moved[i] += matrix[i * size + k] * at[k];
  }
  for (int i = 0; i < size; ++i) at[i] += moved[i]; /* the sum, once all is read */
}

/* D + b D + D b' + b D b' = (I + v) D' (I + v)', v strictly upper triangular; d becomes D'. */
static void factor_near_diagonal(sf_real (*b)[BLOCK], sf_real *d, sf_real (*v)[BLOCK], int n)
{
  sf_real s[BLOCK][BLOCK];
  /* s = b D + D b' + b D b', upper triangle: the change of D alone, so that nothing of D's size is rounded */
  for (int i = 0; i < n; ++i)
    for (int j = 0; j <= i; ++j) {
      s[j][i] = b[i][j] * d[j] + b[j][i] * d[i];
      for (int k = 0; k < n; ++k) s[j][i] += b[i][k] * d[k] * b[j][k];
    }
  /* backward Cholesky of D + s, last column first: pivot D'_j, column j of v, and its share off the columns before */
  for (int j = n - 1; j >= 0; --j) {
    d[j] += s[j][j];
    const sf_real inverse = SF_R(1.0) / d[j];
    for (int i = 0; i < n; ++i) v[i][j] = i < j ? s[i][j] * inverse : SF_R(0.0);
    for (int k = 0; k < j; ++k)
      for (int i = 0; i <= k; ++i) s[i][k] -= v[i][j] * d[j] * v[k][j];
  }
}

/* Rows [first, first + size) of U are multiplied by I + e, and the columns there made triangular again.
 *
 * Of that block's U: (I + e) U = U (I + b), and (I + b) D (I + b)' = (I + v) D' (I + v)'. So U becomes U (I + v), and what
 * stands above it is multiplied by (I + b)^-1 (I + v). All of e, b, v is small; what does not change is not rounded. */
static void reset_block(sf_filter *f, int first, int size, const sf_real *e)
{
  sf_real b[BLOCK][BLOCK], v[BLOCK][BLOCK], c[BLOCK][BLOCK];
  /* columns right of the block, in its rows: U becomes (I + e) U */
  for (int j = first + size; j < SF_N; ++j) add_transformed(SF_COLUMN(f->u, j) + first, e, size);
  for (int j = 0; j < size; ++j) { /* b = U^-1 e U */
    const sf_real *column = SF_COLUMN(f->u, first + j) + first;
    for (int i = 0; i < size; ++i) {
      b[i][j] = e[i * size + j];
      for (int k = 0; k < j; ++k) b[i][j] += e[i * size + k] * column[k];
    }
    for (int i = size - 1; i >= 0; --i)
      for (int k = i + 1; k < size; ++k) b[i][j] -= SF_COLUMN(f->u, first + k)[first + i] * b[k][j];
  }
  factor_near_diagonal(b, f->d + first, v, size);
  /* c = (I + b)^-1 (v - b), which is (I + b)^-1 (I + v) - I: small, as b and v are */
  for (int i = 0; i < size; ++i)
    for (int j = 0; j < size; ++j) c[i][j] = v[i][j] - b[i][j];
  solve_near_identity(b, c, size);
  for (int i = 0; i < first; ++i) { /* above: T += T c */
    sf_real row[BLOCK];
    for (int k = 0; k < size; ++k) row[k] = SF_COLUMN(f->u, first + k)[i];
    for (int j = 0; j < size; ++j) {
      sf_real sum = SF_R(0.0);
      for (int k = 0; k < size; ++k) sum += row[k] * c[k][j];
      SF_COLUMN(f->u, first + j)[i] = row[j] + sum;
    }
  }
  for (int j = size - 1; j > 0; --j) /* U += U v, the last column first: it needs those before it */
    for (int i = 0; i < j; ++i) {
      sf_real sum = v[i][j];
      for (int k = i + 1; k < j; ++k) sum += SF_COLUMN(f->u, first + k)[first + i] * v[k][j];
      SF_COLUMN(f->u, first + j)[first + i] += sum;
    }
}

/* Fold the error into the state; the covariance moves with the derivative of that reset. */
void sf_reset(sf_filter *f, const sf_correction *c)
{
  sf_real after[SF_NX], moved_a[9], moved_s[25];
  sf_model_correction(f->x, c->error, after, moved_a, moved_s);
  sf_copy(f->x, after, SF_NX);
  reset_block(f, SF_A, 3, moved_a);
  reset_block(f, SF_S, 5, moved_s);
}
