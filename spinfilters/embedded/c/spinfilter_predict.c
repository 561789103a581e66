/* Time: the state by Runge-Kutta, the covariance by Thornton's update (1976) around the generated model. */
#include "spinfilter_internal.h"
#include "spinfilter_model.h"

SF_PATTERN;

/* Thornton's time update of the moving rows: [Phi U | G] made triangular again; the constants' D and U stay. */
#define ROUNDED ((SF_N + 3) / 4 * 4)
#define WIDTH (SF_MOVING + SF_NOISE)
#define UNROLL 3 /* columns at a time: what the rows of the models' blocks of three fill */

static void transform_factor(sf_filter *f, const sf_real *phi, sf_real (*rows)[WIDTH]) /* rows = Phi U */
{
  sf_real full[SF_N][ROUNDED], sum[ROUNDED];
  sf_clear(full[0], SF_N * ROUNDED);
  /* U as a square matrix with its unit diagonal; zeros below, and behind the last column for the groups of four */
  for (int j = 0; j < SF_N; ++j) {
    const sf_real *column = SF_COLUMN(f->u, j);
    for (int i = 0; i < j; ++i) full[i][j] = column[i];
    full[j][j] = SF_R(1.0);
  }
  /* row r of Phi U by the non-zeros of Phi's row, four columns at a time; U is zero left of the first of them and below its
   * diagonal */
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
    /* moving columns go to the rows that are made triangular; the constants' columns keep D and are U's at once */
    for (int j = begin; j < SF_MOVING; ++j) rows[r][j] = sum[j];
    for (int j = SF_MOVING; j < SF_N; ++j) SF_COLUMN(f->u, j)[r] = sum[j];
  }
}

static sf_real project(const sf_real *row, const sf_real *weighted, const sf_real *stop)
{
  sf_real sum = SF_R(0.0);
  /* dot product, UNROLL entries a step: begin and end of a row are multiples of it */
  for (; weighted < stop; row += UNROLL, weighted += UNROLL)
    sum += row[0] * weighted[0] + row[1] * weighted[1] + row[2] * weighted[2];
  return sum;
}

static void subtract(sf_real *row, const sf_real *own, const sf_real *stop, sf_real share)
{
  /* row -= share own, UNROLL entries a step */
  for (; own < stop; row += UNROLL, own += UNROLL) {
    row[0] -= share * own[0];
    row[1] -= share * own[1];
    row[2] -= share * own[2];
  }
}

static int propagate(sf_filter *f, const sf_real *phi, const sf_real *g)
{
  sf_real rows[SF_MOVING][WIDTH], weighted[WIDTH], d[WIDTH];
  sf_clear(rows[0], SF_MOVING * WIDTH);
  transform_factor(f, phi, rows);
  /* right of Phi U stands the noise factor G, by the non-zeros of each row */
  for (int r = 0; r < SF_MOVING; ++r)
    for (int k = sf_g_start[r]; k < sf_g_start[r + 1]; ++k) rows[r][SF_MOVING + sf_g_column[k]] = g[k];
  /* weights of the columns: D of the moving errors, and one of the noise */
  for (int k = 0; k < SF_MOVING; ++k) d[k] = f->d[k];
  for (int k = SF_MOVING; k < WIDTH; ++k) d[k] = SF_R(1.0);
  /* weighted Gram-Schmidt, last row first: D_r = row_r D row_r', U_ir = row_i D row_r' / D_r, and row_i -= U_ir row_r above */
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
    sf_real *column = SF_COLUMN(f->u, r);
    f->d[r] = square;
    for (int i = 0; i < r; ++i) {
      const sf_real share = project(rows[i] + begin, weighted + begin, weighted + end) * inverse;
      subtract(rows[i] + begin, own + begin, own + end, share);
      column[i] = share;
    }
  }
  return 1;
}

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
  sf_copy(s->point, after, 7);
  sf_multiply3(aa, s->aa, 3, first);
  sf_copy(s->aa, first, 9);
  sf_multiply3(aa, s->a, 8, first);
  sf_add_multiply3(aw, s->w, 8, first);
  sf_multiply3(ww, s->w, 8, second);
  /* columns 3 to 7, Theta: plus this substep's own sensitivity to the entries of the inertia */
  for (int i = 0; i < 3; ++i)
    for (int k = 0; k < 5; ++k) {
      first[8 * i + 3 + k] += ba[5 * i + k];
      second[8 * i + 3 + k] += bw[5 * i + k];
    }
  sf_copy(s->a, first, 24);
  sf_copy(s->w, second, 24);
  /* noise <- A noise A', A = [aa, aw; 0, ww]: first A noise, its rows of a (turned, crossed), then by A' */
  sf_real turned[9], crossed[9], part[9];
  sf_multiply3(aa, s->noise_aa, 3, turned);
  sf_multiply3_transposed(aw, s->noise_aw, part);
  for (int k = 0; k < 9; ++k) turned[k] += part[k]; /* turned = aa noise_aa + aw noise_aw' */
  sf_multiply3(aa, s->noise_aw, 3, crossed);
  sf_add_multiply3(aw, s->noise_ww, 3, crossed);
  sf_multiply3_transposed(turned, aa, s->noise_aa);
  sf_multiply3_transposed(crossed, aw, part);
  for (int k = 0; k < 9; ++k) s->noise_aa[k] += part[k]; /* noise_aa = turned aa' + crossed aw' */
  sf_multiply3_transposed(crossed, ww, s->noise_aw);
  sf_multiply3(ww, s->noise_ww, 3, part);
  sf_multiply3_transposed(part, ww, s->noise_ww);
}

static void split(const sf_real *both, sf_real *left, sf_real *right) /* 3 x 8 into 3 x 3 and 3 x 5 */
{
  for (int i = 0; i < 3; ++i) {
    for (int k = 0; k < 3; ++k) left[3 * i + k] = both[8 * i + k];
    for (int k = 0; k < 5; ++k) right[5 * i + k] = both[8 * i + 3 + k];
  }
}

static void transition(const sf_filter *f, const rotation *s, const sf_real *dj, sf_real dt, sf_real *x, sf_real *phi,
                       sf_real *g)
{
  sf_real aw[9], ww[9], theta_a[15], theta_w[15], noise[21];
  split(s->a, aw, theta_a);
  split(s->w, ww, theta_w);
  /* lower triangle of the noise of (a, w), row by row; its block (w, a) is the transpose of noise_aw */
  for (int i = 0, n = 0; i < 6; ++i)
    for (int k = 0; k <= i; ++k, ++n)
      noise[n] = i < 3 ? s->noise_aa[3 * i + k] : k < 3 ? s->noise_aw[3 * k + i - 3] : s->noise_ww[3 * (i - 3) + k - 3];
  sf_model_transition(f->x, s->point, s->aa, aw, ww, theta_a, theta_w, dj, noise, dt, f->psd, x, phi, g);
}

#ifdef SF_GYRO_BIAS_PSD
/* The gyro's bias walks: P += variance e e' for each of its components e, as U D U' (Agee and Turner 1972). */
static void add_walk(sf_filter *f, sf_real variance)
{
  for (int place = SF_B; place < SF_B + 3; ++place) {
    sf_real a[SF_N], weight = variance; /* what is left to add to the columns before j: weight a a' */
    sf_clear(a, SF_N);
    a[place] = SF_R(1.0);
    /* column j, from the last that a reaches: D_j += weight a_j^2; what the column explains leaves a, and U_j takes in its
     * share */
    for (int j = place; j >= 0; --j) {
      sf_real *column = SF_COLUMN(f->u, j);
      const sf_real before = f->d[j], part = weight * a[j];
      f->d[j] = before + part * a[j];
      const sf_real share = part / f->d[j];
      weight *= before / f->d[j];
      for (int i = 0; i < j; ++i) {
        a[i] -= a[j] * column[i];
        column[i] += share * a[i];
      }
    }
  }
}
#endif

int sf_predict(sf_filter *filter, sf_real dt)
{
  sf_filter f;
  sf_real j[6], dj[25], x[SF_NX], phi[SF_PHI_COUNT], g[SF_G_COUNT];
  rotation s;
  if (!(dt > SF_R(0.0)) || dt - dt != SF_R(0.0)) return SF_INVALID;
  sf_copy_filter(&f, filter);
  sf_clear(s.point, sizeof s / sizeof *s.point);
  /* start of the rotation: Psi = I, and q and w of the state; Theta and noise are zero */
  for (int k = 0; k < 3; ++k) s.aa[4 * k] = s.w[9 * k] = SF_R(1.0);
  for (int k = 0; k < 4; ++k) s.point[k] = f.x[SF_X_Q + k];
  for (int k = 0; k < 3; ++k) s.point[4 + k] = f.x[SF_X_W + k];
  sf_model_inertia(f.x + SF_X_S, j, dj);
  const sf_real h = dt * SF_R(1.0 / SF_SUBSTEPS);
  /* noise by quadrature: its density enters the rate at the start of each substep, and after the last one, by these weights */
  for (int step = 0; step < SF_SUBSTEPS; ++step) {
    for (int k = 0; k < 3; ++k) s.noise_ww[4 * k] += sf_weight[step] * h;
    advance_rotation(&s, j, h);
  }
  for (int k = 0; k < 3; ++k) s.noise_ww[4 * k] += sf_weight[SF_SUBSTEPS] * h;
  transition(&f, &s, dj, dt, x, phi, g);
  sf_copy(f.x, x, SF_NX);
#ifdef SF_GYRO_BIAS_PSD
  add_walk(&f, SF_R(SF_GYRO_BIAS_PSD) * dt); /* before or after the motion, which does not depend on the bias */
#endif
  if (!propagate(&f, phi, g) || !sf_is_finite(&f)) return SF_NOT_FINITE;
  const sf_real *w = f.x + SF_X_W;
  const sf_real turn = SF_SQRT(w[0] * w[0] + w[1] * w[1] + w[2] * w[2]) * dt;
  sf_copy_filter(filter, &f);
  return turn <= SF_R(SF_LARGEST_TURN) ? SF_OK : SF_FAST;
}
