/* Arithmetic of one precision without libm, the same bits on every machine; for the filter and the generated model alone. */
#ifndef SPINFILTER_ARITHMETIC_H
#define SPINFILTER_ARITHMETIC_H

#include <string.h>

#include "spinfilter.h"

#define SF_R(number) ((sf_real)(number)) /* folded by the compiler: no double is left in a float filter */

#ifdef SF_DOUBLE
#define SF_SQRT(x) __builtin_sqrt(x)
#define SF_LARGEST_EXPONENT 700.0
#else
#define SF_SQRT(x) __builtin_sqrtf(x)
#define SF_LARGEST_EXPONENT 80.0
#endif

static inline sf_real sf_square(sf_real x) { return x * x; }
static inline sf_real sf_abs(sf_real x) { return x < SF_R(0.0) ? -x : x; }
static inline sf_real sf_max(sf_real x, sf_real y) { return x > y ? x : y; }
static inline sf_real sf_min(sf_real x, sf_real y) { return x < y ? x : y; }

/* exp(x) within two units in the last place; arguments are held to where it is a normal number. */
static inline sf_real sf_exp(sf_real x)
{
  const sf_real limit = SF_R(SF_LARGEST_EXPONENT);
  x = x > limit ? limit : x > -limit ? x : -limit; /* what is no number too */
  const int power = (int)(x * SF_R(1.4426950408889634) + (x < SF_R(0.0) ? SF_R(-0.5) : SF_R(0.5)));
  sf_real rest = x - (sf_real)power * SF_R(0.693145751953125); /* its low bits are zero: the product is exact */
  rest -= (sf_real)power * SF_R(1.4286068203094172321e-6);
  sf_real sum = SF_R(1.0);
  /* Taylor series of exp(rest) by Horner's rule: |rest| is at most ln 2 / 2, so 13 terms reach double precision */
  for (int k = 13; k > 0; --k) sum = SF_R(1.0) + sum * rest / (sf_real)k;
#ifdef SF_DOUBLE
  const uint64_t bits = (uint64_t)(power + 1023) << 52;
#else
  const uint32_t bits = (uint32_t)(power + 127) << 23;
#endif
  sf_real scale;
  memcpy(&scale, &bits, sizeof scale);
  return sum * scale;
}

/* 2 artanh(ratio), |ratio| at most 0.18 */
static inline sf_real sf_artanh2(sf_real ratio)
{
  const sf_real square = ratio * ratio;
  sf_real sum = SF_R(0.0);
  /* sum of ratio^(k - 1) / k over odd k up to 21, by Horner's rule: the next term is below rounding */
  for (int k = 21; k > 0; k -= 2) sum = sum * square + SF_R(1.0) / (sf_real)k;
  return SF_R(2.0) * ratio * sum;
}

/* log(1 + x), x > -1, accurate relative to itself. */
static inline sf_real sf_log1p(sf_real x)
{
  int power = 0;
  sf_real scale = SF_R(1.0), m = x; /* 1 + x = 2^power (1 + m) */
  for (int k = 0; k < 4; ++k) {     /* the correction of a state: 1 + x lies between 1/16 and 16 */
    const int above = m > SF_R(0.4142135623730951), below = m < SF_R(-0.2928932188134525);
    power += above - below;
    scale *= above ? SF_R(0.5) : below ? SF_R(2.0) : SF_R(1.0);
    m = power == 0 ? x : (SF_R(1.0) + x) * scale - SF_R(1.0);
  }
  return sf_artanh2(m / (SF_R(2.0) + m)) + (sf_real)power * SF_R(0.6931471805599453);
}
#endif
