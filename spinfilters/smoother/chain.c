/* An eliminated chain solved for many right-hand sides at once, for `linear_rows.py` of the verdict; types are those of `kernels.h`. Epoch k
 * has the lower root L_k [v][v], the step to the next one the coupling F_k [v][v], and each epoch rows n_k [v][m]. */

/* to [m] -= factor * from [m]. */
static inline void subtract_multiple(integer m, double factor, const double* from, double* to) {
  for (integer q = 0; q < m; ++q) to[q] -= factor * from[q];
}

/* n_k = L_k^-1 (n_k - F_k-1' n_k-1), from the first epoch on. */
void chain_forward(integer K, integer v, integer m, const double* L, const double* F, double* n) {
  for (integer k = 0; k < K; ++k, n += v * m, L += v * v) {
    if (k) {
      const double *before = n - v * m, *own = F + (k - 1) * v * v;
      for (integer i = 0; i < v; ++i)
        for (integer j = 0; j < v; ++j) subtract_multiple(m, own[j * v + i], before + j * m, n + i * m);
    }
    for (integer i = 0; i < v; ++i) {
      for (integer j = 0; j < i; ++j) subtract_multiple(m, L[i * v + j], n + j * m, n + i * m);
      const double inverse = 1 / L[i * v + i];
      for (integer q = 0; q < m; ++q) n[i * m + q] *= inverse;
    }
  }
}

/* n_k = L_k^-T (n_k - F_k n_k+1), from the last epoch back. */
void chain_backward(integer K, integer v, integer m, const double* L, const double* F, double* n) {
  for (integer k = K - 1; k >= 0; --k) {
    double* here = n + k * v * m;
    const double *root = L + k * v * v, *own = F + k * v * v, *next = here + v * m;
    for (integer i = 0; k + 1 < K && i < v; ++i)
      for (integer j = 0; j < v; ++j) subtract_multiple(m, own[i * v + j], next + j * m, here + i * m);
    for (integer i = v - 1; i >= 0; --i) {
      for (integer j = i + 1; j < v; ++j) subtract_multiple(m, root[j * v + i], here + j * m, here + i * m);
      const double inverse = 1 / root[i * v + i];
      for (integer q = 0; q < m; ++q) here[i * m + q] *= inverse;
    }
  }
}
