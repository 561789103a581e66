/* The linear problem of an iteration, assembled and solved in one call by the functions of `velocities.c` and `roots.c`. */

/* Linearised prior of `linearise.c` over F epochs into the linear problem of K: its columns are the poses of its epochs, the
 * constants, and the chain of the first epoch. */
void add_prior(integer K, integer F, integer p, integer v, integer c, const double* gram, const double* gradient, double* M, double* D,
               double* G) {
  const integer kept = K * p + c, poses = F * p, left = poses + c, q = left + v;
  /* column j of the prior is column j of a pose, or j + (K - F) p of a constant */
  for (integer i = 0; i < left; ++i) {
    const double* from = gram + i * q;
    double* to = M + (i < poses ? i : i + (K - F) * p) * kept;
    for (integer j = 0; j < poses; ++j) to[j] += from[j];
    for (integer j = poses; j < left && i >= poses; ++j) to[j + (K - F) * p] += from[j];
    M[kept * kept + (i < poses ? i : i + (K - F) * p)] += gradient[i];
  }
  for (integer a = 0; a < v; ++a) {
    const double* from = gram + (left + a) * q;
    double* to = G + a * (kept + 1);
    for (integer j = 0; j < poses; ++j) to[j] += from[j];
    for (integer j = poses; j < left; ++j) to[j + (K - F) * p] += from[j];
    to[kept] += gradient[left + a];
    for (integer b = 0; b < v; ++b) D[a * v + b] += from[left + b];
  }
}

/* LAPACK's dpotrf, for machines on which `root_of_rows` is slower. */
typedef void Potrf(const char* side, const int* n, double* a, const int* pitch, int* info);

/* Root of M [n + 1][n] and forward substitution of its last row, as `root_of_rows`. */
static integer root_and_right(integer n, double* M, Potrf* potrf) {
  if (!potrf) return root_of_rows(n + 1, n, M);
  const int order = (int)n;
  int info = 0;
  double* y = M + n * n;
  potrf("U", &order, M, &order, &info); /* the lower triangle by rows is the upper one by columns */
  for (integer i = 0; i < n && !info; ++i) y[i] = (y[i] - product(M + i * n, y, 0, i)) / M[i * n + i];
  return info;
}

/* `solve_schur_system` of K epochs with poses of p errors, chains of v and c constants. M [kept + 1][kept] holds the Schur
 * complement of landmarks, and `slope` [K p] their right-hand side (or none); grams of `alone` epochs and of all steps, and a linearised
 * prior over F epochs, are added. Chain, M and begin become what `eliminate_velocities` and `root_of_rows` make of them; out: the
 * right-hand side that M had, the step of what remains, the chain's, and the predicted fall of the cost. Returns 0; or k + 1 where
 * epoch k of the chain, -(k + 1) where row k of M is not positive definite; K + 1 where there is no memory. */
integer solve_window(integer K, integer p, integer v, integer c, const double* slope, integer alone, const double* epochs,
                     const double* steps, integer F, const double* prior, const double* prior_slope, double damping, double faded,
                     Potrf* potrf, double* M, double* D, double* E, double* G, integer* begin, double* gradient, double* step,
                     double* back, double* predicted) {
  const integer kept = K * p + c, width = kept + 1, blocks = p ? K : 0;
  double* right = M + kept * kept;
  for (integer j = 0; j < K * p && slope; ++j) right[j] += slope[j];
  add_information_blocks(alone, 0, K, p, v, c, epochs, M, D, E, G);
  if (steps) add_information_blocks(K - 1, 1, K, p, v, c, steps, M, D, E, G);
  if (F) add_prior(K, F, p, v, c, prior, prior_slope, M, D, G);
  if (damping != 0) {
    for (integer k = 0; k < K * v; ++k) D[k * v + k % v] *= 1 + damping;
    for (integer i = 0; i < kept; ++i) M[i * kept + i] *= 1 + damping;
  }
  const integer failed = eliminate_velocities(K, v, p, blocks, width, F, faded, D, E, G, begin);
  if (failed) return failed < 0 ? K + 1 : failed;
  reduce_velocities(K, v, p, blocks, kept, F, begin, G, M);
  memcpy(gradient, right, kept * sizeof(double));
  const integer open = kept ? root_and_right(kept, M, potrf) : 0;
  if (open) return open < 0 ? K + 1 : -open;
  /* |L^-1 b|^2 and the chain's share are the predicted fall; back substitution by L' of rows from the last */
  double fall = 0;
  for (integer j = 0; j < kept; ++j) fall += right[j] * right[j];
  if (!(fall < INFINITY)) return -1;
  for (integer k = 0; k < K * v; ++k) fall += G[k * width + kept] * G[k * width + kept];
  memcpy(step, right, kept * sizeof(double));
  for (integer i = kept - 1; i >= 0; --i) {
    const double *row = M + i * kept, x = step[i] /= row[i];
    for (integer j = 0; j < i; ++j) step[j] -= x * row[j];
  }
  *predicted = fall;
  solve_velocities(K, v, p, blocks, kept, F, begin, G, D, E, step, back);
  return 0;
}
