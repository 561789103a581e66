/* A step of a filter: means and covariance factors before it to those after; `filter.py`, `ekf.py` and `ukf.py` say what a
 * prediction computes. Matrices are row by row where they are not said to be CasADi's, which are column by column. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

typedef long long integer;

/* The loop of a `Compiled` function, that of a `Vectorised` one, and that of a `VectorisedScan`. */
typedef int Loop(integer count, const double* const* from, const integer* stride, double* const* to, const integer* widths);
typedef void Sighted(integer count, const double* const* from, const integer* pitch, const integer* const* rows, double* const* to);
typedef void Scan(integer count, const double* const* from, const integer* width, const integer* const* rows, double* const* to,
                  integer turns, const double* each);

/* `propagate` of `update.c`, and `triangle` of `triangle.c`. */
typedef void Propagate(const double* factor, const double* transition, const double* noise, integer count, double* after);
typedef void Triangle(const double* rows, integer count, integer n, integer down, integer along, double* L);

/* Many points side by side: the state's retraction and error; steps of `constants` numbers a point in fewest << j substeps, with
 * their error. */
typedef struct {
  integer constants, fewest;
  Sighted *retract, *local;
  Loop* find_constants;
  Scan* step;
  Loop* step_error;
  const double* nothing; /* the numbers of a substep: none, as many zeros as there may be substeps */
} Points;

/* Sigma points of an unscented filter: `points` offsets from the mean in columns of the factor, with their weights. */
typedef struct {
  integer points;
  const double *offsets, *mean_weights, *root_weights;
} Sigma;

/* When a belief is widened, as `FlowCurvature`: the first error of the mass distribution and how many there are, the angle of a
 * stretch, and the limits of `flow_curvature.py`. */
typedef struct {
  integer first, count;
  double turn, soft, longest_step, negligible, longest_pause;
} Curvature;

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
  const Points* points;       /* of an unscented filter or with `curvature`, else none */
  const Sigma* sigma;         /* of an unscented filter, else none */
  const Curvature* curvature; /* of a filter whose beliefs are widened, else none */
  Triangle* triangle;
} Filter;

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

/* The first integrator whose limit a rotation in a step does not exceed; `loop_count` for none. */
static integer integrator(const Filter* f, double turn) {
  integer j = 0;
  while (j < f->loop_count && !(turn <= f->limits[j])) ++j;
  return j;
}

/* Parts of the room that a step takes: error estimate, transition and noise factor column by column, both row by row, the mean
 * after the step, and its factor. */
typedef struct {
  double *error, *by_columns, *noise_by_columns, *transition, *noise, *after, *S_after;
} Step;

static Step parts_of(const Filter* f, double* room) {
  const integer n = f->n, k = f->noise;
  double *by_columns = room + f->errors, *noise_by_columns = by_columns + n * n, *transition = noise_by_columns + n * k;
  double *noise = transition + n * n, *after = noise + n * k;
  return (Step){room, by_columns, noise_by_columns, transition, noise, after, after + f->point};
}

/* The step linearised at x; 0 where it needs more substeps than are built. */
static int linearise_step(const Filter* f, double dt, const double* x, const Step* at) {
  const integer n = f->n, k = f->noise, j = integrator(f, length(x + f->rate, 3) * dt);
  if (j == f->loop_count || !f->loops[j]) return 0;
  const double* from[] = {x, &dt, f->densities};
  double* const to[] = {at->after, at->error, at->by_columns, at->noise_by_columns};
  const integer none[] = {0, 0, 0, 0};
  if (f->loops[j](1, from, none, to, none)) return 0;
  /* every error estimate of the integrator within the tolerance */
  for (integer e = 0; e < f->errors; ++e)
    if (!(at->error[e] <= f->tolerance)) return 0;
  /* CasADi's columns to rows, and each column of the noise factor times the scale of its disturbance */
  for (integer a = 0; a < n; ++a) {
    for (integer b = 0; b < n; ++b) at->transition[a * n + b] = at->by_columns[b * n + a];
    for (integer b = 0; b < k; ++b) at->noise[a * k + b] = at->noise_by_columns[b * n + a] * f->scales[b];
  }
  return 1;
}

/* `predict`: x and S are replaced; 0 where the step needs more substeps than are built. */
static int predict(const Filter* f, double dt, double* x, double* S, double* room) {
  const integer n = f->n;
  const Step at = parts_of(f, room);
  if (!linearise_step(f, dt, x, &at)) return 0;
  f->propagate(S, at.transition, at.noise, f->noise, at.S_after);
  memcpy(x, at.after, f->point * sizeof(double));
  memcpy(S, at.S_after, n * n * sizeof(double));
  return 1;
}

/* Numbers of the room of `step_points`. */
static integer points_room(const Filter* f, integer count) { return count * (f->points->constants + 15); }

/* Points [count][point] after dt: all of them in as many substeps as the fastest needs, and in half as many for the error. 0 where
 * it needs more substeps than are built. */
static int step_points(const Filter* f, integer count, double dt, const double* points, double* moved, double* room) {
  const Points* u = f->points;
  const integer m = f->point, q = u->constants, *none[] = {0, 0, 0, 0};
  double *constants = room, *fine = constants + count * q, *coarse = fine + count * 7, *off = coarse + count * 7, fastest = 0;
  for (integer i = 0; i < count; ++i) {
    const double speed = length(points + i * m + f->rate, 3);
    if (!(speed <= fastest)) fastest = speed;
  }
  const integer j = integrator(f, fastest * dt);
  if (j == f->loop_count) return 0;
  const integer substeps = u->fewest << j;
  {
    const double* from[] = {points};
    const integer width[] = {m}, made[] = {q};
    double* const to[] = {constants};
    if (u->find_constants(count, from, width, to, made)) return 0;
  }
  for (int halved = 1; halved >= 0; --halved) {
    const double h = halved ? 2 * dt / (double)substeps : dt / (double)substeps, *from[] = {points, constants, &dt, &h};
    const integer width[] = {m, q, 0, 0};
    double* const to[] = {moved, halved ? coarse : fine};
    u->step(count, from, width, none, to, halved ? substeps / 2 : substeps, u->nothing);
  }
  {
    const double* from[] = {coarse, fine};
    const integer width[] = {7, 7}, made[] = {1};
    double* const to[] = {off};
    if (u->step_error(count, from, width, to, made)) return 0;
  }
  for (integer i = 0; i < count; ++i)
    if (!(off[i] <= f->tolerance)) return 0;
  return 1;
}

/* Numbers of the room of `predict_sigma` behind that of a step. */
static integer sigma_room(const Filter* f) {
  const integer p = f->sigma ? f->sigma->points : 0, n = f->n;
  return p ? p * (2 * n + 2 * f->point) + points_room(f, p) + (p + f->noise) * n + n : 0;
}

/* `linearise_process` of `ukf.py` at x and S: mean, transition and noise factor as `parts_of` the room, and rows of weighted
 * deviations, with room for those of the noise behind; none where a step needs more substeps than are built. */
static double* spread_sigma(const Filter* f, double dt, const double* x, const double* S, double* room) {
  const Sigma* u = f->sigma;
  const integer n = f->n, m = f->point, p = u->points, k = f->noise;
  const Step at = parts_of(f, room);
  double *shifts = at.S_after + n * n, *errors = shifts + p * n, *points = errors + p * n, *moved = points + p * m;
  double *stepping = moved + p * m, *rows = stepping + points_room(f, p), *error = rows + (p + k) * n;
  if (!linearise_step(f, dt, x, &at)) return 0;
  /* points: retract(x, offsets S') */
  for (integer i = 0; i < p; ++i)
    for (integer a = 0; a < n; ++a) {
      double sum = 0;
      for (integer b = 0; b < n; ++b) sum += u->offsets[i * n + b] * S[a * n + b];
      shifts[i * n + a] = sum;
    }
  const integer* none[] = {0, 0, 0, 0};
  {
    const double* from[] = {x, shifts};
    const integer width[] = {0, n};
    double* const to[] = {points};
    f->points->retract(p, from, width, none, to);
  }
  if (!step_points(f, p, dt, points, moved, stepping)) return 0;
  /* mean: retract(centre, weighted mean of the errors about the centre) */
  {
    const double* from[] = {moved, moved};
    const integer width[] = {0, m};
    double* const to[] = {errors};
    f->points->local(p, from, width, none, to);
    for (integer a = 0; a < n; ++a) error[a] = 0;
    for (integer i = 0; i < p; ++i)
      for (integer a = 0; a < n; ++a) error[a] += u->mean_weights[i] * errors[i * n + a];
    const double* about[] = {moved, error};
    const integer one[] = {0, 0};
    double* const mean[] = {at.after};
    f->points->retract(1, about, one, none, mean);
  }
  /* rows: weighted errors about the mean, then the noise' */
  {
    const double* from[] = {at.after, moved};
    const integer width[] = {0, m};
    double* const to[] = {rows};
    f->points->local(p, from, width, none, to);
  }
  for (integer i = 0; i < p; ++i)
    for (integer a = 0; a < n; ++a) rows[i * n + a] *= u->root_weights[i];
  return rows;
}

/* `predict` of an unscented filter: the factor of [deviations | noise]. */
static int predict_sigma(const Filter* f, double dt, double* x, double* S, double* room) {
  const integer n = f->n, p = f->sigma->points, k = f->noise;
  const Step at = parts_of(f, room);
  double* rows = spread_sigma(f, dt, x, S, room);
  if (!rows) return 0;
  for (integer b = 0; b < k; ++b)
    for (integer a = 0; a < n; ++a) rows[(p + b) * n + a] = at.noise[a * k + b];
  f->triangle(rows, p + k, n, n, 1, S);
  memcpy(x, at.after, f->point * sizeof(double));
  return 1;
}

/* Numbers of the room of `predict` and of `spread_sigma`. */
static integer step_room(const Filter* f) {
  const integer n = f->n;
  return f->errors + 4 * n * n + 2 * n * f->noise + f->point + sigma_room(f);
}

/* `linearise_process` of an unscented filter: mean [m], deviations [points][n], transition [n][n] and noise factor [n][k]; 0 where
 * it needs more than what is built. */
integer spread(const Filter* f, double dt, const double* x, const double* S, double* mean, double* deviations, double* transition,
               double* noise) {
  const integer n = f->n;
  double* room = malloc(step_room(f) * sizeof(double));
  const double* rows = room ? spread_sigma(f, dt, x, S, room) : 0;
  if (rows) {
    const Step at = parts_of(f, room);
    memcpy(mean, at.after, f->point * sizeof(double));
    memcpy(deviations, rows, f->sigma->points * n * sizeof(double));
    memcpy(transition, at.transition, n * n * sizeof(double));
    memcpy(noise, at.noise, n * f->noise * sizeof(double));
  }
  free(room);
  return rows != 0;
}
