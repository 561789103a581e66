/* Generated from the models of spinfilters; not to be edited. Matrices row by row. */
#ifndef SPINFILTER_MODEL_H
#define SPINFILTER_MODEL_H

#include "spinfilter.h"

void sf_model_inertia(const sf_real *s, sf_real *j, sf_real *dj);
void sf_model_substep(const sf_real *q, const sf_real *w, const sf_real *j, const sf_real h_, sf_real *q_after,
  sf_real *w_after, sf_real *a_aa, sf_real *a_aw, sf_real *a_ww, sf_real *b_a, sf_real *b_w);
void sf_model_transition(const sf_real *x, const sf_real *rotation, const sf_real *psi_aa, const sf_real *psi_aw,
  const sf_real *psi_ww, const sf_real *th_a, const sf_real *th_w, const sf_real *dj, const sf_real *noise, const
  sf_real dt_, const sf_real *psd, sf_real *x_after, sf_real *phi, sf_real *g);
void sf_model_correction(const sf_real *x, const sf_real *d, sf_real *y, sf_real *moved_a, sf_real *moved_s);
void sf_model_pose(const sf_real *x, const sf_real *p, const sf_real *z, sf_real *rho, sf_real *h, sf_real *valid);

#endif
