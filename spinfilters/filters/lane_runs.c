/* Many runs of a first-order filter through the same epochs, a run in each lane of a vector; `epoch_run.c`, which stands before this
 * text with the definition of LANES, says what an epoch computes. Covariances are those of single runs to rounding. Their factors S
 * are nearly upper triangular instead of lower: with the constants last, these keep their rows in a prediction,
 *
 *     S = [S1 S2]    Phi = [F B]    Phi S = [F S1  F S2 + B S3]
 *         [0  S3],         [0 1],           [0          S3    ],
 *
 * and only [F S1 | noise] is made triangular again. What ends a run of `take_in` ends the run in its lane. */
enum { ALIGNMENT = 8 * LANES, BLOCK = 4 };
typedef double lane __attribute__((vector_size(ALIGNMENT), may_alias));
typedef integer mask __attribute__((vector_size(ALIGNMENT), may_alias));
static const double TINY = 1e-280; /* a sum of squares that counts as zero: the inverse of a smaller one may be none */

/* Places of the numbers that a matrix may hold. */
typedef struct {
  integer count;
  const integer *row, *column;
} Entries;

/* What lanes need besides a `Filter`: the linearised step in fewest << j substeps, `each[j]` their numbers; how many errors come
 * before the constants, which stay and gather no noise; the entries that the step gives of transition and noise factor; many
 * retractions, and the entries of reset Jacobians. */
typedef struct {
  Scan* step;
  integer fewest;
  const double* const* each;
  integer moving;
  Entries transition, noise;
  Sighted *retract, *reset;
  Entries reset_entries;
} Lanes;

/* Arrays of a group of runs. Of lanes: factor S [n][n] and room for it, root U [n][n + 1], rows [most rows][n + 1], inverse diagonal
 * [n], error [n]; of each run by itself: x [LANES][m] and the rest. `first[i]`: first column of row i of S that may not be zero. */
typedef struct {
  lane *S, *spare, *U, *rows, *inverse, *error;
  double *x, *mean, *after, *step_error, *transition, *noise, *errors, *shift, *reset, *innovation, *jacobian, *valid, *log_noise;
  double *again, *bending; /* room of `is_linear`, and of `widen_lanes` */
  integer *first, *x_rows, *value_rows;
  Last* last;
  integer moving;
} Group;

/* Numbers where a lane is chosen, others elsewhere. */
static inline lane chosen(mask is, lane yes, lane no) { return (lane)(((mask)yes & is) | ((mask)no & ~is)); }

static inline lane roots(lane square) {
  lane root;
  for (int l = 0; l < LANES; ++l) root[l] = sqrt(square[l]);
  return root;
}

/* Reflections of `count` rows of `columns` numbers into U U' = rows' rows, U upper triangular and row by row at this pitch; what is
 * below the diagonal is not written. The last column comes first, so that pivot row r holds column `columns` - 1 - r of U. */
static void upper_factor(lane* restrict rows, integer count, integer columns, lane* restrict U, integer pitch) {
  for (integer j = columns - 1; j >= 0; --j) {
    lane *top = rows + (columns - 1 - j) * columns, square = {0};
    const integer below = count - (columns - 1 - j) - 1;
    for (integer i = 1; i <= below; ++i) square += top[i * columns + j] * top[i * columns + j];
    /* (top[j], rows[:, j]) to (-+length, 0) */
    const lane alpha = top[j], length = roots(alpha * alpha + square), head = chosen(alpha > 0, alpha + length, alpha - length);
    const lane scale = chosen(square < TINY, (lane){0}, 2 / (head * head + square));
    U[j * pitch + j] = alpha - head * scale * (head * alpha + square);
    /* columns before it, some at a time: top -= head step, rows -= rows[:, j] step */
    for (integer k = 0; k < j; k += BLOCK) {
      const int some = (int)(j - k < BLOCK ? j - k : BLOCK);
      lane step[BLOCK] = {{0}};
      if (some == BLOCK) {
        for (integer i = 1; i <= below; ++i) {
          const lane v = top[i * columns + j];
          for (int b = 0; b < BLOCK; ++b) step[b] += v * top[i * columns + k + b];
        }
      } else {
        for (integer i = 1; i <= below; ++i)
          for (int b = 0; b < some; ++b) step[b] += top[i * columns + j] * top[i * columns + k + b];
      }
      for (int b = 0; b < some; ++b) {
        step[b] = scale * (head * top[k + b] + step[b]);
        U[(k + b) * pitch + j] = top[k + b] - head * step[b];
      }
      for (integer i = 1; i <= below; ++i) {
        const lane v = top[i * columns + j];
        for (int b = 0; b < some; ++b) top[i * columns + k + b] -= v * step[b];
      }
    }
  }
}

/* S as upper triangular as an update leaves it, where it is not. */
static void triangulate(const Group* g, integer n) {
  mask filled = {0};
  for (integer i = 0; i < n; ++i)
    for (integer k = 0; k < g->first[i]; ++k) filled |= g->S[i * n + k] != 0;
  int any = 0;
  for (int l = 0; l < LANES; ++l) any |= filled[l] != 0;
  if (!any) return;
  for (integer i = 0; i < n; ++i)
    for (integer k = 0; k < n; ++k) g->spare[k * n + i] = g->S[i * n + k];
  memset(g->S, 0, n * n * sizeof(lane));
  upper_factor(g->spare, n, n, g->S, n);
}

/* The next substeps' number of each lane that takes a step; -1 for those of which it needs more than are built. */
static void substeps_of(const Filter* f, const double* x, const double* dt, const integer* stepping, integer* j) {
  for (int l = 0; l < LANES; ++l) {
    if (!stepping[l]) continue;
    j[l] = integrator(f, length(x + l * f->point + f->rate, 3) * dt[l]);
    if (j[l] == f->loop_count) j[l] = -1;
  }
}

/* `widen` of the lanes in `stepping`, before their steps of dt; lanes of which that is not possible here leave it. */
static void widen_lanes(const Filter* f, const double* dt, const Group* g, integer* stepping, double (*stretch)[2]) {
  const integer n = f->n;
  double *S = g->bending, *rows = S + n * n, *room = rows + n * n;
  for (int l = 0; l < LANES; ++l) {
    if (!stepping[l] || !f->curvature || !(stretch[l][0] < dt[l] / 2)) continue;
    for (integer k = 0; k < n * n; ++k) S[k] = ((const double*)(g->S + k))[l];
    stepping[l] = widen(f, dt[l], g->x + l * f->point, S, n, stretch[l], room);
    /* an upper triangle, as an update leaves it: that of the rows in reverse order is lower */
    for (integer i = 0; i < n; ++i)
      for (integer k = 0; k < n; ++k) rows[k * n + n - 1 - i] = S[i * n + k];
    f->triangle(rows, n, n, n, 1, S);
    for (integer i = 0; i < n; ++i)
      for (integer k = 0; k < n; ++k) ((double*)(g->S + i * n + k))[l] = S[(n - 1 - i) * n + n - 1 - k];
  }
}

/* Prediction of the lanes in `stepping`, each over its own dt: x and S are replaced; lanes of which that is not possible leave it. */
static void predict_lanes(const Filter* f, const Lanes* lanes, const double* dt, const Group* g, integer* stepping) {
  const integer n = f->n, m = f->point, moving = g->moving, T = lanes->transition.count, G = lanes->noise.count;
  integer j[LANES];
  lane *made_T = g->U, *made_G = made_T + T; /* the entries side by side; U is not needed yet */
  double h[LANES];
  substeps_of(f, g->x, dt, stepping, j);
  for (integer level = 0; level < f->loop_count; ++level) {
    int any = 0;
    for (int l = 0; l < LANES; ++l) any |= stepping[l] && j[l] == level;
    if (!any) continue;
    const integer count = lanes->fewest << level;
    for (int l = 0; l < LANES; ++l) h[l] = dt[l] / (double)count;
    const double* from[] = {g->x, dt, h, f->densities};
    const integer width[] = {m, 1, 1, 0}, *none[] = {0, 0, 0, 0};
    double* const to[] = {g->after, g->step_error, g->transition, g->noise};
    lanes->step(LANES, from, width, none, to, count, lanes->each[level]);
    for (int l = 0; l < LANES; ++l) {
      if (!stepping[l] || j[l] != level) continue;
      int exact = 1;
      for (integer e = 0; e < f->errors; ++e) exact &= g->step_error[l * f->errors + e] <= f->tolerance;
      if (!exact) j[l] = -1;
      for (integer e = 0; e < T; ++e) ((double*)(made_T + e))[l] = g->transition[l * T + e];
      for (integer e = 0; e < G; ++e) ((double*)(made_G + e))[l] = g->noise[l * G + e] * f->scales[lanes->noise.column[e]];
      memcpy(g->mean + l * m, g->after + l * m, m * sizeof(double));
    }
  }
  mask moved = {0};
  for (int l = 0; l < LANES; ++l) {
    if (stepping[l] && j[l] < 0) stepping[l] = 0;
    if (!stepping[l]) continue;
    moved[l] = -1;
    memcpy(g->x + l * m, g->mean + l * m, m * sizeof(double));
  }
  /* product [n][moving]: column k of (transition S)[:moving] in row k; behind those of the moving errors the noise' */
  lane* product = g->spare;
  memset(product, 0, (n + f->noise) * moving * sizeof(lane));
  for (integer e = 0; e < T; ++e) {
    const integer i = lanes->transition.row[e], r = lanes->transition.column[e];
    if (i >= moving) continue;
    const lane phi = made_T[e], *row = g->S + r * n;
    for (integer k = g->first[r]; k < n; ++k) product[k * moving + i] += phi * row[k];
  }
  /* Rows of the moving errors: those of the constants keep their columns. */
  for (integer i = 0; i < moving; ++i)
    for (integer k = moving; k < n; ++k)
      g->S[i * n + k] = chosen(moved, product[k * moving + i], g->S[i * n + k]);
  memset(product + moving * moving, 0, f->noise * moving * sizeof(lane));
  for (integer e = 0; e < G; ++e)
    product[(moving + lanes->noise.column[e]) * moving + lanes->noise.row[e]] = made_G[e];
  upper_factor(product, moving + f->noise, moving, g->U, n);
  for (integer i = 0; i < moving; ++i)
    for (integer k = g->first[i]; k < moving; ++k)
      g->S[i * n + k] = chosen(moved, k < i ? (lane){0} : g->U[i * n + k], g->S[i * n + k]);
}

/* U'U = I + rows' rows of `count` rows [n | innovation], by reflections of [I; rows]: U [n][n + 1] with the shift behind it, and
 * 1 / U[j][j]; of the innovations remains what no state explains. Returns the log determinant of U. */
static lane root_of(lane* restrict rows, integer count, integer n, lane* restrict U, lane* restrict inverse) {
  const integer w = n + 1;
  lane logs = {0}, product = (lane){0} + 1;
  for (integer j = 0; j < n; ++j) {
    lane square = {0};
    for (integer i = 0; i < count; ++i) square += rows[i * w + j] * rows[i * w + j];
    const lane length = roots(1 + square), share = 1 / length, scale = 1 / (length * (1 + length));
    inverse[j] = share;
    /* a product of a few does not overflow */
    product *= length;
    if (j % BLOCK == BLOCK - 1 || j + 1 == n) {
      for (int l = 0; l < LANES; ++l) logs[l] += log(product[l]);
      product = (lane){0} + 1;
    }
    for (integer k = j + 1; k < w; k += BLOCK) {
      const int some = (int)(w - k < BLOCK ? w - k : BLOCK);
      lane sum[BLOCK] = {{0}};
      for (integer i = 0; i < count; ++i) {
        const lane v = rows[i * w + j];
        for (int b = 0; b < some; ++b) sum[b] += v * rows[i * w + k + b];
      }
      for (int b = 0; b < some; ++b) {
        U[j * w + k + b] = sum[b] * share;
        sum[b] *= scale;
      }
      for (integer i = 0; i < count; ++i) {
        const lane v = rows[i * w + j];
        for (int b = 0; b < some; ++b) rows[i * w + k + b] -= v * sum[b];
      }
    }
  }
  return logs;
}

/* S <- S U^-1 by forward substitution, some rows at a time; error = S shift. */
static void divide_lanes(const Group* g, integer n) {
  const integer w = n + 1;
  for (integer i = 0; i < n; i += BLOCK) {
    const int some = (int)(n - i < BLOCK ? n - i : BLOCK);
    integer begin = n;
    for (int b = 0; b < some; ++b) begin = g->first[i + b] < begin ? g->first[i + b] : begin;
    lane error[BLOCK] = {{0}};
    for (integer j = begin; j < n; ++j) {
      lane sum[BLOCK];
      for (int b = 0; b < some; ++b) sum[b] = g->S[(i + b) * n + j];
      for (integer k = begin; k < j; ++k) {
        const lane u = g->U[k * w + j];
        for (int b = 0; b < some; ++b) sum[b] -= g->S[(i + b) * n + k] * u;
      }
      for (int b = 0; b < some; ++b) {
        sum[b] *= g->inverse[j];
        g->S[(i + b) * n + j] = sum[b];
        error[b] += sum[b] * g->U[j * w + n];
      }
    }
    for (int b = 0; b < some; ++b) g->error[i + b] = error[b];
  }
}

/* S <- J S by the entries of the reset Jacobian of each lane, where a lane has values. */
static void reset_lanes(const Lanes* lanes, const Group* g, integer n, mask corrected) {
  const integer count = lanes->reset_entries.count;
  memset(g->spare, 0, n * n * sizeof(lane));
  for (integer e = 0; e < count; ++e) {
    const integer i = lanes->reset_entries.row[e], r = lanes->reset_entries.column[e];
    lane entry;
    for (int l = 0; l < LANES; ++l) entry[l] = g->reset[l * count + e];
    for (integer k = g->first[r]; k < n; ++k) g->spare[i * n + k] += entry * g->S[r * n + k];
  }
  for (integer i = 0; i < n; ++i)
    for (integer k = g->first[i]; k < n; ++k)
      g->S[i * n + k] = chosen(corrected, g->spare[i * n + k], g->S[i * n + k]);
}

/* What an epoch adds to a run's row. */
typedef struct {
  double nis, likelihood;
  integer dof, accepted, rejected;
} Sums;

/* Values of one sensor in an epoch: of each lane its first value's row among those of all runs, and how many. */
typedef struct {
  integer row[LANES], count[LANES], most;
} Values;

/* Innovations and Jacobians of all lanes' values, whitened, into g, and [jacobian S | innovation] of those within the gate into
 * g->rows; others are zero there. used[l] becomes how many, or -1 where one is invalid. */
static void rows_of(const Filter* f, const Sensor* s, const Values* v, const Group* g, integer* used) {
  const integer n = f->n, w = n + 1, dim = s->model->dim, C = s->columns, most = v->most;
  for (int l = 0; l < LANES; ++l)
    for (integer i = 0; i < most; ++i) {
      g->x_rows[l * most + i] = l;
      g->value_rows[l * most + i] = i < v->count[l] ? v->row[l] + i : 0;
    }
  const double* from[] = {g->x, s->parameters, s->values};
  const integer pitch[] = {f->point, s->model->width, s->model->components};
  const integer* places[] = {g->x_rows, g->value_rows, g->value_rows};
  double* const to[] = {g->innovation, g->jacobian, g->valid, g->log_noise};
  s->model->linearise(LANES * most, from, pitch, places, to);
  const double scale = sqrt(s->weight);
  if (s->weight != 1) {
    for (integer k = 0; k < LANES * most * dim; ++k) g->innovation[k] *= scale;
    for (integer k = 0; k < LANES * most * dim * C; ++k) g->jacobian[k] *= scale;
  }
  for (integer i = 0; i < most; ++i) {
    /* rows of value i: jacobian S, lane by lane put side by side */
    lane* rows = g->rows + i * dim * w;
    memset(rows, 0, dim * w * sizeof(lane));
    for (integer d = 0; d < dim; ++d) {
      for (integer c = 0; c < C; ++c) {
        lane entry;
        for (int l = 0; l < LANES; ++l) entry[l] = g->jacobian[((l * most + i) * dim + d) * C + c];
        const integer r = s->model->columns[c];
        for (integer k = g->first[r]; k < n; ++k) rows[d * w + k] += entry * g->S[r * n + k];
      }
      for (int l = 0; l < LANES; ++l) ((double*)(rows + d * w + n))[l] = g->innovation[(l * most + i) * dim + d];
    }
    mask kept = {0};
    for (int l = 0; l < LANES; ++l) {
      const integer at = l * most + i;
      if (i >= v->count[l] || used[l] < 0) continue;
      double square = 0, own[MOST_DIM];
      for (integer d = 0; d < dim; ++d) {
        own[d] = g->innovation[at * dim + d];
        square += own[d] * own[d];
      }
      if (!(g->valid[at] > 0 && square < INFINITY)) {
        used[l] = -1;
        continue;
      }
      int within = square <= s->limit;
      if (!within) {
        double* Y = g->again; /* [dim][n] of this lane */
        for (integer d = 0; d < dim; ++d)
          for (integer k = 0; k < n; ++k) Y[d * n + k] = ((double*)(rows + d * w + k))[l];
        within = distance(own, Y, dim, n) <= s->limit;
      }
      if (!within) continue;
      kept[l] = -1;
      ++used[l];
    }
    for (integer k = 0; k < dim * w; ++k) rows[k] = (lane)((mask)rows[k] & kept);
    for (int l = 0; l < LANES; ++l) g->valid[l * most + i] = kept[l] ? 1 : 0;
  }
}

/* Update of all lanes with values: x, S and sums are replaced; lanes that need more than this leave `live`. */
static void update_lanes(const Filter* f, const Lanes* lanes, const Sensor* s, const Values* v, const Group* g, integer* live,
                         Sums* sums) {
  const integer n = f->n, w = n + 1, m = f->point, dim = s->model->dim, C = s->columns, most = v->most;
  integer used[LANES] = {0};
  rows_of(f, s, v, g, used);
  const lane log_root = root_of(g->rows, most * dim, n, g->U, g->inverse);
  lane nis = {0};
  for (integer i = 0; i < most * dim; ++i) nis += g->rows[i * w + n] * g->rows[i * w + n];
  divide_lanes(g, n);
  /* error and shift of each lane by itself: shift = what the root makes of the innovations */
  for (int l = 0; l < LANES; ++l)
    for (integer k = 0; k < n; ++k) {
      g->errors[l * n + k] = ((double*)(g->error + k))[l];
      g->shift[l * n + k] = ((double*)(g->U + k * w + n))[l];
    }
  const double *about[] = {g->x, g->errors}, *error[] = {g->errors};
  const integer pitch[] = {m, n}, *none[] = {0, 0}, error_pitch[] = {n};
  double *const point[] = {g->mean}, *const entries[] = {g->reset};
  lanes->retract(LANES, about, pitch, none, point);
  lanes->reset(LANES, error, error_pitch, none, entries);
  const double logs = log(sqrt(s->weight)) * (double)dim;
  mask corrected = {0};
  for (int l = 0; l < LANES; ++l) {
    const integer count = v->count[l];
    if (!live[l] || !count) continue;
    const double *parameters = s->parameters + v->row[l] * s->model->width, *values = s->values + v->row[l] * s->model->components;
    /* so few that the state is doubted, or the linear model does not hold */
    if (used[l] < 1 || (double)used[l] < AGREEING_SHARE * (double)count ||
        !is_linear(f, s, count, used[l], g->x + l * m, parameters, values, g->innovation + l * most * dim,
                   g->jacobian + l * most * dim * C, g->errors + l * n, g->shift + l * n, g->mean + l * m, g->again)) {
      live[l] = 0;
      continue;
    }
    corrected[l] = -1;
    double log_noise = 0;
    for (integer i = 0; i < count; ++i)
      if (g->valid[l * most + i] > 0) log_noise += g->log_noise[l * most + i] - logs;
    sums[l].nis += nis[l];
    sums[l].likelihood += -0.5 * (nis[l] + (double)(used[l] * dim) * 1.8378770664093453) - log_root[l] - log_noise;
    sums[l].dof += used[l] * dim;
    sums[l].accepted += used[l];
    sums[l].rejected += count - used[l];
    memcpy(g->x + l * m, g->mean + l * m, m * sizeof(double));
  }
  reset_lanes(lanes, g, n, corrected);
}

/* First columns of the rows of S that an update leaves, and the moving errors: all where a reset mixes them with the constants. */
static void profile(const Lanes* lanes, integer n, Group* g) {
  const Entries* reset = &lanes->reset_entries;
  for (integer i = 0; i < n; ++i) g->first[i] = i;
  for (int changed = 1; changed;) {
    changed = 0;
    for (integer e = 0; e < reset->count; ++e)
      if (g->first[reset->column[e]] < g->first[reset->row[e]]) {
        g->first[reset->row[e]] = g->first[reset->column[e]];
        changed = 1;
      }
  }
  g->moving = lanes->moving;
  for (integer i = g->moving; i < n; ++i)
    if (g->first[i] < lanes->moving) g->moving = n;
}

/* `count` runs from run `begin` on through their epochs, as a group. */
static void take_in_group(const Filter* f, const Lanes* lanes, integer sensors, const Sensor* sensor, const integer* values_per_run,
                          integer epochs, const double* dt, const double* mean, const double* factor, const double* first_stretch,
                          const Group* g, const Rows* to, integer begin, int count, integer* done) {
  const integer n = f->n, m = f->point;
  integer live[LANES] = {0}, epoch[LANES] = {0};
  double stretch[LANES][2];
  /* lanes without a run copy the first and are not looked at */
  for (int l = 0; l < LANES; ++l) {
    const integer r = begin + (l < count ? l : 0);
    live[l] = l < count;
    memcpy(stretch[l], first_stretch, sizeof stretch[l]);
    memcpy(g->x + l * m, mean + r * m, m * sizeof(double));
    for (integer k = 0; k < n * n; ++k) ((double*)(g->S + k))[l] = factor[r * n * n + k];
    for (integer i = 0; i < sensors; ++i) g->last[l * sensors + i] = (Last){sensor[i].before, sensor[i].before_count};
  }
  triangulate(g, n);
  for (;;) {
    integer stepping[LANES], any = 0, waits[LANES];
    double step[LANES];
    Sums sums[LANES] = {{0}};
    /* lanes that have an epoch left, and of these the ones that predict: a belief may be of the first epoch itself */
    for (int l = 0; l < LANES; ++l) {
      live[l] = live[l] && epoch[l] < epochs;
      any |= live[l];
      step[l] = dt[epoch[l] < epochs ? epoch[l] : 0];
      stepping[l] = live[l] && step[l] > 0;
      waits[l] = live[l] && !stepping[l];
    }
    if (!any) return;
    widen_lanes(f, step, g, stepping, stretch);
    predict_lanes(f, lanes, step, g, stepping);
    for (int l = 0; l < LANES; ++l) live[l] = stepping[l] || waits[l];
    /* sensors in turn, each on the state after the one before */
    for (integer i = 0; i < sensors; ++i) {
      const Sensor* s = sensor + i;
      Values v = {.most = 0};
      for (int l = 0; l < LANES; ++l) {
        if (!live[l]) continue;
        Last* last = g->last + l * sensors + i;
        v.row[l] = (begin + l) * values_per_run[i] + s->first[epoch[l]];
        v.count[l] = s->end[epoch[l]] - s->first[epoch[l]];
        if (!v.count[l]) continue;
        const double* values = s->values + v.row[l] * s->model->components;
        if (may_repeat(values, v.count[l], last->values, last->count, s->model->components)) {
          live[l] = v.count[l] = 0;
          continue;
        }
        *last = (Last){values, v.count[l]};
        v.most = v.count[l] > v.most ? v.count[l] : v.most;
      }
      if (v.most) update_lanes(f, lanes, s, &v, g, live, sums);
    }
    /* a number times zero is zero where it is finite */
    lane finite = {0};
    for (integer k = 0; k < n * n; ++k) finite += g->S[k] * 0;
    for (int l = 0; l < LANES; ++l) {
      if (!live[l]) continue;
      if (!(finite[l] == 0) || !isfinite(sums[l].nis + sums[l].likelihood) || !all_finite(g->x + l * m, m)) {
        live[l] = 0;
        continue;
      }
      const integer row = (begin + l) * epochs + epoch[l];
      memcpy(to->mean + row * m, g->x + l * m, m * sizeof(double));
      double* own = to->factor + row * n * n;
      for (integer k = 0; k < n * n; ++k) own[k] = ((const double*)(g->S + k))[l];
      to->nis[row] = sums[l].nis;
      to->likelihood[row] = sums[l].likelihood;
      to->dof[row] = sums[l].dof;
      to->accepted[row] = sums[l].accepted;
      to->rejected[row] = sums[l].rejected;
      stretch[l][0] -= step[l];
      done[begin + l] = ++epoch[l];
    }
  }
}

/* Memory of a group, in one piece: 0 where there is none. */
static void* allocate(const Filter* f, const Lanes* lanes, integer sensors, integer most, integer width, Group* g) {
  const integer n = f->n, m = f->point, k = f->noise, T = lanes->transition.count, G = lanes->noise.count;
  const integer entries = T + G, root = n * (n + 1), values = LANES * most;
  const integer wide = n * n + (n + k) * n + (entries > root ? entries : root) + most * MOST_DIM * (n + 1) + 2 * n;
  const integer plain = LANES * (3 * m + f->errors + entries + 2 * n + lanes->reset_entries.count) + values * (width + MOST_DIM) +
                        most * width + MOST_DIM * n + 2 * n * n + widening_room(f, n);
  const size_t bytes = wide * sizeof(lane) + plain * sizeof(double) + (n + 2 * values) * sizeof(integer) +
                       LANES * sensors * sizeof(Last) + ALIGNMENT;
  void* all = calloc(1, bytes);
  if (!all) return 0;
  g->S = (lane*)(((size_t)all + ALIGNMENT - 1) / ALIGNMENT * ALIGNMENT);
  g->spare = g->S + n * n;
  g->U = g->spare + (n + k) * n;
  g->rows = g->U + (entries > root ? entries : root);
  g->inverse = g->rows + most * MOST_DIM * (n + 1);
  g->error = g->inverse + n;
  g->x = (double*)(g->error + n);
  g->mean = g->x + LANES * m;
  g->after = g->mean + LANES * m;
  g->step_error = g->after + LANES * m;
  g->transition = g->step_error + LANES * f->errors;
  g->noise = g->transition + LANES * T;
  g->errors = g->noise + LANES * G;
  g->shift = g->errors + LANES * n;
  g->reset = g->shift + LANES * n;
  /* of a value at most `width` numbers, of which two are its validity and the logarithm of its noise */
  g->innovation = g->reset + LANES * lanes->reset_entries.count;
  g->jacobian = g->innovation + values * MOST_DIM;
  g->valid = g->jacobian + values * (width - 2);
  g->log_noise = g->valid + values;
  g->again = g->log_noise + values;
  g->bending = g->again + most * width + MOST_DIM * n;
  g->first = (integer*)(g->bending + 2 * n * n + widening_room(f, n));
  g->x_rows = g->first + n;
  g->value_rows = g->x_rows + values;
  g->last = (Last*)(g->value_rows + values);
  return all;
}

/* Each of many runs of the same epochs: run r is at mean[r] and factor[r] before, and has each sensor's values and parameters
 * `values_per_run` rows behind those of the run before. `stretch` of `widen`, of all runs before the first epoch. There is room for
 * `epochs` rows of each run; done[r] becomes how many epochs were taken in. */
void take_in_runs(const Filter* f, const Lanes* lanes, integer sensors, const Sensor* sensor, const integer* values_per_run,
                  integer runs, integer epochs, const double* dt, const double* mean, const double* factor, integer most,
                  integer width, const double* stretch, const Rows* to, integer* done) {
  Group g;
  void* all = allocate(f, lanes, sensors, most, width, &g);
  if (!all) return;
  profile(lanes, f->n, &g);
  for (integer r = 0; r < runs; r += LANES) {
    const int count = (int)(runs - r < LANES ? runs - r : LANES);
    take_in_group(f, lanes, sensors, sensor, values_per_run, epochs, dt, mean, factor, stretch, &g, to, r, count, done);
  }
  free(all);
}
