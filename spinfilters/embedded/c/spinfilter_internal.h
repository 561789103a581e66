/* What the files of the filter share; not for those who use it. */
#ifndef SPINFILTER_INTERNAL_H
#define SPINFILTER_INTERNAL_H

#include "spinfilter_matrix.h"

#define SF_COLUMN(u, j) ((u) + (j) * ((j) - 1) / 2) /* of U above its diagonal */

/* Estimated error and NIS of an update, while its rows are processed one after the other. */
typedef struct {
  sf_real error[SF_N];
  sf_real nis;
} sf_correction;

void sf_copy_filter(sf_filter *to, const sf_filter *from);
int sf_is_finite(const sf_filter *f); /* state and deviations, and D is positive */

/* One scalar measurement: residual = row . error[SF_SEEN...] + unit noise; takes residual^2 / alpha into the nis. */
void sf_update_scalar(sf_filter *f, sf_correction *c, const sf_real *row, sf_real residual);

/* Fold the error into the state; the covariance moves with the derivative of that reset. */
void sf_reset(sf_filter *f, const sf_correction *c);

#endif
