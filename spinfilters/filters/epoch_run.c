/* Consecutive epochs of a first-order filter or an unscented one in one call, each as by itself; the functions called here,
 * compiled apart, compute it. `filter_step.c` and `flow_curvature.c` stand before this text, and the definitions of
 * FEWEST_DUPLICATES, DUPLICATE_SAMPLE, LINEAR_SAMPLE and AGREEING_SHARE. */

/* A sensor's `Model` of `update.c`. */
typedef struct {
  Sighted* linearise;
  Loop *retract, *reset;
  const integer* columns;
  integer point, width, components, dim;
} Model;

/* `update` of `update.c`. */
typedef integer Update(const Model*, integer count, const double* x, const double* parameters, const double* values, double weight,
                       double limit, const double* before, double* room, double* made);

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
  Sighted* beside; /* innovations at sigma points, of an unscented filter */
} Sensor;

/* What epochs leave behind, a row each (`EPOCH_ARRAYS`). */
typedef struct {
  double *mean, *factor, *nis, *likelihood;
  integer *dof, *accepted, *rejected;
} Rows;

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

/* `is_small` or `linear_model_holds` of an update from x to the mean. */
static int is_linear(const Filter* f, const Sensor* s, integer count, integer used, const double* x, const double* parameters,
                     const double* values, const double* innovation, const double* jacobian, const double* error,
                     const double* shift, const double* mean, double* rows) {
  const integer n = f->n, dim = s->model->dim, C = s->columns;
  double curvature = f->attitude < 0 ? INFINITY : length(error + f->attitude, 3);
  if (f->position >= 0) {
    const double away = length(x + f->place, 3);
    curvature += length(error + f->position, 3) / (away > f->nearest ? away : f->nearest);
  }
  if (length(shift, n) * curvature <= f->iteration) return 1;
  if (used < count) return 0; /* rejected values are no evidence on the linear model */
  /* `sample_rows`: every `spacing`th value, each for so many */
  const integer spacing = (count + LINEAR_SAMPLE - 1) / LINEAR_SAMPLE, some = (count + spacing - 1) / spacing;
  const double root = sqrt(s->weight);
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

enum { MOST_DIM = 8 };

/* Squared distance of a whitened innovation of covariance I + Y Y', Y [dim][columns]: infinite where that is not definite. */
static double distance(const double* innovation, const double* Y, integer dim, integer columns) {
  double L[MOST_DIM * MOST_DIM], y[MOST_DIM], square = 0;
  /* row d of the Cholesky factor, and forward substitution of the innovation */
  for (integer d = 0; d < dim; ++d) {
    double rest = innovation[d];
    for (integer e = 0; e <= d; ++e) {
      double sum = d == e;
      for (integer k = 0; k < columns; ++k) sum += Y[d * columns + k] * Y[e * columns + k];
      for (integer k = 0; k < e; ++k) sum -= L[d * MOST_DIM + k] * L[e * MOST_DIM + k];
      if (e == d && !(sum > 0)) return INFINITY;
      L[d * MOST_DIM + e] = e == d ? sqrt(sum) : sum / L[e * MOST_DIM + e];
    }
    for (integer e = 0; e < d; ++e) rest -= L[d * MOST_DIM + e] * y[e];
    y[d] = rest / L[d * MOST_DIM + d];
    square += y[d] * y[d];
  }
  return square;
}

/* Numbers of the room of `update_sigma`, and of its index arrays, for at most so many values of so many components. */
static integer update_room(const Filter* f, integer most, integer dim) {
  const integer n = f->n, q = f->sigma ? f->sigma->points : 0, w = q + 1;
  const integer pairs = most * q;
  return q ? q * (n + f->point) + pairs * (dim + 2) + most * dim * (w + 1) + 4 * w * w + n * (3 * n + 4) + dim * w : 0;
}

/* `update` of an unscented filter, `predict_measurement` of `ukf.py` and `square_root_update`: x and S are replaced, nis, log
 * likelihood and the number of values used are written. 0 where something is not finite, or no value passes: then nothing is done.
 */
static integer update_sigma(const Filter* f, const Sensor* s, integer count, double* x, const double* parameters,
                            const double* values, double* S, double* room, integer* index, double* nis, double* likelihood) {
  const Sigma* u = f->sigma;
  const integer n = f->n, m = f->point, dim = s->model->dim;
  /* The measurement moves with the first r columns of the factor alone: centre, plus and minus points of these. */
  integer r = 1;
  for (integer c = 0; c < s->columns; ++c)
    for (integer b = r; b < n; ++b)
      if (S[s->model->columns[c] * n + b] != 0) r = b + 1;
  const integer q = 2 * r + 1, w = q + 1, pairs = count * q, *none[] = {0, 0, 0, 0};
  const double offset = u->offsets[n], unseen = (double)(2 * (n - r)), side = u->root_weights[1];
  const double centre = u->mean_weights[0] + unseen * u->mean_weights[1], share = side / sqrt(2.0);
  const double mixed = sqrt(u->root_weights[0] * u->root_weights[0] + unseen * side * side);
  double *shifts = room, *points = shifts + q * n, *innovation = points + q * m, *valid = innovation + pairs * dim;
  double *determinant = valid + pairs, *rho = determinant + pairs, *rows = rho + count * dim, *R = rows + count * dim * w;
  double *block = R + w * w, *U = block + 2 * w * w, *turned = U + w * w, *root = turned + dim * w;
  double *error = root + n * n, *mean = error + n, *factor = mean + m, *J = factor + n * n;
  for (integer a = 0; a < n; ++a) {
    shifts[a] = 0;
    for (integer b = 0; b < r; ++b) {
      shifts[(1 + b) * n + a] = offset * S[a * n + b];
      shifts[(1 + r + b) * n + a] = -shifts[(1 + b) * n + a];
    }
  }
  const double *about[] = {x, shifts}, *sight[] = {points, x, parameters, values};
  const integer width[] = {0, n}, pitch[] = {m, 0, s->model->width, s->model->components};
  double *const to[] = {points}, *const seen[] = {innovation, valid, determinant};
  f->points->retract(q, about, width, none, to);
  /* every value beside every point, those of a value together */
  for (integer i = 0; i < count; ++i)
    for (integer k = 0; k < q; ++k) {
      index[i * q + k] = k;
      index[pairs + i * q + k] = i;
    }
  const integer* chosen[] = {index, 0, index + pairs, index + pairs};
  s->beside(pairs, sight, pitch, chosen, seen);
  if (!all_finite(innovation, pairs * dim)) return 0;
  for (integer i = 0; i < pairs; ++i)
    if (!(valid[i] > 0)) return 0;
  const double scale = sqrt(s->weight), logs = log(scale) * (double)dim;
  double log_noise = 0;
  integer used = 0;
  for (integer i = 0; i < count; ++i) {
    double *mine = innovation + i * q * dim, *own = rho + i * dim, square = 0;
    /* mean over the points: the centre takes the weight of all that coincide with it */
    for (integer d = 0; d < dim; ++d) {
      double sum = centre * mine[d];
      for (integer k = 1; k < q; ++k) sum += u->mean_weights[k] * mine[k * dim + d];
      own[d] = sum * scale;
      square += own[d] * own[d];
    }
    for (integer k = 0; k < q * dim; ++k) mine[k] *= scale;
    if (!(square <= s->limit)) {
      /* deviations into centre and sums, then differences of the pairs: [dim][q] */
      for (integer d = 0; d < dim; ++d) {
        turned[d * q] = mixed * (own[d] - mine[d]);
        for (integer k = 1; k <= r; ++k) {
          const double plus = own[d] - mine[k * dim + d], minus = own[d] - mine[(k + r) * dim + d];
          turned[d * q + k] = share * (plus + minus);
          turned[d * q + k + r] = share * (plus - minus);
        }
      }
      if (!(distance(own, turned, dim, q) <= s->limit)) continue;
    }
    /* rows [deviations | innovation] of the values inside the gate */
    for (integer d = 0; d < dim; ++d) {
      double* row = rows + (used * dim + d) * w;
      for (integer k = 0; k < q; ++k) row[k] = own[d] - mine[k * dim + d];
      row[q] = own[d];
    }
    log_noise += log(determinant[i * q]) - logs;
    ++used;
  }
  if (!used) return 0;
  /* compressed: R = L' of [H | y], and what no state explains */
  f->triangle(rows, used * dim, w, w, 1, R);
  const double residual = R[q * w + q] * R[q * w + q];
  /* [H mixing, y; 1, 0]: its triangle holds U and the shift */
  memset(block, 0, 2 * w * w * sizeof(double));
  for (integer i = 0; i < q; ++i) {
    double* row = block + i * w;
    row[0] = mixed * R[i];
    for (integer k = 1; k <= r; ++k) {
      const double plus = R[k * w + i], minus = R[(k + r) * w + i];
      row[k] = share * (plus + minus);
      row[k + r] = share * (plus - minus);
    }
    row[q] = R[q * w + i];
    block[(q + i) * w + i] = 1;
  }
  f->triangle(block, 2 * q, w, w, 1, U); /* U [w][w] is the transpose: U'[j][i] */
  double log_root = 0;
  for (integer j = 0; j < q; ++j) log_root += log(fabs(U[j * w + j]));
  *nis = U[q * w + q] * U[q * w + q] + residual;
  *likelihood = -0.5 * (*nis + (double)(used * dim) * 1.8378770664093453) - log_root - log_noise;
  /* U22' Z = S1', the first r columns of the factor by the block of the differences; the other columns stay. error = Z' shift. */
  for (integer a = 0; a < n; ++a) error[a] = 0;
  for (integer j = 0; j < n; ++j) {
    double* z = root + j * n;
    for (integer a = 0; a < n; ++a) z[a] = S[a * n + j];
    if (j >= r) continue;
    const double* line = U + (r + 1 + j) * w + r + 1;
    for (integer k = 0; k < j; ++k)
      for (integer a = 0; a < n; ++a) z[a] -= line[k] * root[k * n + a];
    for (integer a = 0; a < n; ++a) {
      z[a] /= line[j];
      error[a] += U[q * w + r + 1 + j] * z[a];
    }
  }
  f->triangle(root, n, n, n, 1, factor);
  const double *state[] = {x, error}, *shift[] = {error};
  const integer one[] = {0, 0};
  double *const point[] = {mean}, *const matrix[] = {J};
  if (s->model->retract(1, state, one, point, one) || s->model->reset(1, shift, one, matrix, one)) return 0;
  /* S = J factor; CasADi's matrices lie column by column */
  memset(S, 0, n * n * sizeof(double));
  for (integer i = 0; i < n; ++i)
    for (integer k = 0; k < n; ++k) {
      const double j = J[k * n + i];
      if (j != 0)
        for (integer l = 0; l < n; ++l) S[i * n + l] += j * factor[k * n + l];
    }
  memcpy(x, mean, m * sizeof(double));
  return used;
}

/* `MultiplicativeFilter.predict` of a first-order filter from mean x and factor S [size][size], of which the state has the first n
 * rows and the others do not change with time: to mean, factor, transition [n][n] and noise factor [n][k] after dt. `stretch` of
 * `widen`, before this step and after it. 0 where it needs more than what is built: then nothing is done. */
integer predict_belief(const Filter* f, double dt, const double* x, const double* S, integer size, double* stretch, double* mean,
                       double* after, double* transition, double* noise) {
  const integer n = f->n, k = f->noise, widening = widening_room(f, size), stepping = step_room(f);
  if (!(dt > 0) || (size > n && (!f->triangle || size > LARGEST_FACTOR))) return 0;
  double* room = malloc((size * size + (size + k) * size + (widening > stepping ? widening : stepping)) * sizeof(double));
  if (!room) return 0;
  double *wide = room, *rows = wide + size * size, *rest = rows + (size + k) * size, within[] = {stretch[0], stretch[1]};
  const Step at = parts_of(f, rest);
  memcpy(wide, S, size * size * sizeof(double));
  const int done = widen(f, dt, x, wide, size, within, rest) && linearise_step(f, dt, x, &at);
  if (done) {
    if (size == n) {
      f->propagate(wide, at.transition, at.noise, k, after);
    } else {
      /* the triangle of [F S1 G; S2 0]', S1 the rows of the state: row j is column j of that */
      memset(rows, 0, (size + k) * size * sizeof(double));
      for (integer i = 0; i < n; ++i) {
        for (integer r = 0; r < n; ++r) {
          const double phi = at.transition[i * n + r];
          if (phi != 0)
            for (integer j = 0; j < size; ++j) rows[j * size + i] += phi * wide[r * size + j];
        }
        for (integer b = 0; b < k; ++b) rows[(size + b) * size + i] = at.noise[i * k + b];
      }
      for (integer i = n; i < size; ++i)
        for (integer j = 0; j < size; ++j) rows[j * size + i] = wide[i * size + j];
      f->triangle(rows, size + k, size, size, 1, after);
    }
    memcpy(mean, at.after, f->point * sizeof(double));
    memcpy(transition, at.transition, n * n * sizeof(double));
    memcpy(noise, at.noise, n * k * sizeof(double));
    stretch[0] = within[0] - dt;
    stretch[1] = within[1];
  }
  free(room);
  return done;
}

/* Values of a sensor's latest measurement. */
typedef struct {
  const double* values;
  integer count;
} Last;

/* Takes in epochs until one needs what only single epochs do: it is left undone. Returns how many were taken in. most: values of a
 * sensor in an epoch at most; width: most numbers of a linearised value; `stretch` of `widen`, of which those taken in are passed.
 * */
integer take_in(const Filter* f, integer sensors, const Sensor* sensor, integer epochs, const double* dt, const double* mean,
                const double* factor, integer most, integer width, double* stretch, const Rows* to) {
  const integer n = f->n, m = f->point, widening = widening_room(f, n);
  const integer predicting = step_room(f) > widening ? step_room(f) : widening;
  const integer making = 3 + 2 * n + 3 * n * n + m, updating = update_room(f, most, MOST_DIM);
  double* all = malloc((m + n * n + predicting + making + 2 * most * width + updating) * sizeof(double));
  integer* index = f->sigma ? malloc(2 * (most * f->sigma->points + 1) * sizeof(integer)) : 0;
  Last* last = malloc((sensors + 1) * sizeof(Last));
  if (!all || !last || (f->sigma && !index)) {
    free(all);
    free(last);
    free(index);
    return 0;
  }
  double *x = all, *S = x + m, *room = S + n * n, *made = room + predicting, *rows = made + making;
  double *again = rows + most * width, *spare = again + most * width;
  memcpy(x, mean, m * sizeof(double));
  memcpy(S, factor, n * n * sizeof(double));
  for (integer i = 0; i < sensors; ++i) last[i] = (Last){sensor[i].before, sensor[i].before_count};
  integer done = 0;
  /* an epoch: predict, update by each sensor, write its row; the first that needs more than this is left to the caller, undone */
  for (; done < epochs; ++done) {
    double nis = 0, likelihood = 0;
    integer dof = 0, accepted = 0, rejected = 0, i = 0;
    double within[] = {stretch[0], stretch[1]}; /* the stretch, this epoch included */
    if (!widen(f, dt[done], x, S, n, within, room)) break;
    /* a belief may be of the first epoch itself */
    if (dt[done] > 0 && !(f->sigma ? predict_sigma : predict)(f, dt[done], x, S, room)) break;
    /* sensors in turn, each on the state after the one before */
    for (; i < sensors; ++i) {
      const Sensor* s = sensor + i;
      const integer first = s->first[done], count = s->end[done] - first, dim = s->model->dim;
      if (!count) continue;
      const double *parameters = s->parameters + first * s->model->width, *values = s->values + first * s->model->components;
      if (may_repeat(values, count, last[i].values, last[i].count, s->model->components)) break;
      last[i] = (Last){values, count};
      if (f->sigma) {
        double own_nis, own_likelihood;
        const integer used = update_sigma(f, s, count, x, parameters, values, S, spare, index, &own_nis, &own_likelihood);
        if (!used || (double)used < AGREEING_SHARE * (double)count) break;
        nis += own_nis;
        likelihood += own_likelihood;
        dof += used * dim;
        accepted += used;
        rejected += count - used;
        continue;
      }
      const integer used = s->update(s->model, count, x, parameters, values, s->weight, s->limit, S, rows, made);
      if (!used || (double)used < AGREEING_SHARE * (double)count) break; /* so few that the state is doubted */
      const double *error = made + 2, *moved = made + 3 + 2 * n + 3 * n * n;
      if (!is_linear(f, s, count, used, x, parameters, values, rows, rows + count * dim, error, error + n, moved, again)) break;
      const double log_root = made[2 + 2 * n];
      nis += made[0];
      likelihood += -0.5 * (made[0] + (double)(used * dim) * 1.8378770664093453) - log_root - made[1];
      dof += used * dim;
      accepted += used;
      rejected += count - used;
      memcpy(x, moved, m * sizeof(double));
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
    stretch[0] = within[0] - dt[done];
    stretch[1] = within[1];
  }
  free(all);
  free(last);
  free(index);
  return done;
}
