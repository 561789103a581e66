/* A window linearised about its trajectory: steps along it, and the prior of what was marginalized; types are those of `kernels.h`. The
 * functions called here, compiled apart from CasADi's expressions, give matrices column by column. */

/* The loop of a `Compiled` function, and that of a `VectorisedScan`. */
typedef int Loop(integer count, const double* const* from, const integer* stride, double* const* to, const integer* made);
typedef void Scan(integer count, const double* const* from, const integer* width, const integer* const* rows, double* const* to,
                  integer turns, const double* each);

/* The loop of a `Vectorised` function, whose item i takes row rows[k][i] of argument k, or row i where there are none. */
typedef void Lanes(integer count, const double* const* from, const integer* width, const integer* const* rows, double* const* to);

/* Observations of one sensor at the points [.][m] of their epochs and their landmarks [.][3]: rows [count][3][10], and squares of
 * their innovations, infinite where the model does not apply. room holds two numbers an observation. */
void linearise_observations(Lanes* lanes, integer count, const double* trajectory, const double* points, const double* parameters,
                            const double* values, const integer* epoch, const integer* landmark, integer m, integer p, integer z,
                            double scale, double* rows, double* square, double* room) {
  const double *from[] = {trajectory, points, parameters, values}, *valid = room;
  const integer width[] = {m, 3, p, z}, *const taken[] = {epoch, landmark, 0, 0};
  double* const to[] = {rows, room, square, room + count};
  lanes(count, from, width, taken, to);
  for (integer i = 0; i < count; ++i)
    if (!(valid[i] > 0 && square[i] < INFINITY)) square[i] = INFINITY;
  if (scale == 1) return;
  for (integer i = 0; i < count * R * ROW; ++i) rows[i] /= scale;
  for (integer i = 0; i < count; ++i) square[i] /= scale * scale;
}

/* Charts of a layout with points of m numbers and errors of n: error of one point about another, and reset Jacobian [n][n] at an
 * error. Errors of the `blocks` curved blocks begin at start[b] and have dimension[b]
 * components; a constant one is the same in every epoch. */
typedef struct {
  Loop *local, *reset;
  integer m, n, blocks;
  const integer *start, *dimension, *constant;
} Charts;

/* inverse [n][n] of a, which is overwritten; rows are exchanged for the largest pivot. */
static void invert(integer n, double* a, double* inverse) {
  for (integer i = 0; i < n * n; ++i) inverse[i] = i % (n + 1) == 0;
  for (integer j = 0; j < n; ++j) {
    integer best = j;
    for (integer i = j + 1; i < n; ++i)
      if (fabs(a[i * n + j]) > fabs(a[best * n + j])) best = i;
    for (integer k = 0; k < n && best != j; ++k) {
      const double x = a[j * n + k], y = inverse[j * n + k];
      a[j * n + k] = a[best * n + k], a[best * n + k] = x;
      inverse[j * n + k] = inverse[best * n + k], inverse[best * n + k] = y;
    }
    const double pivot = 1 / a[j * n + j];
    for (integer k = 0; k < n; ++k) {
      a[j * n + k] *= pivot;
      inverse[j * n + k] *= pivot;
    }
    /* column j of every other row to zero */
    for (integer i = 0; i < n; ++i) {
      const double factor = a[i * n + j];
      for (integer k = 0; k < n && i != j; ++k) {
        a[i * n + k] -= factor * a[j * n + k];
        inverse[i * n + k] -= factor * inverse[j * n + k];
      }
    }
  }
}

/* Block b of a reset Jacobian, row by row. */
static void take_block(const Charts* c, integer b, const double* jacobian, double* block) {
  const integer start = c->start[b], d = c->dimension[b];
  for (integer i = 0; i < d; ++i)
    for (integer j = 0; j < d; ++j) block[i * d + j] = jacobian[(start + j) * c->n + start + i];
}

/* Rows [count] of pitch numbers, their d columns from `rows` on times block [d][d]; d is known when this is compiled. */
static inline __attribute__((always_inline)) void turn_some(integer count, integer pitch, const integer d, const double* block, double* rows) {
  double given[d];
  for (integer r = 0; r < count; ++r, rows += pitch) {
    for (integer i = 0; i < d; ++i) given[i] = rows[i];
    for (integer j = 0; j < d; ++j) {
      double sum = 0;
      for (integer i = 0; i < d; ++i) sum += given[i] * block[i * d + j];
      rows[j] = sum;
    }
  }
}

/* The same of the columns from `column` on; blocks of an attitude, which every epoch has, are of three. */
static void turn_columns(integer count, integer pitch, integer column, integer d, const double* block, double* rows) {
  if (d == 3) turn_some(count, pitch, 3, block, rows + column);
  else turn_some(count, pitch, d, block, rows + column);
}

/* Gram [n + 1][n + 1] of the prior of a first state at x, components in `order`: the error of its mean is -away + G^-1 d with the reset
 * Jacobian G at away, whitened by W [n][n]. Returns the cost, or -1 where there is no memory. */
double linearise_first(const Charts* c, const double* mean, const double* W, const integer* order, const double* x, double* gram) {
  const integer n = c->n, w = n + 1, none[] = {0, 0};
  double *room = malloc((n + 2 * n * n + n * w) * sizeof(double)), *away = room, *jacobian = away + n;
  double *turned = jacobian + n * n, *rows = turned + n * n;
  if (room == 0) return -1;
  const double *points[] = {mean, x}, *errors[] = {away};
  double *const error[] = {away}, *const matrix[] = {jacobian};
  c->local(1, points, none, error, none);
  c->reset(1, errors, none, matrix, none);
  /* W G^-1, which differs from W in the columns of curved blocks */
  memcpy(turned, W, n * n * sizeof(double));
  for (integer b = 0; b < c->blocks; ++b) {
    const integer d = c->dimension[b];
    double block[d * d], inverse[d * d];
    take_block(c, b, jacobian, block);
    invert(d, block, inverse);
    turn_columns(n, n, c->start[b], d, inverse, turned);
  }
  for (integer i = 0; i < n; ++i) {
    double* row = rows + i * w;
    row[n] = 0;
    for (integer j = 0; j < n; ++j) {
      row[j] = turned[i * n + order[j]];
      row[n] -= W[i * n + j] * away[j];
    }
  }
  memset(gram, 0, w * w * sizeof(double));
  for (integer r = 0; r < n; ++r)
    for (integer i = 0; i < w; ++i)
      for (integer j = 0; j < w; ++j) gram[i * w + j] += rows[r * w + i] * rows[r * w + j];
  free(room);
  return gram[w * w - 1];
}

/* Linearised steps of a process, `BatchedLinearisation`: a scan over substeps, fewest << j of them for a turn of up to limits[j]
 * (rad), with their numbers; the estimated error of integration has `errors` components of at most `tolerance`. Rates begin at
 * `rate` in a point. */
typedef struct {
  Scan* scan;
  integer errors, q, levels, fewest, rate;
  const double *limits, *const *numbers, *densities;
  double tolerance, alike, smallest_turn;
} Steps;

/* Length of a rate, scaled so that squares do not overflow. */
static double speed_of(const double* w) {
  double scale = 0, sum = 0;
  for (int a = 0; a < 3; ++a) {
    if (!(fabs(w[a]) < INFINITY)) return NAN;
    if (fabs(w[a]) > scale) scale = fabs(w[a]);
  }
  for (int a = 0; a < 3 && scale > 0; ++a) sum += (w[a] / scale) * (w[a] / scale);
  return scale * sqrt(sum);
}

/* Number of the level for all steps along a trajectory; `levels` where they must be taken in groups or need more. */
static integer level_of_steps(const Steps* s, integer m, integer count, const double* dt, const double* trajectory) {
  double smallest = INFINITY, largest = 0, fastest = 0, longest = 0;
  for (integer k = 0; k < count; ++k) {
    const double speed = speed_of(trajectory + k * m + s->rate), turn = speed * dt[k];
    if (!(dt[k] > 0 && dt[k] < INFINITY && turn < INFINITY)) return s->levels;
    if (turn < smallest) smallest = turn;
    if (turn > largest) largest = turn;
    if (speed > fastest) fastest = speed;
    if (dt[k] > longest) longest = dt[k];
  }
  if (!(largest < s->alike * (smallest > s->smallest_turn ? smallest : s->smallest_turn))) return s->levels;
  integer j = 0;
  while (j < s->levels && !(fastest * longest <= s->limits[j])) ++j;
  return j;
}

/* The largest error of integration; infinite where one is not finite, for which no number of substeps helps. */
static double worst_error(integer count, const double* error) {
  double worst = 0;
  for (integer k = 0; k < count; ++k) {
    if (!(fabs(error[k]) < INFINITY)) return INFINITY;
    if (error[k] > worst) worst = error[k];
  }
  return worst;
}

/* Derivatives by the constants about `first` become those by the constants' errors about `state`: the columns of constant curved
 * blocks times the inverse of their reset Jacobian. */
static void by_errors_here(const Charts* c, integer count, const double* first, const double* state, double* room, double* transition) {
  const double *points[] = {first, state}, *errors[] = {room};
  double *const error[] = {room}, *const jacobian[] = {room + c->n};
  const integer none[] = {0, 0};
  c->local(1, points, none, error, none);
  c->reset(1, errors, none, jacobian, none);
  for (integer b = 0; b < c->blocks; ++b) {
    const integer d = c->dimension[b];
    double block[d * d], inverse[d * d];
    if (!c->constant[b]) continue;
    take_block(c, b, room + c->n, block);
    invert(d, block, inverse);
    turn_columns(count * c->n, c->n, c->start[b], d, inverse, transition);
  }
}

/* `EpochFactors.dynamics` of K epochs: defect [K - 1][n], transition [.][n][n] and noise [.][n][q] of their steps, and what `step_rows`
 * makes of them. With `first` derivatives are taken about its constants, at `constants` places of a point. Returns the cost, or -1
 * where single groups of steps must be taken. */
double linearise_steps(const Charts* charts, const Steps* s, integer K, const double* dt, const double* trajectory, const double* first,
                       integer constants, const integer* place, integer d, integer c, const integer* moving, const integer* constant,
                       double floor, double* defect, double* transition, double* noise, double* rows, double* grams) {
  const integer count = K - 1, m = charts->m, n = charts->n, w = 2 * d + c + 1;
  integer j = level_of_steps(s, m, count, dt, trajectory);
  double* room = malloc((count * (m + 1 + s->errors) + n * n + n) * sizeof(double));
  double *about = room, *h = room + count * m, *error = h + count;
  if (room == 0) j = s->levels;
  if (j < s->levels && first) {
    memcpy(about, trajectory, count * m * sizeof(double));
    for (integer k = 0; k < count; ++k)
      for (integer i = 0; i < constants; ++i) about[k * m + place[i]] = first[place[i]];
  }
  /* twice as many substeps until the error is within the tolerance */
  for (; j < s->levels; ++j) {
    const integer substeps = s->fewest << j;
    for (integer k = 0; k < count; ++k) h[k] = dt[k] / (double)substeps;
    const double* from[] = {trajectory, trajectory + m, first ? about : trajectory, dt, h, s->densities};
    const integer width[] = {m, m, m, 1, 1, 0};
    double* const to[] = {error, defect, transition, noise};
    s->scan(count, from, width, 0, to, substeps, s->numbers[j]);
    const double worst = worst_error(count * s->errors, error);
    if (worst <= s->tolerance || worst == INFINITY) break;
  }
  double cost = j < s->levels ? 0 : -1;
  if (cost == 0) {
    if (first) by_errors_here(charts, count, first, trajectory, error + count * s->errors, transition);
    if (step_rows(count, n, d, c, s->q, moving, constant, floor, defect, transition, noise, rows, grams)) cost = -1;
    else
      for (integer k = 0; k < count; ++k) cost += grams[(k + 1) * w * w - 1];
  }
  free(room);
  return cost;
}

/* A `MarginalizationPrior` over F epochs about `first` [F][m]: root and gram [q][q], right-hand side, directions of the gauge [q][6],
 * over the poses (p numbers each), the constants and the chain of the first epoch; components of these in an error. The columns of
 * curved block b begin at begin[b], and lie apart[b] from epoch to epoch, or are those of the first epoch alone where it is 0. */
typedef struct {
  integer F, p, c, v;
  const integer *pose, *constant, *chain, *begin, *apart;
  const double *first, *root, *right, *gram, *gauge;
  double least;
} Prior;

/* Of errors [F][n][6], 6 numbers a component, the rows of the prior's columns. */
static void take_directions(const Prior* r, integer n, const double* every, double* directions) {
  for (integer f = 0; f < r->F; ++f)
    for (integer a = 0; a < r->p; ++a, directions += POSE)
      for (int g = 0; g < POSE; ++g) directions[g] = every[(f * POSE + g) * n + r->pose[a]];
  for (integer a = 0; a < r->c + r->v; ++a, directions += POSE)
    for (int g = 0; g < POSE; ++g) directions[g] = every[g * n + (a < r->c ? r->constant[a] : r->chain[a - r->c])];
}

/* rows [d][width] become block' rows. */
static void turn_rows(integer d, integer width, const double* block, double* rows, double* room) {
  memcpy(room, rows, d * width * sizeof(double));
  for (integer i = 0; i < d; ++i)
    for (integer k = 0; k < d; ++k) {
      const double factor = block[k * d + i], *from = room + k * width;
      double* to = rows + i * width;
      for (integer j = 0; j < width; ++j) to[j] = (k ? to[j] : 0) + factor * from[j];
    }
}

/* to [q][q] = from', in squares that stay in the first cache. */
static void transpose(integer q, const double* from, double* to) {
  enum { SIDE = 8 };
  for (integer i = 0; i < q; i += SIDE)
    for (integer j = 0; j < q; j += SIDE)
      for (integer a = i; a < q && a < i + SIDE; ++a)
        for (integer b = j; b < q && b < j + SIDE; ++b) to[a * q + b] = from[b * q + a];
}

/* B' rows of width numbers, with the blocks [d][d] of every curved block and epoch in B, one after the other. */
static void turn_all(const Charts* charts, const Prior* r, integer width, const double* blocks, double* rows, double* room) {
  for (integer b = 0; b < charts->blocks; ++b) {
    const integer d = charts->dimension[b];
    for (integer f = 0; f < (r->apart[b] ? r->F : 1); ++f, blocks += d * d)
      turn_rows(d, width, blocks, rows + (r->begin[b] + f * r->apart[b]) * width, room);
  }
}

/* R_now = R G^-1 (I + D) with D = (then - now) now_p^-1 on the columns of the oldest pose, so that the prior stays blind to moves of
 * frame g: gram [q][q] and gradient [q] take it up. */
static void shift_gauge(integer q, integer p, const double* now, const double* then, double* gram, double* gradient, double* room) {
  double head[POSE * POSE], inverse[POSE * POSE], *D = room, *moved = D + q * p;
  memcpy(head, now, sizeof head);
  invert(POSE, head, inverse);
  for (integer i = 0; i < q; ++i)
    for (integer j = 0; j < p; ++j) {
      D[i * p + j] = 0;
      for (int g = 0; g < POSE; ++g) D[i * p + j] += (then[i * POSE + g] - now[i * POSE + g]) * inverse[g * p + j];
    }
  /* moved' = D' gram [p][q], as gram is symmetric */
  memset(moved, 0, q * p * sizeof(double));
  for (integer i = 0; i < q; ++i)
    for (integer j = 0; j < p; ++j)
      for (integer k = 0; k < q; ++k) moved[j * q + k] += D[i * p + j] * gram[i * q + k];
  /* gram += moved on the columns of the oldest pose, its transpose on the rows, and D' moved where both meet */
  double both[POSE * POSE] = {0}, slope[POSE] = {0};
  for (integer i = 0; i < q; ++i)
    for (integer j = 0; j < p; ++j) {
      for (integer k = 0; k < p; ++k) both[j * p + k] += D[i * p + j] * moved[k * q + i];
      slope[j] += D[i * p + j] * gradient[i];
    }
  for (integer j = 0; j < p; ++j)
    for (integer i = 0; i < q; ++i) {
      gram[i * q + j] += moved[j * q + i];
      gram[j * q + i] += moved[j * q + i];
    }
  for (integer j = 0; j < p; ++j) {
    for (integer k = 0; k < p; ++k) gram[j * q + k] += both[j * p + k];
    gradient[j] += slope[j];
  }
}

/* Errors of the F epochs `here` about the prior's first estimates, as its columns, away [q]; and of every curved block and epoch the
 * inverse of its reset Jacobian there, and the transpose of this. */
static void leave_first(const Charts* charts, const Prior* r, const double* here, double* room, double* away, double* inverse,
                        double* turned) {
  const integer F = r->F, n = charts->n, p = r->p, points[] = {charts->m, charts->m}, wide[] = {n}, square[] = {n * n};
  double *errors = room, *resets = errors + F * n;
  const double *from[] = {r->first, here}, *given[] = {errors};
  double *const error[] = {errors}, *const jacobian[] = {resets};
  charts->local(F, from, points, error, wide);
  charts->reset(F, given, wide, jacobian, square);
  for (integer f = 0; f < F; ++f)
    for (integer a = 0; a < p; ++a) away[f * p + a] = errors[f * n + r->pose[a]];
  for (integer a = 0; a < r->c + r->v; ++a) away[F * p + a] = errors[a < r->c ? r->constant[a] : r->chain[a - r->c]];
  for (integer b = 0; b < charts->blocks; ++b) {
    const integer d = charts->dimension[b];
    double block[d * d];
    for (integer f = 0; f < (r->apart[b] ? F : 1); ++f, inverse += d * d, turned += d * d) {
      take_block(charts, b, resets + f * n * n, block);
      for (integer i = 0; i < d * d; ++i) turned[i] = block[i % d * d + i / d];
      invert(d, block, inverse);
    }
  }
}

/* Directions of the gauge at F points, as rows of the prior's columns. */
static void gauge_at(const Charts* charts, Loop* gauge, const Prior* r, const double* points, double* room, double* directions) {
  const integer m[] = {charts->m}, six[] = {charts->n * POSE};
  double* const to[] = {room};
  gauge(r->F, &points, m, to, six);
  take_directions(r, charts->n, room, directions);
}

/* `MarginalizationPrior.at` of the F epochs `here`, with the loop of directions of the gauge [6][n] at points where there are poses: gram [q][q] and gradient [q]; returns the cost, -1 where there is no memory. */
double linearise_prior(const Charts* charts, Loop* gauge, const Prior* r, const double* here, double* gram, double* gradient) {
  const integer F = r->F, n = charts->n, p = r->p, q = F * p + r->c + r->v;
  double* room = malloc((F * n * (1 + 3 * n + POSE) + q * (2 + 2 * POSE + 2 * p + n + q)) * sizeof(double));
  if (room == 0) return -1;
  double *away = room, *rest = away + q, *now = rest + q, *then = now + q * POSE, *turned = then + q * POSE, *blocks = turned + q * q;
  double *forwards = blocks + F * n * n, *spare = forwards + F * n * n;
  leave_first(charts, r, here, spare, away, blocks, forwards);
  /* rest = y - R away, and R' rest */
  double cost = r->least;
  memset(gradient, 0, q * sizeof(double));
  for (integer i = 0; i < q; ++i) {
    const double* row = r->root + i * q;
    rest[i] = r->right[i] - product(row, away, 0, q);
    for (integer j = 0; j < q; ++j) gradient[j] += rest[i] * row[j];
    cost += rest[i] * rest[i];
  }
  if (p) {
    gauge_at(charts, gauge, r, here, spare, now);
    memcpy(then, r->gauge, q * POSE * sizeof(double));
  }
  /* d = away + G^-1 e: B' gram B and B' gradient with B = G^-1 of every curved block, and G times its directions of the gauge */
  if (p) turn_all(charts, r, POSE, forwards, then, spare);
  turn_all(charts, r, 1, blocks, gradient, spare);
  /* gram is symmetric: B' gram, transposed, and once more */
  memcpy(turned, r->gram, q * q * sizeof(double));
  turn_all(charts, r, q, blocks, turned, spare);
  transpose(q, turned, gram);
  turn_all(charts, r, q, blocks, gram, spare);
  if (p) shift_gauge(q, p, now, then, gram, gradient, spare);
  free(room);
  return cost;
}

/* Rows [count][width] over the prior's columns, further ones, and a right-hand side, from the points `here` to the first estimates: by errors
 * there, e = G (d - away), and blind to the same moves of frame g, for which the oldest pose's columns take up what the gauge
 * changes: (J G + D) N_then = J N_now. Returns 1 where there is no memory. */
int rows_at_first(const Charts* charts, Loop* gauge, const Prior* r, const double* here, integer count, integer width, double* rows) {
  const integer F = r->F, n = charts->n, p = r->p, q = F * p + r->c + r->v;
  double* room = malloc((F * n * (1 + 3 * n + POSE) + q * (1 + 2 * POSE) + POSE * (n + count)) * sizeof(double));
  if (room == 0) return 1;
  double *away = room, *now = away + q, *then = now + q * POSE, *blocks = then + q * POSE, *forwards = blocks + F * n * n;
  double *change = forwards + F * n * n, *spare = change + count * POSE, head[POSE * POSE], inverse[POSE * POSE];
  leave_first(charts, r, here, spare, away, blocks, forwards);
  if (p) {
    /* rows G N_then = rows (G N_then): what is left of N_now, which every row is short of */
    gauge_at(charts, gauge, r, here, spare, now);
    gauge_at(charts, gauge, r, r->first, spare, then);
    memcpy(head, then, sizeof head);
    invert(POSE, head, inverse);
    turn_all(charts, r, POSE, forwards, then, spare);
    for (integer i = 0; i < q * POSE; ++i) now[i] -= then[i];
  }
  for (integer i = 0; i < count && p; ++i) {
    const double* row = rows + i * width;
    four left = {0};
    two right = {0};
    for (integer j = 0; j < q; ++j) {
      left += row[j] * *(const four*)(now + j * POSE);
      right += row[j] * *(const two*)(now + j * POSE + 4);
    }
    *(four*)(change + i * POSE) = left;
    *(two*)(change + i * POSE + 4) = right;
  }
  const double* block = forwards;
  for (integer b = 0; b < charts->blocks; ++b)
    for (integer f = 0; f < (r->apart[b] ? F : 1); ++f) {
      const integer d = charts->dimension[b];
      double straight[d * d];
      for (integer k = 0; k < d * d; ++k) straight[k] = block[k % d * d + k / d];
      turn_columns(count, width, r->begin[b] + f * r->apart[b], d, straight, rows);
      block += d * d;
    }
  for (integer i = 0; i < count; ++i, rows += width) {
    for (integer j = 0; j < p; ++j)
      for (int g = 0; g < POSE; ++g) rows[j] += change[i * POSE + g] * inverse[g * p + j];
    rows[width - 1] += product(rows, away, 0, q);
  }
  free(room);
  return 0;
}
