/* Consecutive epochs of a first-order filter in one call; `filter.py` and `ekf.py` say what an epoch computes, and the functions
 * called here, compiled apart, compute it. Every operation is that of single epochs, in the same order. Matrices are row by row
 * where they are not said to be CasADi's, which are column by column. FEWEST_DUPLICATES, DUPLICATE_SAMPLE, LINEAR_SAMPLE and
 * AGREEING_SHARE are defined in front of this text. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

typedef long long integer;

/* The loop of a `Compiled` function, that of a `Vectorised` one, and a sensor's `Model` of `update.c`. */
typedef int Loop(integer count, const double* const* from, const integer* stride, double* const* to, const integer* widths);
typedef void Sighted(integer count, const double* const* from, const integer* pitch, const integer* const* rows, double* const* to);
typedef struct {
  Sighted* linearise;
  Loop *retract, *reset;
  const integer* columns;
  integer point, width, components, dim;
} Model;

/* `update` and `propagate` of `update.c`. */
typedef integer Update(const Model*, integer count, const double* x, const double* parameters, const double* values, double weight,
                       double limit, const double* before, double* room, double* made);
typedef void Propagate(const double* factor, const double* transition, const double* noise, integer count, double* after);

/* A sensor, with its values and their parameters; epoch k has those from first[k] to before end[k]. `before` are the values that
 * it measured last, in front of all epochs. */
typedef struct {
  const Model* model;
  Update* update;
  const double *parameters, *values;
  const integer *first, *end;
  const double* before;
  integer before_count;
  double weight, limit;
  integer columns;
} Sensor;

/* The filter: numbers of an error and of a point; the process, linearised by loops[j] up to a turn of limits[j] (rad), to this
 * tolerance; places of attitude and position in an error (-1 for none), of position and rate in a point; and `IterationOptions`. */
typedef struct {
  integer n, point, noise, errors, loop_count;
  const double* limits;
  Loop* const* loops;
  const double *densities, *scales;
  double tolerance;
  Propagate* propagate;
  integer attitude, position, place, rate;
  double iteration, nearest;
} Filter;

/* What epochs leave behind, a row each (`EPOCH_ARRAYS`). */
typedef struct {
  double *mean, *factor, *nis, *likelihood;
  integer *dof, *accepted, *rejected;
} Rows;

static double length(const double* x, integer count) {
  double sum = 0;
  for (integer k = 0; k < count; ++k) sum += x[k] * x[k]; /* sum of squares */
  return sqrt(sum);
}

static int all_finite(const double* x, integer count) {
  for (integer k = 0; k < count; ++k) /* one is enough to refuse */
    if (!isfinite(x[k])) return 0;
  return 1;
}

/* `predict`: x and S are replaced; 0 where the step needs more substeps than are built. room: error, transition, noise, and
 * transposes of both. */
static int predict(const Filter* f, double dt, double* x, double* S, double* room) {
  const integer n = f->n, k = f->noise;
  double *error = room, *by_columns = error + f->errors, *noise_by_columns = by_columns + n * n;
  double *transition = noise_by_columns + n * k, *noise = transition + n * n, *after = noise + n * k, *S_after = after + f->point;
  const double turn = length(x + f->rate, 3) * dt;
  integer j = 0;
  /* the first integrator whose limit the rotation does not exceed */
  while (j < f->loop_count && !(turn <= f->limits[j])) ++j;
  if (j == f->loop_count || !f->loops[j]) return 0;
  const double* from[] = {x, &dt, f->densities};
  double* const to[] = {after, error, by_columns, noise_by_columns};
  const integer none[] = {0, 0, 0, 0};
  if (f->loops[j](1, from, none, to, none)) return 0;
  /* every error estimate of the integrator within the tolerance */
  for (integer e = 0; e < f->errors; ++e)
    if (!(error[e] <= f->tolerance)) return 0;
  /* CasADi's columns to rows, and each column of the noise factor times the scale of its disturbance */
  for (integer a = 0; a < n; ++a) {
    for (integer b = 0; b < n; ++b) transition[a * n + b] = by_columns[b * n + a];
    for (integer b = 0; b < k; ++b) noise[a * k + b] = noise_by_columns[b * n + a] * f->scales[b];
  }
  f->propagate(S, transition, noise, k, S_after);
  memcpy(x, after, f->point * sizeof(double));
  memcpy(S, S_after, n * n * sizeof(double));
  return 1;
}

/* Whether values may repeat those of the image before (`DuplicateImages`): some of a sample, spread over all, has the first
 * component of one of them. None does in the usual case, and the rest is left to the caller. */
static int may_repeat(const double* values, integer count, const double* before, integer before_count, integer components) {
  if (count < FEWEST_DUPLICATES || before_count < FEWEST_DUPLICATES) return 0;
  double sample[DUPLICATE_SAMPLE];
  const integer spacing = (count + DUPLICATE_SAMPLE - 1) / DUPLICATE_SAMPLE;
  int equal = 0;
  /* what is left of the sample repeats its first number */
  for (integer k = 0; k < DUPLICATE_SAMPLE; ++k) sample[k] = values[(k * spacing < count ? k * spacing : 0) * components];
  for (integer i = 0; i < before_count; ++i)
    for (integer k = 0; k < DUPLICATE_SAMPLE; ++k) equal |= before[i * components] == sample[k];
  return equal;
}

/* `is_small` or `linear_model_holds` of an update from x, whose innovations and Jacobians lie in `room`. */
static int is_linear(const Filter* f, const Sensor* s, integer count, integer used, const double* x, const double* parameters,
                     const double* values, const double* room, const double* made, double* rows) {
  const integer n = f->n, dim = s->model->dim, C = s->columns;
  const double *error = made + 2, *shift = error + n, *mean = made + 3 + 2 * n + 3 * n * n;
  double curvature = f->attitude < 0 ? INFINITY : length(error + f->attitude, 3);
  if (f->position >= 0) {
    const double away = length(x + f->place, 3);
    curvature += length(error + f->position, 3) / (away > f->nearest ? away : f->nearest);
  }
  if (length(shift, n) * curvature <= f->iteration) return 1;
  if (used < count) return 0; /* rejected values are no evidence on the linear model */
  /* `sample_rows`: every `spacing`th value, each for so many */
  const integer spacing = (count + LINEAR_SAMPLE - 1) / LINEAR_SAMPLE, some = (count + spacing - 1) / spacing;
  const double *innovation = room, *jacobian = room + count * dim, root = sqrt(s->weight);
  double *after = rows, *valid = after + some * dim * (C + 1), off = 0;
  const double* from[] = {mean, parameters, values};
  const integer pitch[] = {0, spacing * s->model->width, spacing * s->model->components}, *chosen[] = {0, 0, 0};
  double* const to[] = {after, after + some * dim, valid, valid + some};
  s->model->linearise(some, from, pitch, chosen, to);
  /* Sum of squares of [whitened residual at the new mean] less [innovation - jacobian error]. */
  for (integer i = 0; i < some; ++i)
    for (integer d = 0; d < dim; ++d) {
      const integer row = i * spacing * dim + d;
      double expected = innovation[row];
      for (integer c = 0; c < C; ++c) expected -= jacobian[row * C + c] * error[s->model->columns[c]];
      const double difference = after[i * dim + d] * root - expected;
      off += difference * difference;
      if (!(valid[i] > 0)) return 0;
    }
  return (double)spacing * off <= f->iteration * f->iteration;
}

/* Values of a sensor's latest measurement. */
typedef struct {
  const double* values;
  integer count;
} Last;

/* Takes in epochs until one needs what only single epochs do: it is left undone. Returns how many were taken in. most: values of
 * a sensor in an epoch at most; width: most numbers of a linearised value. */
integer take_in(const Filter* f, integer sensors, const Sensor* sensor, integer epochs, const double* dt, const double* mean,
                const double* factor, integer most, integer width, const Rows* to) {
  const integer n = f->n, m = f->point, k = f->noise;
  const integer predicting = f->errors + 3 * n * n + 2 * n * k + m, making = 3 + 2 * n + 3 * n * n + m;
  double* all = malloc((m + n * n + predicting + making + 2 * most * width) * sizeof(double));
  Last* last = malloc((sensors + 1) * sizeof(Last));
  if (!all || !last) {
    free(all);
    free(last);
    return 0;
  }
  double *x = all, *S = x + m, *room = S + n * n, *made = room + predicting, *rows = made + making, *again = rows + most * width;
  memcpy(x, mean, m * sizeof(double));
  memcpy(S, factor, n * n * sizeof(double));
  for (integer i = 0; i < sensors; ++i) last[i] = (Last){sensor[i].before, sensor[i].before_count};
  integer done = 0;
  /* an epoch: predict, update by each sensor, write its row; the first that needs more than this is left to the caller, undone */
  for (; done < epochs; ++done) {
    double nis = 0, likelihood = 0;
    integer dof = 0, accepted = 0, rejected = 0, i = 0;
    if (dt[done] > 0 && !predict(f, dt[done], x, S, room)) break; /* a belief may be of the first epoch itself */
    /* sensors in turn, each on the state after the one before */
    for (; i < sensors; ++i) {
      const Sensor* s = sensor + i;
      const integer first = s->first[done], count = s->end[done] - first, dim = s->model->dim;
      if (!count) continue;
      const double *parameters = s->parameters + first * s->model->width, *values = s->values + first * s->model->components;
      if (may_repeat(values, count, last[i].values, last[i].count, s->model->components)) break;
      last[i] = (Last){values, count};
      const integer used = s->update(s->model, count, x, parameters, values, s->weight, s->limit, S, rows, made);
      if (!used || (double)used < AGREEING_SHARE * (double)count) break; /* so few that the state is doubted */
      if (!is_linear(f, s, count, used, x, parameters, values, rows, made, again)) break;
      const double log_root = made[2 + 2 * n];
      nis += made[0];
      likelihood += -0.5 * (made[0] + (double)(used * dim) * 1.8378770664093453) - log_root - made[1];
      dof += used * dim;
      accepted += used;
      rejected += count - used;
      memcpy(x, made + 3 + 2 * n + 3 * n * n, m * sizeof(double));
      memcpy(S, made + 3 + 2 * n + 2 * n * n, n * n * sizeof(double));
    }
    if (i < sensors || !isfinite(nis + likelihood) || !all_finite(x, m) || !all_finite(S, n * n)) break;
    memcpy(to->mean + done * m, x, m * sizeof(double));
    memcpy(to->factor + done * n * n, S, n * n * sizeof(double));
    to->nis[done] = nis;
    to->likelihood[done] = likelihood;
    to->dof[done] = dof;
    to->accepted[done] = accepted;
    to->rejected[done] = rejected;
  }
  free(all);
  free(last);
  return done;
}

/* `take_in` for each of many runs of the same epochs: run r begins at mean[r] and factor[r], and has each sensor's values and
 * parameters `values_per_run` rows behind those of the run before. Leaves `epochs` rows and one of `done` behind for each run. */
void take_in_runs(const Filter* f, integer sensors, const Sensor* sensor, const integer* values_per_run, integer runs,
                  integer epochs, const double* dt, const double* mean, const double* factor, integer most, integer width,
                  const Rows* to, integer* done) {
  const integer n = f->n, m = f->point;
  Sensor* own = malloc(sensors * sizeof(Sensor));
  /* zero first, which stands where there is no memory */
  for (integer r = 0; r < runs; ++r) done[r] = 0;
  /* a run's values and parameters of each sensor, and its rows of the output */
  for (integer r = 0; own && r < runs; ++r) {
    for (integer i = 0; i < sensors; ++i) {
      const integer before = r * values_per_run[i];
      own[i] = sensor[i];
      own[i].parameters += before * own[i].model->width;
      own[i].values += before * own[i].model->components;
    }
    const integer row = r * epochs;
    const Rows rows = {to->mean + row * m,   to->factor + row * n * n, to->nis + row,     to->likelihood + row,
                       to->dof + row, to->accepted + row,       to->rejected + row};
    done[r] = take_in(f, sensors, own, epochs, dt, mean + r * m, factor + r * n * n, most, width, &rows);
  }
  free(own);
}
