/* What the loops of `landmarks.c`, `velocities.c` and `roots.c` share. `elimination.py`, `motion_factors.py` and `linear_system.py` say
 * what the loops compute, and do the same in NumPy for machines without a compiler. Matrices are row by row. LANES, how many
 * numbers a vector of this machine holds, is defined in front of this text. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { R = 3, POSE = 6, ROW = POSE + 3 + 1 };
enum { TALL = LANES < 4 ? 4 : LANES }; /* rows by two vectors of columns that stay in registers */
typedef long long integer;
typedef double lanes __attribute__((vector_size(8 * LANES), aligned(8 * LANES)));
typedef double loose __attribute__((vector_size(8 * LANES), aligned(8)));
typedef double four __attribute__((vector_size(32), aligned(8)));
typedef double two __attribute__((vector_size(16), aligned(8)));

/* Lower Cholesky factor of a [n][n] in place, column by column, upper triangle zeroed; 0 where a is not positive definite. */
static int cholesky(double* a, int n) {
  for (int j = 0; j < n; ++j) {
    for (int k = 0; k < j; ++k) a[j * n + j] -= a[j * n + k] * a[j * n + k];
    if (!(a[j * n + j] > 0)) return 0;
    a[j * n + j] = sqrt(a[j * n + j]);
    for (int i = j + 1; i < n; ++i) {
      for (int k = 0; k < j; ++k) a[i * n + j] -= a[i * n + k] * a[j * n + k];
      a[i * n + j] /= a[j * n + j];
      a[j * n + i] = 0;
    }
  }
  return 1;
}
