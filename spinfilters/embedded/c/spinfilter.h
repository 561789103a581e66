/* Filter of a tumbling rigid body for a microcontroller. See README.md. SI units, radians, quaternions scalar last.
 *
 * No heap, no stdio, no recursion, no libm but the square root; the work of a call does not depend on the values.
 * State x: SF_STATE in spinfilter_config.h names its places. The error of the attitude is a rotation vector (4 x MRP)
 * on the body side. Covariance P = U D U', U unit upper triangular, kept column by column.
 */
#ifndef SPINFILTER_H
#define SPINFILTER_H

#include <stdint.h>

#include "spinfilter_config.h"

#ifdef SF_DOUBLE
typedef double sf_real;
#else
typedef float sf_real;
#endif

#ifdef __cplusplus
extern "C" {
#endif

/* Status of a call. After any of them the filter is finite: where a result would not be, nothing has changed. */
enum sf_status {
  SF_OK = 0,
  SF_REFUSED = 1,    /* every value lies outside the gate, or is not usable: nothing has changed */
  SF_FAST = 2,       /* done, but the body turned further than SF_LARGEST_TURN rad in one prediction: call more often */
  SF_NOT_FINITE = 3, /* state or deviations would not be finite, or the covariance not positive: nothing has changed */
  SF_INVALID = 4     /* an argument that no filter can use: nothing has changed */
};

typedef struct {
  sf_real x[SF_NX];                   /* state */
  sf_real u[SF_N * (SF_N - 1) / 2];   /* U above its diagonal: column j begins at j (j - 1) / 2 */
  sf_real d[SF_N];                    /* D */
  sf_real psd[2];                     /* disturbances: (m/s^2)^2/Hz, (rad/s^2)^2/Hz */
  sf_real nis;                        /* of the last update: normalised innovation squared, chi-square with dof degrees */
  uint16_t dof;
  uint16_t used;                      /* values taken in by the last update */
  uint16_t refused;                   /* updates in a row that refused four fifths of their values: 3 or more mean lost */
} sf_filter;

/* Begin from a state and its covariance (SF_N x SF_N, row by row, positive definite); after SF_INVALID: no filter. */
int sf_begin(sf_filter *filter, const sf_real *x, const sf_real *covariance, sf_real force_psd, sf_real torque_psd);

/* Go dt > 0 seconds ahead. On a copy of the filter: a prediction. */
int sf_predict(sf_filter *filter, sf_real dt);

/* Covariance (SF_N x SF_N, row by row), and the standard deviations alone. */
void sf_covariance(const sf_filter *filter, sf_real *covariance);
void sf_deviations(const sf_filter *filter, sf_real *deviations);

#ifdef SF_HAS_GYRO
/* rates: 3, rad/s, axes g.  parameters: SF_GYRO_PARAMETERS (noise_std rad/s, scale_std 1). */
int sf_update_gyro(sf_filter *filter, const sf_real *rates, const sf_real *parameters);
#endif

#ifdef SF_HAS_POSE
/* pose: t (3, m), q_ig (4).  root: 21 entries, row by row, of the covariance of (t, rotation)'s lower Cholesky factor. */
int sf_update_pose(sf_filter *filter, const sf_real *pose, const sf_real *root);
#endif

#ifdef SF_HAS_STEREO
typedef struct {
  sf_real point[3];      /* m, frame g */
  sf_real covariance[6]; /* own, independent of all else: xx, yx, yy, zx, zy, zz, m^2 */
  uint16_t hits;         /* observations that agreed; 0: no landmark here yet */
  uint16_t wrong;        /* observations in a row outside the gate */
} sf_landmark;

typedef struct {
  sf_real pixels[3];  /* u left, v left, u right, rectified */
  uint16_t landmark;  /* its place in the map, below SF_LANDMARKS, each once in an epoch */
  uint16_t outcome;   /* written: enum sf_outcome */
} sf_observation;

enum sf_outcome { SF_USED = 0, SF_OUTSIDE = 1, SF_BEHIND = 2, SF_NEW = 3, SF_NOT_TOLD = 4 };

/* All observations of an epoch. map: SF_LANDMARKS, zeroed at first.  camera: SF_STEREO_PARAMETERS (see the README). */
int sf_update_stereo(sf_filter *filter, sf_landmark *map, sf_observation *observations, uint16_t count,
                     const sf_real *camera);
#endif

#ifdef __cplusplus
}
#endif
#endif
