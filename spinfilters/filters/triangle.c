/* Triangular factor of a covariance, as `covariance_factor` of `square_root.py` defines it. `correction.c` stands before this
 * text. */
enum { ROWS_TOGETHER = 64, LARGEST = 64 };
ABSORB(absorb_16, 16)
ABSORB(absorb_24, 24)
ABSORB(absorb_40, 40)
ABSORB(absorb_64, LARGEST)

/* Takes `count` rows of n numbers, at these distances from row to row and from column to column, into L [n][n] with
 * L L' = rows' rows, its diagonal not negative. n is at most LARGEST. */
void triangle(const double* rows, integer count, integer n, integer down, integer along, double* L) {
  double R[LARGEST * LARGEST] __attribute__((aligned(ALIGNMENT)));
  double block[ROWS_TOGETHER * LARGEST] __attribute__((aligned(ALIGNMENT)));
  const int size = (int)n, pitch = n <= 16 ? 16 : n <= 24 ? 24 : n <= 40 ? 40 : LARGEST;
  memset(R, 0, n * pitch * sizeof(double));
  /* R'R += block' block, some rows at a time; columns behind n stay zero */
  for (integer first = 0; first < count; first += ROWS_TOGETHER) {
    const int some = (int)(count - first < ROWS_TOGETHER ? count - first : ROWS_TOGETHER);
    for (int i = 0; i < some; ++i) {
      const double* row = rows + (first + i) * down;
      for (int j = 0; j < size; ++j) block[i * pitch + j] = row[j * along];
      for (int j = size; j < pitch; ++j) block[i * pitch + j] = 0;
    }
    if (pitch == 16)
      absorb_16(R, block, some, size);
    else if (pitch == 24)
      absorb_24(R, block, some, size);
    else if (pitch == 40)
      absorb_40(R, block, some, size);
    else
      absorb_64(R, block, some, size);
  }
  /* L = R', its columns turned where the diagonal is negative */
  for (int i = 0; i < size; ++i)
    for (int j = 0; j < size; ++j) L[i * n + j] = j > i ? 0 : R[j * pitch + j] < 0 ? -R[j * pitch + i] : R[j * pitch + i];
}
