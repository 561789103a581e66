/* Which landmarks face a camera and are known again, epoch by epoch; `visibility.py` computes the same in NumPy where there is no
 * compiler. */
#include <math.h>
#include <string.h>

typedef long long integer;

/* Of `count` points and unit normals (3 x count each), and n.p and |p|^2 of each: found [epochs][count] where the
 * cosine between the normal and the line to the camera exceeds `cosine`, and the depth along the optical axis (its axes in g:
 * [epochs][3]) exceeds the least one. camera: its places in g. */
void facing(integer epochs, integer count, const double* restrict points, const double* restrict normals,
            const double* restrict heights, const double* restrict squares, const double* camera, const double* axes,
            const double* least, double cosine, unsigned char* found) {
  const double *x = points, *y = x + count, *z = y + count, *u = normals, *v = u + count, *w = v + count;
  /* epoch e: the camera at c looks along a, both in g; a row of flags over all points */
  for (integer e = 0; e < epochs; ++e) {
    const double *c = camera + 3 * e, *a = axes + 3 * e, square = c[0] * c[0] + c[1] * c[1] + c[2] * c[2];
    unsigned char* restrict row = found + e * count;
    /* l = c - p: n.l = n.c - n.p and |l|^2 = |p|^2 - 2 p.c + |c|^2; facing where n.l > cosine |l|. */
    for (integer k = 0; k < count; ++k) {
      const double along = x[k] * c[0] + y[k] * c[1] + z[k] * c[2], depth = x[k] * a[0] + y[k] * a[1] + z[k] * a[2];
      const double height = u[k] * c[0] + v[k] * c[1] + w[k] * c[2] - heights[k];
      row[k] = (height > cosine * sqrt(squares[k] - 2 * along + square)) & (depth > least[e]);
    }
  }
}

/* Of `visible` [epochs][count] those known again: landmark k in its appearance a where `drawn` [epochs][count] at (a,
 * k) is below its probability. now [count + 8], 0 at first; begun [count + 8] likewise, read eight at once, of which few are new. */
void recognised(integer epochs, integer count, const unsigned char* restrict visible, const double* restrict drawn,
                const double* restrict probability, integer* restrict appearances, unsigned char* restrict now,
                unsigned char* restrict begun, unsigned char* restrict found) {
  /* epoch e: which appearances begin, which of these are recognised, and which landmarks stay so */
  for (integer e = 0; e < epochs; ++e) {
    const unsigned char *seen = visible + e * count, *before = e ? seen - count : now + count;
    /* An appearance begins where a landmark is visible and was not in the epoch before. */
    for (integer k = 0; k < count; ++k) begun[k] = seen[k] & ~before[e ? k : 0];
    /* Eight flags as one word: most words are 0 and skipped. A new appearance draws once whether it is recognised. */
    for (integer k = 0; k < count; k += 8) {
      unsigned long long eight;
      memcpy(&eight, begun + k, 8);
      for (integer i = k; eight && i < k + 8; ++i)
        if (begun[i]) now[i] = drawn[appearances[i]++ * count + i] < probability[i];
    }
    /* Recognised in this epoch: visible, in an appearance that was recognised when it began. */
    for (integer k = 0; k < count; ++k) found[e * count + k] = seen[k] & now[k];
  }
}
