/* Which landmarks face a camera, are known again and are found, epoch by epoch; `feature_tracks.py` computes the same in NumPy where
 * there is no compiler. */
#include <math.h>
#include <stddef.h>
#include <string.h>

typedef long long integer;

enum { STRIP = 64 }; /* points whose margins are known before their flags are set: loops of numbers and of bytes by themselves */

/* NumPy's `bitgen_t`, of its `random/bitgen.h`. */
typedef struct {
  void* state;
  unsigned long long (*next_uint64)(void*);
  unsigned (*next_uint32)(void*);
  double (*next_double)(void*);
  unsigned long long (*next_raw)(void*);
} BitGenerator;

/* Of `count` points and unit normals (3 x count each), and n.p and |p|^2 of each: found [epochs][count] where the
 * cosine between the normal and the line to the camera exceeds `cosine`, and the depth along the optical axis (its axes in g:
 * [epochs][3]) exceeds the least one. camera: its places in g. */
void facing(integer epochs, integer count, const double* restrict points, const double* restrict normals,
            const double* restrict heights, const double* restrict squares, const double* camera, const double* axes,
            const double* least, double cosine, unsigned char* found) {
  const double *x = points, *y = x + count, *z = y + count, *u = normals, *v = u + count, *w = v + count;
  const double share = cosine * fabs(cosine);
  /* epoch e: the camera at c looks along a, both in g; a row of flags over all points */
  for (integer e = 0; e < epochs; ++e) {
    const double *c = camera + 3 * e, *a = axes + 3 * e, square = c[0] * c[0] + c[1] * c[1] + c[2] * c[2], nearest = least[e];
    const double c0 = c[0], c1 = c[1], c2 = c[2], a0 = a[0], a1 = a[1], a2 = a[2];
    unsigned char* restrict row = found + e * count;
    for (integer begin = 0; begin < count; begin += STRIP) {
      const integer end = begin + STRIP < count ? begin + STRIP : count;
      double margin[STRIP];
      /* l = c - p: n.l = n.c - n.p and |l|^2 = |p|^2 - 2 p.c + |c|^2; facing where n.l > cosine |l|, and as h |h| grows with h, where
       * n.l |n.l| > cosine |cosine| |l|^2. The smaller of both margins is positive where both are. */
      for (integer k = begin; k < end; ++k) {
        const double along = x[k] * c0 + y[k] * c1 + z[k] * c2, depth = x[k] * a0 + y[k] * a1 + z[k] * a2 - nearest;
        const double height = u[k] * c0 + v[k] * c1 + w[k] * c2 - heights[k];
        const double facing = height * fabs(height) - share * (squares[k] - 2 * along + square);
        margin[k - begin] = facing < depth ? facing : depth;
      }
      for (integer k = begin; k < end; ++k) row[k] = margin[k - begin] > 0;
    }
  }
}

/* Of `visible` [epochs][count] those known again: landmark k in its appearance a where `drawn` [appearances][count] at (a,
 * k) is below its probability. now [count] and appearances [count]: 0 at first; begun [count + 1]: room. */
void recognised(integer epochs, integer count, const unsigned char* restrict visible, const double* restrict drawn,
                const double* restrict probability, integer* restrict appearances, unsigned char* restrict now,
                integer* restrict begun, unsigned char* restrict found) {
  /* epoch e: which appearances begin, which of these are recognised, and which landmarks stay so */
  for (integer e = 0; e < epochs; ++e) {
    const unsigned char* seen = visible + e * count;
    integer some = 0;
    /* An appearance begins where a landmark is visible and was not in the epoch before; the place behind the last is written, too. */
    for (integer k = 0; k < count; ++k) {
      begun[some] = k;
      some += e ? seen[k] & ~seen[k - count] : seen[k];
    }
    /* A new appearance draws once whether it is recognised. */
    for (integer j = 0; j < some; ++j) {
      const integer k = begun[j];
      now[k] = drawn[appearances[k]++ * count + k] < probability[k];
    }
    /* Recognised in this epoch: visible, in an appearance that was recognised when it began. */
    for (integer k = 0; k < count; ++k) found[e * count + k] = seen[k] & now[k];
  }
}

/* Of `known` [epochs][count] those that are found, each with the probability `detection`: their landmarks, and `dim` standard normals of
 * each, epoch after epoch; counts [epochs]. Of each epoch a number is drawn for every landmark, then the normals, by NumPy's `fill`. */
void detections(void* generator, void* fill, integer epochs, integer count, const unsigned char* restrict known, double detection,
                integer dim, integer* restrict ids, double* restrict noise, integer* restrict counts) {
  const BitGenerator* bits = generator;
  void (*normals)(void*, ptrdiff_t, double*) = fill;
  for (integer e = 0; e < epochs; ++e) {
    const unsigned char* row = known + e * count;
    integer some = 0;
    /* always written, and kept where the landmark is found: one more is room enough */
    for (integer k = 0; k < count; ++k) {
      ids[some] = k;
      some += row[k] & (bits->next_double(bits->state) < detection);
    }
    normals(generator, (ptrdiff_t)(some * dim), noise);
    ids += some;
    noise += some * dim;
    counts[e] = some;
  }
}
