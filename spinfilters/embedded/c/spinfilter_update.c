/* Sensors without landmarks: poses and gyro rates. */
#include "spinfilter_internal.h"
#include "spinfilter_model.h"

/* Rows whitened by the sensor's noise: in, unless they lie outside the gate. Either way takes the same work. */
static int update_rows(sf_filter *filter, const sf_real *rows, const sf_real *innovation, int count, sf_real gate)
{
  sf_filter f;
  sf_correction c;
  sf_copy_filter(&f, filter);
  sf_clear(c.error, SF_N + 1);
  /* one row after the other gives the joint update, because whitened rows have independent noise */
  for (int k = 0; k < count; ++k) sf_update_scalar(&f, &c, rows + k * SF_SEEN_COUNT, innovation[k]);
  sf_reset(&f, &c);
  const int near = c.nis <= gate, finite = sf_is_finite(&f);
  f.nis = c.nis;
  f.dof = (uint16_t)count;
  f.used = 1;
  f.refused = 0;
  filter->used = 0;
  if (!near) filter->refused = (uint16_t)(filter->refused + (filter->refused < UINT16_MAX));
  sf_copy_filter(filter, near & finite ? &f : filter);
  return !near ? SF_REFUSED : finite ? SF_OK : SF_NOT_FINITE;
}

#ifdef SF_HAS_GYRO
int sf_update_gyro(sf_filter *f, const sf_real *rates, const sf_real *parameters)
{
  sf_real innovation[3], rows[3 * SF_SEEN_COUNT], valid[1];
  sf_model_gyro(f->x, parameters, rates, innovation, rows, valid);
  return update_rows(f, rows, innovation, 3, SF_R(SF_GATE_3));
}
#endif

#ifdef SF_HAS_POSE
int sf_update_pose(sf_filter *f, const sf_real *pose, const sf_real *root)
{
  sf_real innovation[6], rows[6 * SF_SEEN_COUNT], valid[1];
  sf_model_pose(f->x, root, pose, innovation, rows, valid);
  return update_rows(f, rows, innovation, 6, SF_R(SF_GATE_6));
}
#endif
