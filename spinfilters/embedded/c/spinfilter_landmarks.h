/* An observation of a landmark about a pose; for spinfilter_stereo.c and spinfilter_landmarks.c alone.
 *
 * The pose is expressed about the observed landmarks' mean: its displacement and the attitude are hardly correlated, and
 * float cannot represent the information on t and a themselves.
 */
#ifndef SPINFILTER_LANDMARKS_H
#define SPINFILTER_LANDMARKS_H

#include "spinfilter_internal.h"

#ifdef SF_HAS_STEREO

#define SF_POSE SF_SEEN_COUNT /* displacement of the mean (m) and attitude error (rad), frame i */

/* The pose of an epoch, as all of its observations share it. */
typedef struct {
  sf_real t[3], r[9];                /* of the state: t, R_ig */
  sf_real mean_g[3], mean[3];        /* of the observed landmarks less t: m, frames g and i */
  sf_real factor[SF_POSE * SF_POSE]; /* lower Cholesky factor of the covariance */
} sf_seen_pose;

/* An observation about a pose, whitened by its pixels' noise. */
typedef struct {
  sf_real arm[3];    /* of the landmark about the mean, m, frame i */
  sf_real innovation[3];
  sf_real by_y[9];   /* by the landmark's point in frame i */
  sf_real spread[9]; /* its covariance times the derivative by it', m, axes g x pixels */
  sf_real noise[9];  /* covariance of the innovation by pixels and landmark, lower triangle */
  sf_real valid;
} sf_linearised;

/* Displacement of a point by the pose's error of unit covariance, 3 x 6: displacement + rotation x arm. */
static inline void sf_displace(const sf_seen_pose *p, const sf_real *arm, sf_real *out)
{
  /* column j of the factor is a displacement and a rotation (a, b, c): the point moves by displacement + rotation x arm */
  for (int j = 0; j < SF_POSE; ++j) {
    const sf_real *column = p->factor + j;
    const sf_real a = column[3 * SF_POSE], b = column[4 * SF_POSE], c = column[5 * SF_POSE];
    out[j] = column[0] + (b * arm[2] - c * arm[1]);
    out[SF_POSE + j] = column[SF_POSE] + (c * arm[0] - a * arm[2]);
    out[2 * SF_POSE + j] = column[2 * SF_POSE] + (a * arm[1] - b * arm[0]);
  }
}

/* Pose of a state about p->mean_g; 0 where its covariance is not positive definite. */
int sf_begin_pose(const sf_filter *f, sf_seen_pose *p);

/* An observation linearised: its innovation, Jacobian and noise. */
void sf_linearise(const sf_seen_pose *p, const sf_landmark *landmark, const sf_real *camera, const sf_real *pixels,
                  sf_linearised *o);

/* Update a landmark by its observation, given the pose after all of them; its outcome may become SF_NEW. */
void sf_keep_landmark(const sf_seen_pose *p, sf_landmark *landmark, sf_observation *o, const sf_real *camera);

#endif
#endif
