/* The filter against the Python reference: `make test` on a host, `make emulate` on an emulated Cortex-M4F. */
#include "spinfilter.h"
#include "test_vectors.h"
#include "test_spinfilter.h"

#define WORST_DEVIATION 1e-3 /* of a state, in its standard deviations, and of these themselves, relatively */

static sf_real absolute(sf_real x) { return x < (sf_real)0 ? -x : x; }

#ifdef SF_HAS_STEREO
#define COUNT (sizeof vector_values / sizeof *vector_values / 3 / EPOCHS)
static sf_landmark map[SF_LANDMARKS];
static sf_observation observations[COUNT];

static void begin_map(void)
{
  /* the known landmarks at every other place, so that the rest of the map begins empty */
  for (unsigned k = 0; 3 * k < sizeof vector_known / sizeof *vector_known; ++k) {
    for (int i = 0; i < 3; ++i) map[2 * k].point[i] = vector_known[3 * k + i];
    for (int i = 0; i < 6; ++i) map[2 * k].covariance[i] = vector_known_covariance[i];
    map[2 * k].hits = 2;
  }
}

static void observe(int epoch)
{
  const sf_real *values = vector_values + 3 * COUNT * epoch;
  /* observation k of place k, [COUNT][3] pixels an epoch */
  for (unsigned k = 0; k < COUNT; ++k) {
    observations[k].landmark = (uint16_t)k;
    for (int i = 0; i < 3; ++i) observations[k].pixels[i] = values[3 * k + i];
  }
}

/* The last epoch again, in turn not finite, far off, in an empty place or behind the camera; with all: not finite. */
static void spoil(sf_real not_finite, int all)
{
  observe(EPOCHS - 1);
  /* of eight observations four are spoilt, each in a different way */
  for (unsigned k = 0; k < COUNT; ++k) {
    if (all || k % 8 == 1) observations[k].pixels[k % 3] = not_finite;
    else if (k % 8 == 3) observations[k].pixels[1] += (sf_real)90;
    else if (k % 8 == 5) map[k].hits = 0;
    else if (k % 8 == 7) map[k].point[2] -= vector_x[2] + (sf_real)1;
  }
}

static int update(sf_filter *f)
{
  measure_begin();
  const int status = sf_update_stereo(f, map, observations, COUNT, vector_camera);
  measure_end(MEASURED_UPDATE);
  return status;
}
#else
#define COUNT (sizeof vector_values / sizeof *vector_values / EPOCHS)
static sf_real value[COUNT];

static void begin_map(void) {}

static void observe(int epoch)
{
  /* values of the epoch, [EPOCHS][COUNT] */
  for (unsigned k = 0; k < COUNT; ++k) value[k] = vector_values[COUNT * epoch + k];
}

static void spoil(sf_real not_finite, int all)
{
  observe(EPOCHS - 1);
  if (all) value[0] = not_finite;
}

static int update(sf_filter *f)
{
  measure_begin();
#ifdef SF_HAS_POSE
  const int status = sf_update_pose(f, value, vector_parameters);
#else
  const int status = sf_update_gyro(f, value, vector_parameters);
#endif
  measure_end(MEASURED_UPDATE);
  return status;
}
#endif

static sf_filter f;

uint32_t test_bits(void) /* FNV-1a of the state and its covariance: the same on every machine without fused multiply-add */
{
  const unsigned char *at = (const unsigned char *)f.x, *stop = (const unsigned char *)f.psd;
  uint32_t hash = 2166136261u;
  /* each byte from the state to the end of D, which lie one behind the other */
  while (at < stop) hash = (hash ^ *at++) * 16777619u;
  return hash;
}

/* Values that are of no use take the same work, and change nothing. */
static int test_spoilt(void)
{
  volatile sf_real zero = 0;
  const sf_real not_a_number = zero / zero, infinite = (sf_real)1 / zero;
  int wrong = 0;
  spoil(not_a_number, 0);
  wrong += update(&f) != SF_OK;
  spoil(infinite, 0);
  wrong += update(&f) != SF_OK;
  const uint32_t before = test_bits();
  spoil(not_a_number, 1);
  wrong += update(&f) != SF_REFUSED;
  spoil(infinite, 1);
  wrong += update(&f) != SF_REFUSED;
  return wrong + (test_bits() != before);
}

int test_spinfilter(sf_real *worst)
{
  sf_real deviations[SF_N];
  int wrong = sf_begin(&f, vector_x, vector_covariance, vector_psd[0], vector_psd[1]) != SF_OK;
  *worst = 0;
  begin_map();
  /* each epoch: predict, update, and compare state and standard deviations with the reference */
  for (int epoch = 0; epoch < EPOCHS; ++epoch) {
    const sf_real *expected = vector_expected + (SF_NX + SF_N) * epoch;
    measure_begin();
    wrong += sf_predict(&f, (sf_real)INTERVAL) != SF_OK;
    measure_end(MEASURED_PREDICTION);
    observe(epoch);
    wrong += update(&f) != SF_OK;
    sf_deviations(&f, deviations);
    /* error k against its expected deviation; behind the vector part of q, places of the state run one ahead of errors */
    for (int k = 0; k < SF_N; ++k) {
      const sf_real std = expected[SF_NX + k];
      const int place = k + (k >= SF_X_Q + 3);
      const sf_real off = absolute(f.x[place] - expected[place]) / std;
      const sf_real spread = absolute(deviations[k] / std - (sf_real)1);
      if (!(off <= *worst)) *worst = off;
      if (!(spread <= *worst)) *worst = spread;
    }
  }
  return wrong + !(*worst < (sf_real)WORST_DEVIATION) + test_spoilt();
}

#ifndef SF_FIRMWARE
#include <stdio.h>

int main(void)
{
  sf_real worst;
  const int wrong = test_spinfilter(&worst);
  printf("%s: largest departure from the Python reference %.2g standard deviations\nbits %lu\n", wrong ? "FAILED" : "passed",
         (double)worst, (unsigned long)test_bits());
  return wrong != 0;
}
#endif
