/* Observations of landmarks whose own covariances are part of the noise; included by spinfilter.c alone. */

#define POSE SF_SEEN_COUNT /* t, a */

/* Lower Cholesky factor of a symmetric matrix, in place in its lower triangle; 0 where it is not positive definite. */
static int cholesky(sf_real *a, int n)
{
  int good = 1;
  for (int j = 0; j < n; ++j) {
    sf_real pivot = a[j * n + j];
    for (int k = 0; k < j; ++k) pivot -= a[j * n + k] * a[j * n + k];
    if (!(pivot > SF_R(0.0))) { good = 0; pivot = SF_R(1.0); }
    const sf_real root = SF_SQRT(pivot), inverse = SF_R(1.0) / root;
    a[j * n + j] = root;
    for (int i = j + 1; i < n; ++i) {
      sf_real entry = a[i * n + j];
      for (int k = 0; k < j; ++k) entry -= a[i * n + k] * a[j * n + k];
      a[i * n + j] = entry * inverse;
    }
  }
  return good;
}

/* Covariance of the errors that sensors see, lower triangle. */
static void seen_covariance(const sf_filter *f, sf_real *out)
{
  for (int i = 0; i < SF_SEEN_COUNT * SF_SEEN_COUNT; ++i) out[i] = SF_R(0.0);
  for (int k = SF_SEEN; k < SF_N; ++k) {
    sf_real weighted[SF_SEEN_COUNT], plain[SF_SEEN_COUNT];
    const sf_real *column = COLUMN(f->u, k) + SF_SEEN;
    const int above = k - SF_SEEN < SF_SEEN_COUNT ? k - SF_SEEN : SF_SEEN_COUNT;
    const int count = above < SF_SEEN_COUNT ? above + 1 : above;
    for (int i = 0; i < count; ++i) {
      plain[i] = i < above ? column[i] : SF_R(1.0);
      weighted[i] = plain[i] * f->d[k];
    }
    for (int i = 0; i < count; ++i)
      for (int j = 0; j <= i; ++j) out[i * SF_SEEN_COUNT + j] += weighted[i] * plain[j];
  }
}

/* An observation about a state: whitened by its pixels' noise, then by that and the landmark's own covariance together. */
typedef struct {
  sf_real innovation[3], by_pose[3 * POSE], by_landmark[9];
  sf_real spread[9];         /* covariance by_landmark', m^2 */
  sf_real root[9];           /* lower factor L of by_landmark covariance by_landmark' + I */
  sf_real valid;
} linearised;

SF_QUICK_BEGIN

static void forward3(const sf_real *root, sf_real *right, int columns) /* right <- L^-1 right */
{
  const sf_real a = SF_R(1.0) / root[0], b = SF_R(1.0) / root[4], c = SF_R(1.0) / root[8];
  for (int k = 0; k < columns; ++k) {
    right[k] *= a;
    right[columns + k] = (right[columns + k] - root[3] * right[k]) * b;
    right[2 * columns + k] = (right[2 * columns + k] - root[6] * right[k] - root[7] * right[columns + k]) * c;
  }
}

static void linearise(const sf_real *x, const sf_landmark *landmark, const sf_real *parameters, const sf_real *pixels,
linearised *o)
{
  const sf_real *c = landmark->covariance;
  const sf_real full[9] = {c[0], c[1], c[3], c[1], c[2], c[4], c[3], c[4], c[5]};
  sf_model_stereo(x, parameters, pixels, o->innovation, o->by_pose, o->by_landmark, &o->valid);
  multiply3_transposed(full, o->by_landmark, o->spread);
  multiply3(o->by_landmark, o->spread, 3, o->root);
  for (int k = 0; k < 3; ++k) o->root[4 * k] += SF_R(1.0);
  if (!cholesky(o->root, 3)) o->valid = SF_R(-1.0);
}

/* rows T (3 x 6), T the lower factor of the pose's covariance */
static void by_factor(const sf_real *rows, const sf_real *factor, sf_real *out)
{
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < POSE; ++j) {
      sf_real sum = SF_R(0.0);
      for (int k = j; k < POSE; ++k) sum += rows[i * POSE + k] * factor[k * POSE + j];
      out[i * POSE + j] = sum;
    }
}

/* Squared distance of a whitened innovation from a pose of that covariance. */
static sf_real distance(const sf_real *rows, const sf_real *innovation, const sf_real *factor)
{
  sf_real by[3 * POSE], s[9], rho[3] = {innovation[0], innovation[1], innovation[2]};
  by_factor(rows, factor, by);
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j <= i; ++j) {
      sf_real sum = i == j ? SF_R(1.0) : SF_R(0.0);
      for (int k = 0; k < POSE; ++k) sum += by[i * POSE + k] * by[j * POSE + k];
      s[3 * i + j] = sum;
    }
  if (!cholesky(s, 3)) return SF_R(1e30); /* outside any gate */
  forward3(s, rho, 1);
  return rho[0] * rho[0] + rho[1] * rho[1] + rho[2] * rho[2];
}

/* The landmark after the pose is known as well as it will be in this epoch; that pose's covariance is in its own. */
static void move_landmark(sf_landmark *landmark, linearised *o, const sf_real *factor)
{
  sf_real gain[9], by[3 * POSE], *c = landmark->covariance;
  /* gain' = S^-1 spread' by two triangular solves */
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) gain[3 * i + j] = o->spread[3 * j + i];
  forward3(o->root, gain, 3);
  for (int i = 0, n = 0; i < 3; ++i)
    for (int j = 0; j <= i; ++j, ++n)
      c[n] -= gain[i] * gain[j] + gain[3 + i] * gain[3 + j] + gain[6 + i] * gain[6 + j];
  forward3(o->root, o->innovation, 1);
  forward3(o->root, o->by_pose, POSE);
  for (int i = 0; i < 3; ++i)
    landmark->point[i] += gain[i] * o->innovation[0] + gain[3 + i] * o->innovation[1] + gain[6 + i] * o->innovation[2];
  sf_real pulled[3 * POSE];
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < POSE; ++j)
      pulled[i * POSE + j] = gain[i] * o->by_pose[j] + gain[3 + i] * o->by_pose[POSE + j] + gain[6 + i] * o->by_pose[2 * POSE + j];
  by_factor(pulled, factor, by);
  for (int i = 0, n = 0; i < 3; ++i)
    for (int j = 0; j <= i; ++j, ++n)
      for (int k = 0; k < POSE; ++k) c[n] += by[i * POSE + k] * by[j * POSE + k];
}

SF_QUICK_END

/* A landmark from its first observation. */
static int make_landmark(const sf_real *x, sf_landmark *landmark, const sf_real *parameters, const sf_real *pixels, const
sf_real *factor)
{
  sf_real point[3], by_pose[3 * POSE], spread[9], by[3 * POSE], told[1], *c = landmark->covariance;
  sf_model_new_stereo(x, parameters, pixels, point, by_pose, spread, told);
  if (!(told[0] > SF_R(0.0))) return 0;
  by_factor(by_pose, factor, by);
  for (int i = 0, n = 0; i < 3; ++i)
    for (int j = 0; j <= i; ++j, ++n) {
      sf_real sum = SF_R(0.0);
      for (int k = 0; k < 3; ++k) sum += spread[3 * i + k] * spread[3 * j + k];
      for (int k = 0; k < POSE; ++k) sum += by[i * POSE + k] * by[j * POSE + k];
      c[n] = sum;
    }
  for (int k = 0; k < 3; ++k) landmark->point[k] = point[k];
  landmark->hits = 1;
  landmark->wrong = 0;
  return 1;
}

/* What observations say of the pose: information (lower triangle), its right side, and the sum of squares.
 *
 * It is told of the motion of the observed landmarks' mean and the attitude, which hardly depend on one another: float does not
 * hold the information about t and a themselves. lever: of that mean, R [p x]. */
typedef struct {
  sf_real lever[9];
  sf_real matrix[POSE * POSE], right[POSE], squares;
  uint16_t count, refused;
} information;

SF_QUICK_BEGIN

static void gather(information *sum, sf_real *rows, const sf_real *innovation)
{
  for (int i = 0; i < 3; ++i) {
    sf_real *row = rows + i * POSE;
    for (int j = 0; j < 3; ++j) row[3 + j] += row[0] * sum->lever[j] + row[1] * sum->lever[3 + j] + row[2] * sum->lever[6 + j];
  }
  for (int i = 0; i < POSE; ++i) {
    const sf_real a = rows[i], b = rows[POSE + i], c = rows[2 * POSE + i];
    for (int j = 0; j <= i; ++j) sum->matrix[i * POSE + j] += a * rows[j] + b * rows[POSE + j] + c * rows[2 * POSE + j];
    sum->right[i] += a * innovation[0] + b * innovation[1] + c * innovation[2];
  }
  sum->squares += innovation[0] * innovation[0] + innovation[1] * innovation[1] + innovation[2] * innovation[2];
  ++sum->count;
}

SF_QUICK_END

static void mean_lever(const sf_filter *f, const sf_landmark *map, const sf_observation *observations, uint16_t count, sf_real
*lever)
{
  sf_real mean[3] = {SF_R(0.0), SF_R(0.0), SF_R(0.0)}, known = SF_R(0.0);
  for (uint16_t k = 0; k < count; ++k) {
    const sf_landmark *landmark = map + observations[k].landmark;
    const sf_real there = landmark->hits ? SF_R(1.0) : SF_R(0.0);
    for (int i = 0; i < 3; ++i) mean[i] += there * landmark->point[i];
    known += there;
  }
  for (int i = 0; i < 3; ++i) mean[i] /= known + (known < SF_R(1.0) ? SF_R(1.0) : SF_R(0.0));
  sf_model_lever(f->x, mean, lever);
}

static void observe(const sf_filter *f, const sf_landmark *map, sf_observation *o, sf_real *parameters, const sf_real *factor,
information *sum)
{
  const sf_landmark *landmark = map + o->landmark;
  linearised at;
  o->outcome = SF_NOT_TOLD;
  if (landmark->hits == 0) return;
  for (int k = 0; k < 3; ++k) parameters[k] = landmark->point[k];
  linearise(f->x, landmark, parameters, o->pixels, &at);
  forward3(at.root, at.innovation, 1);
  forward3(at.root, at.by_pose, POSE);
  const sf_real squared = distance(at.by_pose, at.innovation, factor);
  o->outcome = !(at.valid > SF_R(0.0)) ? SF_BEHIND : squared <= SF_R(SF_GATE_3) ? SF_USED : SF_OUTSIDE;
  if (o->outcome == SF_USED)
    gather(sum, at.by_pose, at.innovation);
  else
    ++sum->refused;
}

/* Rows with unit noise that say the same as all observations, one after the other into the filter. */
static void update_by(sf_filter *f, correction *c, information *sum)
{
  sf_real *m = sum->matrix, *right = sum->right;
  for (int j = 0; j < POSE; ++j) { /* M = L Delta L' in place, right <- L^-1 right */
    for (int k = 0; k < j; ++k) m[j * POSE + j] -= m[j * POSE + k] * m[j * POSE + k] * m[k * POSE + k];
    const sf_real pivot = m[j * POSE + j];
    const sf_real inverse = pivot > SF_R(0.0) ? SF_R(1.0) / pivot : SF_R(0.0);
    for (int i = j + 1; i < POSE; ++i) {
      for (int k = 0; k < j; ++k) m[i * POSE + j] -= m[i * POSE + k] * m[j * POSE + k] * m[k * POSE + k];
      m[i * POSE + j] *= inverse;
      right[i] -= m[i * POSE + j] * right[j];
    }
  }
  c->nis = sum->squares;
  for (int j = 0; j < POSE; ++j) {
    const sf_real pivot = m[j * POSE + j], root = pivot > SF_R(0.0) ? SF_SQRT(pivot) : SF_R(0.0);
    const sf_real inverse = pivot > SF_R(0.0) ? SF_R(1.0) / root : SF_R(0.0);
    sf_real row[POSE];
    for (int i = 0; i < POSE; ++i) row[i] = i < j ? SF_R(0.0) : (i == j ? SF_R(1.0) : m[i * POSE + j]) * root;
    for (int i = 0; i < 3; ++i)
      row[3 + i] -= row[0] * sum->lever[i] + row[1] * sum->lever[3 + i] + row[2] * sum->lever[6 + i];
    c->nis -= right[j] * right[j] * inverse * inverse;
    update_scalar(f, c, row, right[j] * inverse);
  }
  if (c->nis < SF_R(0.0)) c->nis = SF_R(0.0); /* by rounding alone */
}

static void keep_house(const sf_filter *f, sf_landmark *map, sf_observation *o, sf_real *parameters, const sf_real *factor)
{
  sf_landmark *landmark = map + o->landmark;
  linearised at;
  for (int k = 0; k < 3; ++k) parameters[k] = landmark->point[k];
  if (o->outcome == SF_USED) {
    linearise(f->x, landmark, parameters, o->pixels, &at);
    move_landmark(landmark, &at, factor);
    landmark->hits += landmark->hits < UINT16_MAX;
    landmark->wrong = 0;
    return;
  }
  if (o->outcome == SF_OUTSIDE) {
    ++landmark->wrong;
    if (landmark->hits >= SF_CONFIRMED && landmark->wrong < SF_WRONG_IN_A_ROW) return;
    landmark->hits = 0; /* the landmark, not the observation, is taken to be wrong */
  }
  if (o->outcome != SF_BEHIND && make_landmark(f->x, landmark, parameters, o->pixels, factor)) o->outcome = SF_NEW;
}

int sf_update_stereo(sf_filter *filter, sf_landmark *map, sf_observation *observations, uint16_t count, const sf_real *camera)
{
  sf_filter f;
  sf_real factor[POSE * POSE], parameters[3 + SF_STEREO_PARAMETERS];
  information sum;
  correction c;
  for (uint16_t k = 0; k < count; ++k)
    if (observations[k].landmark >= SF_LANDMARKS) return SF_INVALID;
  copy_filter(&f, filter);
  copy(parameters + 3, camera, SF_STEREO_PARAMETERS);
  clear(sum.matrix, POSE * POSE + POSE + 1);
  sum.count = sum.refused = 0;
  clear(c.error, SF_N + 1);
  seen_covariance(&f, factor);
  if (!cholesky(factor, POSE)) return SF_NOT_FINITE;
  mean_lever(&f, map, observations, count, sum.lever);
  for (uint16_t k = 0; k < count; ++k) observe(&f, map, observations + k, parameters, factor, &sum);
  filter->used = 0;
  const int lost = 4 * sum.count < sum.refused;
  if (sum.count) {
    update_by(&f, &c, &sum);
    reset(&f, &c);
    seen_covariance(&f, factor);
    if (!finite(&f) || !cholesky(factor, POSE)) return SF_NOT_FINITE;
  }
  f.nis = c.nis;
  f.dof = (uint16_t)(3 * sum.count);
  f.used = sum.count;
  f.refused = lost ? (uint16_t)(f.refused + (f.refused < UINT16_MAX)) : 0;
  for (uint16_t k = 0; k < count; ++k) keep_house(&f, map, observations + k, parameters, factor);
  copy_filter(filter, &f);
  return sum.count || !sum.refused ? SF_OK : SF_REFUSED;
}
