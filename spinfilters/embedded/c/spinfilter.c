/* The filter: covariance in UD form (Bierman 1977, Thornton 1976) around the generated model. */
#include "spinfilter.h"

#include "spinfilter_arithmetic.h"
#include "spinfilter_model.h"

SF_PATTERN;

#define COLUMN(u, j) ((u) + (j) * ((j) - 1) / 2)

/* ---- copies: word by word, for a library's memcpy may go byte by byte ---- */

static void copy(sf_real *to, const sf_real *from, int count)
{
  for (int k = 0; k < count; ++k) to[k] = from[k];
}

static void clear(sf_real *to, int count)
{
  for (int k = 0; k < count; ++k) to[k] = SF_R(0.0);
}

static void copy_filter(sf_filter *to, const sf_filter *from)
{
  copy(to->x, from->x, SF_NX);
  copy(to->u, from->u, SF_N * (SF_N - 1) / 2);
  copy(to->d, from->d, SF_N);
  copy(to->psd, from->psd, 2);
  to->nis = from->nis;
  to->dof = from->dof;
  to->used = from->used;
  to->refused = from->refused;
}

/* ---- small matrices, row by row ---- */

SF_QUICK_BEGIN

static void multiply3(const sf_real *a, const sf_real *b, int columns, sf_real *out) /* out = a b */
{
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < columns; ++j)
      out[i * columns + j] = a[3 * i] * b[j] + a[3 * i + 1] * b[columns + j] + a[3 * i + 2] * b[2 * columns + j];
}

static void add_multiply3(const sf_real *a, const sf_real *b, int columns, sf_real *out) /* out += a b */
{
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < columns; ++j)
      out[i * columns + j] += a[3 * i] * b[j] + a[3 * i + 1] * b[columns + j] + a[3 * i + 2] * b[2 * columns + j];
}

static void multiply3_transposed(const sf_real *a, const sf_real *b, sf_real *out) /* out = a b', 3 x 3 */
{
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j)
      out[3 * i + j] = a[3 * i] * b[3 * j] + a[3 * i + 1] * b[3 * j + 1] + a[3 * i + 2] * b[3 * j + 2];
}

SF_QUICK_END

/* ---- U D U' ---- */

static int finite(const sf_filter *f)
{
  int good = 1;
  for (int k = 0; k < SF_NX; ++k) good &= f->x[k] - f->x[k] == SF_R(0.0);
  for (int k = 0; k < SF_N; ++k) good &= f->d[k] > SF_R(0.0) && f->d[k] - f->d[k] == SF_R(0.0);
  return good;
}

/* What an update says of the error, while its rows go in one after the other. */
typedef struct {
  sf_real error[SF_N];
  sf_real nis;
} correction;

SF_QUICK_BEGIN

/* One scalar measurement: residual = row . error[SF_SEEN...] + unit noise (Bierman 1977). */
static void update_scalar(sf_filter *f, correction *c, const sf_real *row, sf_real residual)
{
  sf_real slope[SF_N], gain[SF_N];
  sf_real alpha = SF_R(1.0);
  for (int k = 0; k < SF_SEEN_COUNT; ++k) residual -= row[k] * c->error[SF_SEEN + k];
  for (int j = 0; j < SF_N; ++j) {
    const sf_real *column = COLUMN(f->u, j) + SF_SEEN;
    const int above = j < SF_SEEN ? 0 : (j - SF_SEEN < SF_SEEN_COUNT ? j - SF_SEEN : SF_SEEN_COUNT);
    sf_real sum = above < SF_SEEN_COUNT && j >= SF_SEEN ? row[above] : SF_R(0.0);
    for (int k = 0; k < above; ++k) sum += column[k] * row[k];
    slope[j] = sum;
  }
  for (int j = 0; j < SF_N; ++j) {
    sf_real *column = COLUMN(f->u, j);
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
  for (int j = 0; j < SF_N; ++j) c->error[j] += gain[j] * scaled;
  c->nis += residual * scaled;
}

SF_QUICK_END

#define BLOCK 5 /* components of the largest block that a reset transforms */

/* b <- A^-1 b, A = I + a: Gauss without pivots, a is small; a is lost. */
static void solve_near_identity(sf_real (*a)[BLOCK], sf_real (*b)[BLOCK], int n)
{
  for (int k = 0; k < n; ++k) {
    const sf_real inverse = SF_R(1.0) / (SF_R(1.0) + a[k][k]);
    for (int i = k + 1; i < n; ++i) {
      const sf_real share = a[i][k] * inverse;
      for (int j = k + 1; j < n; ++j) a[i][j] -= share * a[k][j];
      for (int j = 0; j < n; ++j) b[i][j] -= share * b[k][j];
    }
  }
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
  for (int i = 0; i < size; ++i) {
    moved[i] = SF_R(0.0);
    for (int k = 0; k < size; ++k) moved[i] += matrix[i * size + k] * at[k];
  }
  for (int i = 0; i < size; ++i) at[i] += moved[i];
}

/* D + b D + D b' + b D b' = (I + v) D' (I + v)', v strictly upper triangular; d becomes D'. */
static void factor_near_diagonal(sf_real (*b)[BLOCK], sf_real *d, sf_real (*v)[BLOCK], int n)
{
  sf_real s[BLOCK][BLOCK];
  for (int i = 0; i < n; ++i)
    for (int j = 0; j <= i; ++j) {
      s[j][i] = b[i][j] * d[j] + b[j][i] * d[i];
      for (int k = 0; k < n; ++k) s[j][i] += b[i][k] * d[k] * b[j][k];
    }
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
 * Of that block's U: (I + e) U = U (I + b), and (I + b) D (I + b)' = (I + v) D' (I + v)'. So U becomes U (I + v), and what stands
 * above it is multiplied by (I + b)^-1 (I + v). All of e, b, v is small, and nothing is rounded that does not change. */
static void reset_block(sf_filter *f, int first, int size, const sf_real *e)
{
  sf_real b[BLOCK][BLOCK], v[BLOCK][BLOCK], c[BLOCK][BLOCK];
  for (int j = first + size; j < SF_N; ++j) add_transformed(COLUMN(f->u, j) + first, e, size);
  for (int j = 0; j < size; ++j) { /* b = U^-1 e U */
    const sf_real *column = COLUMN(f->u, first + j) + first;
    for (int i = 0; i < size; ++i) {
      b[i][j] = e[i * size + j];
      for (int k = 0; k < j; ++k) b[i][j] += e[i * size + k] * column[k];
    }
    for (int i = size - 1; i >= 0; --i)
      for (int k = i + 1; k < size; ++k) b[i][j] -= COLUMN(f->u, first + k)[first + i] * b[k][j];
  }
  factor_near_diagonal(b, f->d + first, v, size);
  for (int i = 0; i < size; ++i)
    for (int j = 0; j < size; ++j) c[i][j] = v[i][j] - b[i][j];
  solve_near_identity(b, c, size);
  for (int i = 0; i < first; ++i) { /* above: T += T c */
    sf_real row[BLOCK];
    for (int k = 0; k < size; ++k) row[k] = COLUMN(f->u, first + k)[i];
    for (int j = 0; j < size; ++j) {
      sf_real sum = SF_R(0.0);
      for (int k = 0; k < size; ++k) sum += row[k] * c[k][j];
      COLUMN(f->u, first + j)[i] = row[j] + sum;
    }
  }
  for (int j = size - 1; j > 0; --j) /* U += U v, the last column first: it needs those before it */
    for (int i = 0; i < j; ++i) {
      sf_real sum = v[i][j];
      for (int k = i + 1; k < j; ++k) sum += COLUMN(f->u, first + k)[first + i] * v[k][j];
      COLUMN(f->u, first + j)[first + i] += sum;
    }
}

/* Fold the error into the state; the covariance moves with the derivative of that reset. */
static void reset(sf_filter *f, const correction *c)
{
  sf_real after[SF_NX], moved_a[9], moved_s[25];
  sf_model_correction(f->x, c->error, after, moved_a, moved_s);
  copy(f->x, after, SF_NX);
  reset_block(f, SF_A, 3, moved_a);
  reset_block(f, SF_S, 5, moved_s);
}

/* Thornton's time update of the moving rows: [Phi U | G] made triangular again; the constants' D and U stay. */
#define ROUNDED ((SF_N + 3) / 4 * 4)
#define WIDTH (SF_MOVING + SF_NOISE)
#define UNROLL 3 /* columns at a time: what the rows of the models' blocks of three fill */

SF_QUICK_BEGIN

static void transform_factor(sf_filter *f, const sf_real *phi, sf_real (*rows)[WIDTH]) /* rows = Phi U */
{
  sf_real full[SF_N][ROUNDED], sum[ROUNDED];
  clear(full[0], SF_N * ROUNDED);
  for (int j = 0; j < SF_N; ++j) {
    const sf_real *column = COLUMN(f->u, j);
    for (int i = 0; i < j; ++i) full[i][j] = column[i];
    full[j][j] = SF_R(1.0);
  }
  for (int r = 0; r < SF_MOVING; ++r) {
    const int begin = sf_phi_column[sf_phi_start[r]];
    for (int j = begin & ~3; j < SF_N; j += 4) {
      sf_real a = SF_R(0.0), b = SF_R(0.0), c = SF_R(0.0), d = SF_R(0.0);
      for (int n = sf_phi_start[r]; n < sf_phi_start[r + 1] && sf_phi_column[n] < j + 4; ++n) {
        const sf_real *row = full[sf_phi_column[n]] + j, value = phi[n];
        a += value * row[0];
        b += value * row[1];
        c += value * row[2];
        d += value * row[3];
      }
      sum[j] = a;
      sum[j + 1] = b;
      sum[j + 2] = c;
      sum[j + 3] = d;
    }
    for (int j = begin; j < SF_MOVING; ++j) rows[r][j] = sum[j];
    for (int j = SF_MOVING; j < SF_N; ++j) COLUMN(f->u, j)[r] = sum[j];
  }
}

static sf_real project(const sf_real *row, const sf_real *weighted, const sf_real *stop)
{
  sf_real sum = SF_R(0.0);
  for (; weighted < stop; row += UNROLL, weighted += UNROLL)
    sum += row[0] * weighted[0] + row[1] * weighted[1] + row[2] * weighted[2];
  return sum;
}

static void subtract(sf_real *row, const sf_real *own, const sf_real *stop, sf_real share)
{
  for (; own < stop; row += UNROLL, own += UNROLL) {
    row[0] -= share * own[0];
    row[1] -= share * own[1];
    row[2] -= share * own[2];
  }
}

static int propagate(sf_filter *f, const sf_real *phi, const sf_real *g)
{
  sf_real rows[SF_MOVING][WIDTH], weighted[WIDTH], d[WIDTH];
  clear(rows[0], SF_MOVING * WIDTH);
  transform_factor(f, phi, rows);
  for (int r = 0; r < SF_MOVING; ++r)
    for (int k = sf_g_start[r]; k < sf_g_start[r + 1]; ++k) rows[r][SF_MOVING + sf_g_column[k]] = g[k];
  for (int k = 0; k < SF_MOVING; ++k) d[k] = f->d[k];
  for (int k = SF_MOVING; k < WIDTH; ++k) d[k] = SF_R(1.0);
  for (int r = SF_MOVING - 1; r >= 0; --r) {
    const int begin = r / UNROLL * UNROLL, end = sf_row_end[r];
    const sf_real *own = rows[r];
    sf_real square = SF_R(0.0);
    for (int k = begin; k < end; ++k) {
      weighted[k] = d[k] * own[k];
      square += own[k] * weighted[k];
    }
    if (!(square > SF_R(0.0))) return 0;
    const sf_real inverse = SF_R(1.0) / square;
    sf_real *column = COLUMN(f->u, r);
    f->d[r] = square;
    for (int i = 0; i < r; ++i) {
      const sf_real share = project(rows[i] + begin, weighted + begin, weighted + end) * inverse;
      subtract(rows[i] + begin, own + begin, own + end, share);
      column[i] = share;
    }
  }
  return 1;
}

SF_QUICK_END

int sf_begin(sf_filter *f, const sf_real *x, const sf_real *covariance, sf_real force_psd, sf_real torque_psd)
{
  f->nis = SF_R(0.0);
  f->dof = f->used = f->refused = 0;
  copy(f->x, x, SF_NX);
  f->psd[0] = force_psd;
  f->psd[1] = torque_psd;
  for (int j = SF_N - 1; j >= 0; --j) { /* backward Cholesky: the last row first */
    sf_real pivot = covariance[j * SF_N + j];
    for (int k = j + 1; k < SF_N; ++k) pivot -= COLUMN(f->u, k)[j] * COLUMN(f->u, k)[j] * f->d[k];
    f->d[j] = pivot;
    for (int i = 0; i < j; ++i) {
      sf_real entry = covariance[i * SF_N + j];
      for (int k = j + 1; k < SF_N; ++k) entry -= COLUMN(f->u, k)[i] * COLUMN(f->u, k)[j] * f->d[k];
      COLUMN(f->u, j)[i] = entry / pivot;
    }
  }
  const int positive = force_psd >= SF_R(0.0) && torque_psd > SF_R(0.0);
  return finite(f) && positive ? SF_OK : SF_INVALID;
}

void sf_covariance(const sf_filter *f, sf_real *out)
{
  for (int i = 0; i < SF_N; ++i)
    for (int j = 0; j <= i; ++j) {
      sf_real sum = (i == j ? SF_R(1.0) : COLUMN(f->u, i)[j]) * f->d[i];
      for (int k = i + 1; k < SF_N; ++k) sum += COLUMN(f->u, k)[i] * COLUMN(f->u, k)[j] * f->d[k];
      out[i * SF_N + j] = out[j * SF_N + i] = sum;
    }
}

void sf_deviations(const sf_filter *f, sf_real *out)
{
  for (int i = 0; i < SF_N; ++i) {
    sf_real sum = f->d[i];
    for (int k = i + 1; k < SF_N; ++k) sum += COLUMN(f->u, k)[i] * COLUMN(f->u, k)[i] * f->d[k];
    out[i] = SF_SQRT(sum);
  }
}

/* ---- time ---- */

/* Rotation after dt with its error transition, its sensitivity to the constants, and its noise of unit density. */
typedef struct {
  sf_real point[7];                  /* q, w */
  sf_real aa[9], a[24], w[24];       /* Psi_aa, [Psi_aw | Theta_a], [Psi_ww | Theta_w] */
  sf_real noise_aa[9], noise_aw[9], noise_ww[9];
} rotation;

static void advance_rotation(rotation *s, const sf_real *j, sf_real h)
{
  sf_real after[7], aa[9], aw[9], ww[9], ba[15], bw[15], first[24], second[24];
  sf_model_substep(s->point, s->point + 4, j, h, after, after + 4, aa, aw, ww, ba, bw);
  copy(s->point, after, 7);
  multiply3(aa, s->aa, 3, first);
  copy(s->aa, first, 9);
  multiply3(aa, s->a, 8, first);
  add_multiply3(aw, s->w, 8, first);
  multiply3(ww, s->w, 8, second);
  for (int i = 0; i < 3; ++i)
    for (int k = 0; k < 5; ++k) {
      first[8 * i + 3 + k] += ba[5 * i + k];
      second[8 * i + 3 + k] += bw[5 * i + k];
    }
  copy(s->a, first, 24);
  copy(s->w, second, 24);
  /* noise <- A noise A' */
  sf_real turned[9], crossed[9], part[9];
  multiply3(aa, s->noise_aa, 3, turned);
  multiply3_transposed(aw, s->noise_aw, part);
  for (int k = 0; k < 9; ++k) turned[k] += part[k];
  multiply3(aa, s->noise_aw, 3, crossed);
  add_multiply3(aw, s->noise_ww, 3, crossed);
  multiply3_transposed(turned, aa, s->noise_aa);
  multiply3_transposed(crossed, aw, part);
  for (int k = 0; k < 9; ++k) s->noise_aa[k] += part[k];
  multiply3_transposed(crossed, ww, s->noise_aw);
  multiply3(ww, s->noise_ww, 3, part);
  multiply3_transposed(part, ww, s->noise_ww);
}

static void split(const sf_real *both, sf_real *left, sf_real *right) /* 3 x 8 into 3 x 3 and 3 x 5 */
{
  for (int i = 0; i < 3; ++i) {
    for (int k = 0; k < 3; ++k) left[3 * i + k] = both[8 * i + k];
    for (int k = 0; k < 5; ++k) right[5 * i + k] = both[8 * i + 3 + k];
  }
}

static void transition(const sf_filter *f, const rotation *s, const sf_real *dj, sf_real dt, sf_real *x, sf_real *phi, sf_real *g)
{
  sf_real aw[9], ww[9], theta_a[15], theta_w[15], noise[21];
  split(s->a, aw, theta_a);
  split(s->w, ww, theta_w);
  for (int i = 0, n = 0; i < 6; ++i)
    for (int k = 0; k <= i; ++k, ++n)
      noise[n] = i < 3 ? s->noise_aa[3 * i + k] : k < 3 ? s->noise_aw[3 * k + i - 3] : s->noise_ww[3 * (i - 3) + k - 3];
  sf_model_transition(f->x, s->point, s->aa, aw, ww, theta_a, theta_w, dj, noise, dt, f->psd, x, phi, g);
}

int sf_predict(sf_filter *filter, sf_real dt)
{
  sf_filter f;
  sf_real j[6], dj[25], x[SF_NX], phi[SF_PHI_COUNT], g[SF_G_COUNT];
  rotation s;
  if (!(dt > SF_R(0.0)) || dt - dt != SF_R(0.0)) return SF_INVALID;
  copy_filter(&f, filter);
  clear(s.point, sizeof s / sizeof *s.point);
  for (int k = 0; k < 3; ++k) s.aa[4 * k] = s.w[9 * k] = SF_R(1.0);
  for (int k = 0; k < 4; ++k) s.point[k] = f.x[SF_X_Q + k];
  for (int k = 0; k < 3; ++k) s.point[4 + k] = f.x[SF_X_W + k];
  sf_model_inertia(f.x + SF_X_S, j, dj);
  const sf_real h = dt * SF_R(1.0 / SF_SUBSTEPS);
  for (int step = 0; step < SF_SUBSTEPS; ++step) {
    for (int k = 0; k < 3; ++k) s.noise_ww[4 * k] += sf_weight[step] * h;
    advance_rotation(&s, j, h);
  }
  for (int k = 0; k < 3; ++k) s.noise_ww[4 * k] += sf_weight[SF_SUBSTEPS] * h;
  transition(&f, &s, dj, dt, x, phi, g);
  copy(f.x, x, SF_NX);
  if (!propagate(&f, phi, g) || !finite(&f)) return SF_NOT_FINITE;
  const sf_real *w = f.x + SF_X_W;
  const sf_real turn = SF_SQRT(w[0] * w[0] + w[1] * w[1] + w[2] * w[2]) * dt;
  copy_filter(filter, &f);
  return turn <= SF_R(SF_LARGEST_TURN) ? SF_OK : SF_FAST;
}

/* ---- sensors without landmarks ---- */

/* Rows whitened by the sensor's noise: in, unless they lie outside the gate. */
static int update_rows(sf_filter *filter, const sf_real *rows, const sf_real *innovation, int count, sf_real gate)
{
  sf_filter f;
  correction c;
  copy_filter(&f, filter);
  clear(c.error, SF_N + 1);
  for (int k = 0; k < count; ++k) update_scalar(&f, &c, rows + k * SF_SEEN_COUNT, innovation[k]);
  filter->used = 0;
  if (!(c.nis <= gate)) {
    filter->refused += filter->refused < UINT16_MAX;
    return SF_REFUSED;
  }
  reset(&f, &c);
  if (!finite(&f)) return SF_NOT_FINITE;
  f.nis = c.nis;
  f.dof = (uint16_t)count;
  f.used = 1;
  f.refused = 0;
  copy_filter(filter, &f);
  return SF_OK;
}

#ifdef SF_HAS_GYRO
int sf_update_gyro(sf_filter *f, const sf_real *rates, const sf_real *parameters)
{
  sf_real innovation[3], rows[3 * SF_SEEN_COUNT], valid[1];
  sf_model_gyro(f->x, parameters, rates, innovation, rows, valid);
  return update_rows(f, rows, innovation, 3, SF_R(SF_GATE_3));
}
#endif

#ifdef SF_HAS_POSE
int sf_update_pose(sf_filter *f, const sf_real *pose, const sf_real *root)
{
  sf_real innovation[6], rows[6 * SF_SEEN_COUNT], valid[1];
  sf_model_pose(f->x, root, pose, innovation, rows, valid);
  return update_rows(f, rows, innovation, 6, SF_R(SF_GATE_6));
}
#endif

#ifdef SF_HAS_STEREO
#include "spinfilter_landmarks.h"
#endif
