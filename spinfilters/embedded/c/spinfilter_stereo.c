/* Stereo observations of an epoch: they correct the pose together, and then each its landmark.
 *
 * Landmarks' own covariances are part of the noise. An observation takes the same work, whatever becomes of it.
 */
#include "spinfilter_landmarks.h"
#include "spinfilter_model.h"

#ifdef SF_HAS_STEREO

/* Normal equations of the pose: information (lower triangle), right side, and sum of squared innovations. */
typedef struct {
  sf_real matrix[SF_POSE * SF_POSE], right[SF_POSE], squares;
  uint16_t count;
} information;

/* Squared distance of an innovation by the covariance of pose, landmark and pixels; outside any gate where that is none. */
static inline sf_real distance(const sf_seen_pose *p, const sf_linearised *o)
{
  sf_real by_pose[3 * SF_POSE], moved[3 * SF_POSE], s[9], root[9], rho[3];
  sf_displace(p, o->arm, moved);
  sf_multiply3(o->by_y, moved, SF_POSE, by_pose);
  sf_copy(s, o->noise, 9);
  sf_add_squared(by_pose, SF_POSE, s);
  const int good = sf_factor3(s, root);
  sf_copy(rho, o->innovation, 3);
  sf_forward3(root, rho, 1);
  const sf_real squared = rho[0] * rho[0] + rho[1] * rho[1] + rho[2] * rho[2];
  return good ? squared : SF_R(1e30);
}

static inline void gather(information *sum, const sf_real *by_y, const sf_real *arm, const sf_real *innovation)
{
  sf_real rows[3 * SF_POSE];
  /* rows by displacement and rotation: by_y and arm x by_y, because by_y (rotation x arm) = (arm x by_y) rotation */
  for (int i = 0; i < 3; ++i) {
    sf_copy(rows + i * SF_POSE, by_y + 3 * i, 3);
    sf_cross(arm, by_y + 3 * i, rows + i * SF_POSE + 3);
  }
  /* information += rows' rows (lower triangle), right side += rows' innovation */
  for (int i = 0; i < SF_POSE; ++i) {
    const sf_real a = rows[i], b = rows[SF_POSE + i], c = rows[2 * SF_POSE + i];
    for (int j = 0; j <= i; ++j)
      sum->matrix[i * SF_POSE + j] += a * rows[j] + b * rows[SF_POSE + j] + c * rows[2 * SF_POSE + j];
    sum->right[i] += a * innovation[0] + b * innovation[1] + c * innovation[2];
  }
  sum->squares += innovation[0] * innovation[0] + innovation[1] * innovation[1] + innovation[2] * innovation[2];
  ++sum->count;
}

/* sums: of observations that are used, and of all others, which is not read. */
static void observe(const sf_seen_pose *p, const sf_landmark *landmark, sf_observation *o, const sf_real *camera,
                    information *sums)
{
  sf_linearised at;
  sf_real root[9];
  sf_linearise(p, landmark, camera, o->pixels, &at);
  const sf_real squared = distance(p, &at);
  const int told = landmark->hits != 0, near = squared <= SF_R(SF_GATE_3);
  const int valid = (at.valid > SF_R(0.0)) & sf_factor3(at.noise, root);
  o->outcome = (uint16_t)(told ? valid ? near ? SF_USED : SF_OUTSIDE : SF_BEHIND : SF_NOT_TOLD);
  sf_forward3(root, at.innovation, 1);
  sf_forward3(root, at.by_y, 3);
  gather(sums + (o->outcome != SF_USED), at.by_y, at.arm, at.innovation);
}

/* Rows with unit noise equivalent to all observations, processed one after the other. */
static void update_by(sf_filter *f, sf_correction *c, const sf_seen_pose *p, information *sum)
{
  sf_real *m = sum->matrix, *right = sum->right;
  for (int j = 0; j < SF_POSE; ++j) { /* M = L Delta L' in place, right <- L^-1 right */
    for (int k = 0; k < j; ++k) m[j * SF_POSE + j] -= m[j * SF_POSE + k] * m[j * SF_POSE + k] * m[k * SF_POSE + k];
    const sf_real pivot = m[j * SF_POSE + j];
    const sf_real inverse = pivot > SF_R(0.0) ? SF_R(1.0) / pivot : SF_R(0.0);
    for (int i = j + 1; i < SF_POSE; ++i) {
      for (int k = 0; k < j; ++k) m[i * SF_POSE + j] -= m[i * SF_POSE + k] * m[j * SF_POSE + k] * m[k * SF_POSE + k];
      m[i * SF_POSE + j] *= inverse;
      right[i] -= m[i * SF_POSE + j] * right[j];
    }
  }
  sf_clear(c->error, SF_N);
  sf_real nis = sum->squares;
  /* row j of sqrt(Delta) L' and its residual (L^-1 right)_j / sqrt(Delta_j): a scalar measurement of the pose. What these rows
   * explain of the sum of squares gives way to their own NIS */
  for (int j = 0; j < SF_POSE; ++j) {
    const sf_real pivot = m[j * SF_POSE + j], root = pivot > SF_R(0.0) ? SF_SQRT(pivot) : SF_R(0.0);
    const sf_real inverse = pivot > SF_R(0.0) ? SF_R(1.0) / root : SF_R(0.0);
    sf_real row[SF_POSE], turned[3], by_a[3];
    for (int i = 0; i < SF_POSE; ++i) row[i] = i < j ? SF_R(0.0) : (i == j ? SF_R(1.0) : m[i * SF_POSE + j]) * root;
    sf_cross(p->mean, row, turned); /* of t and a: the mean is displaced by t + (R a) x mean */
    for (int i = 0; i < 3; ++i) turned[i] += row[3 + i]; /* by R a */
    sf_transposed_multiply3(p->r, turned, 1, by_a); /* by a */
    sf_copy(row + 3, by_a, 3);
    nis -= right[j] * right[j] * inverse * inverse;
    c->nis = SF_R(0.0);
    sf_update_scalar(f, c, row, right[j] * inverse);
    nis += c->nis;
  }
  c->nis = nis < SF_R(0.0) ? SF_R(0.0) : nis; /* by rounding alone */
}

static void mean_of(const sf_landmark *map, const sf_observation *observations, uint16_t count, sf_real *mean)
{
  sf_real sum[4] = {SF_R(0.0), SF_R(0.0), SF_R(0.0), SF_R(0.0)};
  /* sum and number of the points with a landmark; a place without one adds zero, at the same work */
  for (uint16_t k = 0; k < count; ++k) {
    const sf_landmark *landmark = map + observations[k].landmark;
    for (int i = 0; i < 3; ++i) sum[i] += landmark->hits ? landmark->point[i] : SF_R(0.0);
    sum[3] += landmark->hits ? SF_R(1.0) : SF_R(0.0);
  }
  for (int i = 0; i < 3; ++i) mean[i] = sum[i] / sf_max(sum[3], SF_R(1.0)); /* of no landmark: zero */
}

int sf_update_stereo(sf_filter *filter, sf_landmark *map, sf_observation *observations, uint16_t count,
                     const sf_real *camera)
{
  sf_filter f;
  sf_seen_pose pose;
  information sums[2];
  sf_correction c;
  uint16_t refused = 0;
  /* first, so that an invalid place leaves everything as it was */
  for (uint16_t k = 0; k < count; ++k)
    if (observations[k].landmark >= SF_LANDMARKS) return SF_INVALID;
  sf_copy_filter(&f, filter);
  mean_of(map, observations, count, pose.mean_g);
  if (!sf_begin_pose(&f, &pose)) return SF_NOT_FINITE;
  /* two empty sums; right side and squares lie behind the matrix */
  for (int k = 0; k < 2; ++k) {
    sf_clear(sums[k].matrix, SF_POSE * SF_POSE + SF_POSE + 1);
    sums[k].count = 0;
  }
  /* each observation to its sum; outside the gate and behind the camera count as refused */
  for (uint16_t k = 0; k < count; ++k) {
    observe(&pose, map + observations[k].landmark, observations + k, camera, sums);
    refused = (uint16_t)(refused + (observations[k].outcome == SF_OUTSIDE) + (observations[k].outcome == SF_BEHIND));
  }
  update_by(&f, &c, &pose, sums);
  sf_reset(&f, &c);
  filter->used = 0;
  if (!sf_is_finite(&f) || !sf_begin_pose(&f, &pose)) return SF_NOT_FINITE;
  const uint16_t used = sums[0].count;
  const int lost = 4 * used < refused;
  f.refused = lost ? (uint16_t)(f.refused + (f.refused < UINT16_MAX)) : 0;
  /* landmarks at last, by the pose after all observations */
  for (uint16_t k = 0; k < count; ++k) sf_keep_landmark(&pose, map + observations[k].landmark, observations + k, camera);
  const uint16_t in_a_row = f.refused;
  sf_copy_filter(filter, used ? &f : filter); /* without any, the state has not changed by a bit */
  filter->nis = c.nis;
  filter->dof = (uint16_t)(3 * used);
  filter->used = used;
  filter->refused = in_a_row;
  return used || !refused ? SF_OK : SF_REFUSED;
}

#endif
