/* Principal moments of inertia of a mass distribution s. */
#ifndef SPINFILTER_MOMENTS_H
#define SPINFILTER_MOMENTS_H

#include "spinfilter.h"

#ifdef __cplusplus
extern "C" {
#endif

/* s: 5, of the state.  moments: 3, ascending, the largest is 1.
 *
 * L = [exp(s1), 0, 0; s3, exp(s2), 0; s4, s5, exp(-s1 - s2)] is the Cholesky factor of the second moments S = L L'. The inertia is
 * J = tr(S) I - S up to scale, so with the eigenvalues e1, e2, e3 of S the moments are e2 + e3, e1 + e3 and e1 + e2.
 */
void sf_principal_moments(const sf_real *s, sf_real *moments);

#ifdef __cplusplus
}
#endif
#endif
