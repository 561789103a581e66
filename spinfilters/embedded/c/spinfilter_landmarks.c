/* Landmarks with covariances of their own: seen from a pose, moved, made and given up.
 *
 * An observation takes the same work, whatever becomes of it: what is not needed is computed too, and left where it is not
 * read.
 */
#include "spinfilter_landmarks.h"

#include "spinfilter_model.h"

#ifdef SF_HAS_STEREO

/* Lower Cholesky factor in place of a lower triangle, zeros above; 0 where it is not positive definite. */
static int factor_pose(sf_real *a)
{
  int good = 1;
  /* column j of the factor: pivot less the squares left of it, zeros above, and below it the entries less the columns before */
  for (int j = 0; j < SF_POSE; ++j) {
    sf_real pivot = a[j * SF_POSE + j];
    for (int k = 0; k < j; ++k) pivot -= a[j * SF_POSE + k] * a[j * SF_POSE + k];
    if (!(pivot > SF_R(0.0))) { good = 0; pivot = SF_R(1.0); }
    const sf_real root = SF_SQRT(pivot), inverse = SF_R(1.0) / root;
    a[j * SF_POSE + j] = root;
    for (int i = 0; i < j; ++i) a[i * SF_POSE + j] = SF_R(0.0);
    for (int i = j + 1; i < SF_POSE; ++i) {
      sf_real entry = a[i * SF_POSE + j];
      for (int k = 0; k < j; ++k) entry -= a[i * SF_POSE + k] * a[j * SF_POSE + k];
      a[i * SF_POSE + j] = entry * inverse;
    }
  }
  return good;
}

int sf_begin_pose(const sf_filter *f, sf_seen_pose *p)
{
  sf_model_rotation(f->x, p->r);
  sf_copy(p->t, f->x, 3);
  sf_multiply3(p->r, p->mean_g, 1, p->mean);
  sf_clear(p->factor, SF_POSE * SF_POSE);
  /* factor += d_k plain plain', plain = column k of U in the rows of t and a, as displacement of the mean and rotation in
   * frame i */
  for (int k = 0; k < SF_N; ++k) {
    sf_real plain[SF_POSE], part[3];
    for (int i = 0; i < SF_POSE; ++i) plain[i] = i < k ? SF_COLUMN(f->u, k)[i] : i == k ? SF_R(1.0) : SF_R(0.0);
    sf_multiply3(p->r, plain + 3, 1, part);
    sf_copy(plain + 3, part, 3);
    sf_cross(plain + 3, p->mean, part);
    for (int i = 0; i < 3; ++i) plain[i] += part[i];
    for (int i = 0; i < SF_POSE; ++i) /* lower triangle */
      for (int j = 0; j <= i; ++j) p->factor[i * SF_POSE + j] += plain[i] * f->d[k] * plain[j];
  }
  return factor_pose(p->factor);
}

void sf_linearise(const sf_seen_pose *p, const sf_landmark *landmark, const sf_real *camera, const sf_real *pixels,
                  sf_linearised *o)
{
  const sf_real *c = landmark->covariance;
  const sf_real full[9] = {c[0], c[1], c[3], c[1], c[2], c[4], c[3], c[4], c[5]};
  sf_real y[3], by_landmark[9];
  sf_multiply3(p->r, landmark->point, 1, y);
  /* arm = R p - mean, and y = R p + t, the landmark in frame i */
  for (int k = 0; k < 3; ++k) {
    o->arm[k] = y[k] - p->mean[k];
    y[k] += p->t[k];
  }
  sf_model_stereo(y, camera, pixels, o->innovation, o->by_y, &o->valid);
  sf_multiply3(o->by_y, p->r, 3, by_landmark);
  sf_multiply3_transposed(full, by_landmark, o->spread);
  /* noise = I + by_landmark covariance by_landmark', lower triangle: of whitened pixels, and of the landmark's own covariance */
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j <= i; ++j) {
      sf_real sum = i == j ? SF_R(1.0) : SF_R(0.0);
      for (int k = 0; k < 3; ++k) sum += by_landmark[3 * i + k] * o->spread[3 * k + j];
      o->noise[3 * i + j] = sum;
    }
}

/* A landmark as the observation leaves it; own: its covariance without that of the pose, which comes in by by_pose. */
typedef struct {
  sf_real point[3], own[9], by_pose[9], arm[3];
} told_landmark;

static void move_landmark(const sf_seen_pose *p, const sf_landmark *landmark, const sf_real *camera, const sf_real *pixels,
                          told_landmark *out)
{
  sf_linearised at;
  sf_real root[9], gain[9];
  const sf_real *c = landmark->covariance;
  sf_linearise(p, landmark, camera, pixels, &at);
  sf_factor3(at.noise, root);
  for (int i = 0; i < 3; ++i) /* gain' root: what is left to multiply with root^-1 */
    for (int j = 0; j < 3; ++j) gain[3 * i + j] = at.spread[3 * j + i];
  sf_forward3(root, gain, 3);
  sf_forward3(root, at.innovation, 1);
  sf_forward3(root, at.by_y, 3);
  /* own = covariance - gain' gain, lower triangle; n runs over the packed triangle of the map */
  for (int i = 0, n = 0; i < 3; ++i)
    for (int j = 0; j <= i; ++j, ++n)
      out->own[3 * i + j] = c[n] - (gain[i] * gain[j] + gain[3 + i] * gain[3 + j] + gain[6 + i] * gain[6 + j]);
  sf_transposed_multiply3(gain, at.innovation, 1, out->point);
  for (int i = 0; i < 3; ++i) out->point[i] += landmark->point[i]; /* point + gain' innovation */
  sf_transposed_multiply3(gain, at.by_y, 3, out->by_pose);
  sf_copy(out->arm, at.arm, 3);
}

/* A landmark from its first observation; 0 where that does not determine it. */
static int make_landmark(const sf_seen_pose *p, const sf_real *camera, const sf_real *pixels, told_landmark *out)
{
  sf_real y[3], spread[9], rotated[9], told;
  sf_model_new_stereo(camera, pixels, y, spread, &told);
  /* the point less t, frame i, and its arm about the mean */
  for (int k = 0; k < 3; ++k) y[k] -= p->t[k];
  for (int k = 0; k < 3; ++k) out->arm[k] = y[k] - p->mean[k];
  sf_transposed_multiply3(p->r, y, 1, out->point);
  sf_transposed_multiply3(p->r, spread, 3, rotated);
  sf_clear(out->own, 9);
  sf_add_squared(rotated, 3, out->own);
  /* by_pose = R': a new landmark follows the pose wholly */
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) out->by_pose[3 * i + j] = p->r[3 * j + i];
  return told > SF_R(0.0);
}

static inline int is_finite(const sf_real *point, const sf_real *covariance)
{
  sf_real sum = point[0] + point[1] + point[2];
  /* one sum over the lower triangle: it is finite only where every number is */
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j <= i; ++j) sum += covariance[3 * i + j];
  return sum - sum == SF_R(0.0);
}

void sf_keep_landmark(const sf_seen_pose *p, sf_landmark *landmark, sf_observation *o, const sf_real *camera)
{
  told_landmark ways[2]; /* moved, made */
  sf_real displaced[3 * SF_POSE], by_pose[3 * SF_POSE], covariance[9];
  const int used = o->outcome == SF_USED, outside = o->outcome == SF_OUTSIDE;
  const int wrong = used ? 0 : landmark->wrong + outside;
  /* the landmark, not the observation, is taken to be wrong */
  const int lost = outside & ((landmark->hits < SF_CONFIRMED) | (wrong >= SF_WRONG_IN_A_ROW));
  move_landmark(p, landmark, camera, o->pixels, ways);
  const int told = make_landmark(p, camera, o->pixels, ways + 1) & (lost | (o->outcome == SF_NOT_TOLD));
  told_landmark *way = ways + !used;
  sf_displace(p, way->arm, displaced);
  sf_multiply3(way->by_pose, displaced, SF_POSE, by_pose);
  sf_copy(covariance, way->own, 9);
  sf_add_squared(by_pose, SF_POSE, covariance);
  const int good = is_finite(way->point, covariance), made = told & good;
  sf_landmark unread, *to = (used & good) | made ? landmark : &unread;
  sf_copy(to->point, way->point, 3);
  /* lower triangle to its six packed places */
  for (int i = 0, n = 0; i < 3; ++i)
    for (int j = 0; j <= i; ++j, ++n) to->covariance[n] = covariance[3 * i + j];
  landmark->hits = (uint16_t)(used ? landmark->hits + (landmark->hits < UINT16_MAX) : made ? 1 : lost ? 0 : landmark->hits);
  landmark->wrong = (uint16_t)(made ? 0 : wrong);
  o->outcome = (uint16_t)(made ? SF_NEW : o->outcome);
}

#endif
