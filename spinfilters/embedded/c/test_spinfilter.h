/* What the test measures on a target: nothing on a host. */
#ifndef TEST_SPINFILTER_H
#define TEST_SPINFILTER_H

#include "spinfilter.h"

enum measured { MEASURED_PREDICTION, MEASURED_UPDATE, MEASURED_COUNT };

#ifdef SF_FIRMWARE
void measure_begin(void);
void measure_end(enum measured what);
#else
#define measure_begin() ((void)0)
#define measure_end(what) ((void)(what))
#endif

uint32_t test_bits(void);            /* a digest of the filter afterwards */
int test_spinfilter(sf_real *worst); /* number of failures; the largest departure, in standard deviations */

#endif
