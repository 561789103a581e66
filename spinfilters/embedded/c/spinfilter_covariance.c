/* Covariance U D U': begin, read, and take in a scalar measurement (Bierman 1977). */
#include "spinfilter_internal.h"

void sf_copy_filter(sf_filter *to, const sf_filter *from)
{
  sf_copy(to->x, from->x, SF_NX);
  sf_copy(to->u, from->u, SF_N * (SF_N - 1) / 2);
  sf_copy(to->d, from->d, SF_N);
  sf_copy(to->psd, from->psd, 2);
  to->nis = from->nis;
  to->dof = from->dof;
  to->used = from->used;
  to->refused = from->refused;
}

static sf_real variance(const sf_filter *f, int i) /* row i of U D U' */
{
  sf_real sum = f->d[i];
  /* d_i + sum over k > i of U_ik^2 d_k: U is unit upper triangular */
  for (int k = i + 1; k < SF_N; ++k) sum += SF_COLUMN(f->u, k)[i] * SF_COLUMN(f->u, k)[i] * f->d[k];
  return sum;
}

int sf_is_finite(const sf_filter *f)
{
  int good = 1;
  /* x - x is zero of finite numbers alone */
  for (int k = 0; k < SF_NX; ++k) good &= f->x[k] - f->x[k] == SF_R(0.0);
  /* every entry of D is positive, and every variance finite */
  for (int k = 0; k < SF_N; ++k) {
    const sf_real total = variance(f, k); /* beyond the numbers before D and U are: of a place whose velocity is vague */
    good &= f->d[k] > SF_R(0.0) && total - total == SF_R(0.0);
  }
  return good;
}

void sf_update_scalar(sf_filter *f, sf_correction *c, const sf_real *row, sf_real residual)
{
  sf_real slope[SF_N], gain[SF_N];
  sf_real alpha = SF_R(1.0);
  /* innovation less what the error estimated so far explains: residual - row error */
  for (int k = 0; k < SF_SEEN_COUNT; ++k) residual -= row[k] * c->error[SF_SEEN + k];
  /* slope = U' row: column j of U has entries above its diagonal, in the rows that are measured, and a unit diagonal */
  for (int j = 0; j < SF_N; ++j) {
    const sf_real *column = SF_COLUMN(f->u, j) + SF_SEEN;
    const int above = j < SF_SEEN ? 0 : (j - SF_SEEN < SF_SEEN_COUNT ? j - SF_SEEN : SF_SEEN_COUNT);
    sf_real sum = above < SF_SEEN_COUNT && j >= SF_SEEN ? row[above] : SF_R(0.0);
    for (int k = 0; k < above; ++k) sum += column[k] * row[k];
    slope[j] = sum;
  }
  /* Bierman's update, columns from the left: D_j *= alpha before / alpha, U_j += lambda gain; gain sums up U D slope of the
   * old U */
  for (int j = 0; j < SF_N; ++j) {
    sf_real *column = SF_COLUMN(f->u, j);
    const sf_real v = f->d[j] * slope[j], before = alpha;
    alpha += v * slope[j];
    const sf_real lambda = -slope[j] / before;
    f->d[j] *= before / alpha;
    for (int i = 0; i < j; ++i) {
      const sf_real entry = column[i];
      column[i] = entry + lambda * gain[i];
      gain[i] += v * entry;
    }
    gain[j] = v;
  }
  const sf_real scaled = residual / alpha;
  /* error += K residual with the Kalman gain K = U D slope / alpha; alpha is the variance of the residual */
  for (int j = 0; j < SF_N; ++j) c->error[j] += gain[j] * scaled;
  c->nis += residual * scaled;
}

int sf_begin(sf_filter *f, const sf_real *x, const sf_real *covariance, sf_real force_psd, sf_real torque_psd)
{
  f->nis = SF_R(0.0);
  f->dof = f->used = f->refused = 0;
  sf_copy(f->x, x, SF_NX);
  f->psd[0] = force_psd;
  f->psd[1] = torque_psd;
  for (int j = SF_N - 1; j >= 0; --j) { /* backward Cholesky: the last row first */
    sf_real pivot = covariance[j * SF_N + j];
    for (int k = j + 1; k < SF_N; ++k) pivot -= SF_COLUMN(f->u, k)[j] * SF_COLUMN(f->u, k)[j] * f->d[k];
    f->d[j] = pivot;
    /* column j above its pivot: U_ij = (P_ij - sum over k > j of U_ik U_jk d_k) / d_j */
    for (int i = 0; i < j; ++i) {
      sf_real entry = covariance[i * SF_N + j];
      for (int k = j + 1; k < SF_N; ++k) entry -= SF_COLUMN(f->u, k)[i] * SF_COLUMN(f->u, k)[j] * f->d[k];
      SF_COLUMN(f->u, j)[i] = entry / pivot;
    }
  }
  const int positive = force_psd >= SF_R(0.0) && torque_psd > SF_R(0.0);
  return sf_is_finite(f) && positive ? SF_OK : SF_INVALID;
}

void sf_covariance(const sf_filter *f, sf_real *out)
{
  /* entry (i, j <= i) and its mirror image: sum over k >= i of U_ik d_k U_jk, where U_ii = 1 */
  for (int i = 0; i < SF_N; ++i)
    for (int j = 0; j <= i; ++j) {
      sf_real sum = (i == j ? SF_R(1.0) : SF_COLUMN(f->u, i)[j]) * f->d[i];
      for (int k = i + 1; k < SF_N; ++k) sum += SF_COLUMN(f->u, k)[i] * SF_COLUMN(f->u, k)[j] * f->d[k];
      out[i * SF_N + j] = out[j * SF_N + i] = sum;
    }
}

void sf_deviations(const sf_filter *f, sf_real *out)
{
  /* roots of the diagonal of U D U' */
  for (int i = 0; i < SF_N; ++i) out[i] = SF_SQRT(variance(f, i));
}
