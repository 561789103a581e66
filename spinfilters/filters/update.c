/* Prediction and update of a first-order filter, each in one call; `filter.py` and `ekf.py` say what they compute.
 * `correction.c` stands before this text. */

/* The loop of a `Compiled` function. */
typedef int Loop(integer count, const double* const* from, const integer* pitch, double* const* to, const integer* widths);

/* What all measurements of a sensor share: its linearisation, the state's retraction and reset Jacobian, the columns [C] that it
 * depends on; numbers of a point, of a value's parameters, of a value and of an innovation. */
typedef struct {
  Sighted* linearise;
  Loop *retract, *reset;
  const integer* columns;
  integer point, width, components, dim;
} Model;

/* What an update makes; the mean lies behind it. */
typedef struct {
  double nis, log_noise, error[N], shift[N + 1], factor[N * N], root[N * N], reset[N * N];
} Made;

enum { BLOCK = 96, MOST_NOISE = 24, MOST_DIM = 8 };

/* Squared distance of a whitened innovation, of covariance I + Y Y' with Y = jacobian factor[columns] (dim at most MOST_DIM):
 * infinite where that is not definite. */
static double distance(const Model* model, const double* innovation, const double* jacobian, const double* factor) {
  double Y[MOST_DIM * N] = {0}, S[MOST_DIM * (MOST_DIM + 1)], square = 0;
  const int dim = (int)model->dim;
  /* Y = jacobian factor[columns], [dim][N]. */
  for (int d = 0; d < dim; ++d)
    for (int c = 0; c < C; ++c)
      for (int k = 0; k < N; ++k) Y[d * N + k] += jacobian[d * C + c] * factor[model->columns[c] * N + k];
  /* Row d of the Cholesky factor of S = I + Y Y', and forward substitution of the innovation in the spare last row of S. */
  for (int d = 0; d < dim; ++d) {
    for (int e = 0; e <= d; ++e) {
      double sum = d == e;
      for (int k = 0; k < N; ++k) sum += Y[d * N + k] * Y[e * N + k];
      for (int k = 0; k < e; ++k) sum -= S[d * MOST_DIM + k] * S[e * MOST_DIM + k];
      if (e == d && !(sum > 0)) return INFINITY;
      S[d * MOST_DIM + e] = e == d ? sqrt(sum) : sum / S[e * MOST_DIM + e];
    }
    double sum = innovation[d];
    for (int e = 0; e < d; ++e) sum -= S[d * MOST_DIM + e] * S[MOST_DIM * MOST_DIM + e];
    sum /= S[d * MOST_DIM + d];
    S[MOST_DIM * MOST_DIM + d] = sum;
    square += sum * sum;
  }
  return square;
}

/* Scales innovations and Jacobians by the root of the weight, and marks in `valid` the values whose distance is within the
 * limit, as all are whose innovation is no longer than that; how many, or -1 where a value is invalid. Sums up log determinants
 * of the noise. */
static integer gated(const Model* model, integer count, double* innovation, double* jacobian, double* valid, const double* noise,
                     double weight, double limit, const double* factor, double* log_noise) {
  const integer dim = model->dim;
  const double scale = sqrt(weight), logs = log(scale) * (double)dim;
  integer kept = 0;
  *log_noise = 0;
  /* value i, times the root of the weight; its covariance is needed only where the innovation alone exceeds the limit */
  for (integer i = 0; i < count; ++i) {
    double square = 0, *rho = innovation + i * dim, *rows = jacobian + i * dim * C;
    if (weight != 1) {
      for (integer k = 0; k < dim; ++k) rho[k] *= scale;
      for (integer k = 0; k < dim * C; ++k) rows[k] *= scale;
    }
    for (integer d = 0; d < dim; ++d) square += rho[d] * rho[d];
    if (!(valid[i] > 0 && square < INFINITY)) return -1;
    valid[i] = square <= limit || distance(model, rho, rows, factor) <= limit;
    if (valid[i] > 0) {
      ++kept;
      *log_noise += noise[i] - logs;
    }
  }
  return kept;
}

/* How many values pass the gate, and 0 where none does or one is invalid: then nothing is done. room: [count][dim * (C + 1) +
 * 2]. */
integer update(const Model* model, integer count, const double* x, const double* parameters, const double* values, double weight,
               double limit, const double* before, double* room, Made* made) {
  const integer dim = model->dim, rows = count * dim;
  double *innovation = room, *jacobian = innovation + rows, *valid = jacobian + rows * C, *noise = valid + count;
  const double* from[] = {x, parameters, values};
  const integer pitch[] = {0, model->width, model->components}, *chosen[] = {0, 0, 0};
  double* const to[] = {innovation, jacobian, valid, noise};
  model->linearise(count, from, pitch, chosen, to);
  const integer kept =
      gated(model, count, innovation, jacobian, valid, noise, weight, limit, before, &made->log_noise);
  if (kept < 1) return 0;
  double R[W * WP] __attribute__((aligned(ALIGNMENT))) = {0}, block[BLOCK * WP] __attribute__((aligned(ALIGNMENT))) = {0};
  int filled = 0;
  /* Rows [jacobian | innovation] of the values inside the gate into the triangle R [W][WP], BLOCK rows at a time. */
  for (integer i = 0; i < rows; ++i) {
    if (valid[i / dim] > 0) {
      double* row = block + filled++ * WP;
      for (int k = 0; k < C; ++k) row[k] = jacobian[i * C + k];
      row[C] = innovation[i];
      for (int k = W; k < WP; ++k) row[k] = 0;
    }
    if (filled == BLOCK || i + 1 == rows) {
      absorb_rows(R, block, filled, W);
      filled = 0;
    }
  }
  memcpy(made->factor, before, sizeof made->factor);
  made->nis = correct_rows(R, N, model->columns, made->factor, made->root, made->shift, made->error);
  double J[N * N], *mean = (double*)(made + 1);
  const double *state[] = {x, made->error}, *error[] = {made->error};
  const integer one[] = {0, 0};
  double *const point[] = {mean}, *const matrix[] = {J};
  if (model->retract(1, state, one, point, one) || model->reset(1, error, one, matrix, one)) return 0;
  memset(made->reset, 0, sizeof made->reset);
  /* reset = J factor, J the reset Jacobian; most entries of J are zero. */
  for (int i = 0; i < N; ++i)
    for (int k = 0; k < N; ++k) { /* CasADi's matrices lie column by column */
      const double j = J[k * N + i];
      if (j != 0)
        for (int l = 0; l < N; ++l) made->reset[i * N + l] += j * made->factor[k * N + l];
    }
  return kept;
}

/* `propagated`: lower triangular factor [N][N], when errors move by the transition [N][N] and noise [N][count] comes in. */
void propagate(const double* factor, const double* transition, const double* noise, integer count, double* after) {
  double R[N * NP] __attribute__((aligned(ALIGNMENT))) = {0}, back[N * NP] = {0};
  double rows[(N + MOST_NOISE) * NP] __attribute__((aligned(ALIGNMENT))) = {0};
  /* back = transition', so that the products below run along rows. */
  for (int i = 0; i < N; ++i)
    for (int k = 0; k < N; ++k) back[k * NP + i] = transition[i * N + k];
  /* Rows 0 .. N: (transition factor)'. */
  for (int k = 0; k < N; ++k)
    for (int j = 0; j < N; ++j) {
      const double f = factor[k * N + j];
      for (int i = 0; i < NP; ++i) rows[j * NP + i] += f * back[k * NP + i];
    }
  /* Rows N .. N + count: noise'. */
  for (int i = 0; i < N; ++i)
    for (integer j = 0; j < count; ++j) rows[(N + j) * NP + i] = noise[i * count + j];
  /* R'R = rows' rows = the predicted covariance; its lower factor is R'. */
  absorb_factor(R, rows, N + (int)count, N);
  for (int i = 0; i < N; ++i)
    for (int j = 0; j < N; ++j) after[i * N + j] = j <= i ? R[j * NP + i] : 0;
}
