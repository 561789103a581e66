/* Principal moments from the mass distribution: eigenvalues of a symmetric 3 x 3 matrix by Jacobi's cyclic rotations. */
#include "spinfilter_moments.h"

#include "spinfilter_arithmetic.h"

#define SF_SWEEPS 8 /* always so many: convergence is quadratic after the first few */

/* One rotation that makes S[p][q] zero; r is the third index. */
static void sf_rotate(sf_real S[3][3], int p, int q, int r)
{
  const sf_real off = S[p][q], gap = S[q][q] - S[p][p];
  const sf_real length = sf_abs(gap) + SF_SQRT(gap * gap + SF_R(4.0) * off * off);
  /* tan of the smaller of the two angles that do it; zero where the diagonal elements are equal and the off-diagonal one is zero */
  const sf_real tangent = length > SF_R(0.0) ? (gap < SF_R(0.0) ? SF_R(-2.0) : SF_R(2.0)) * off / length : SF_R(0.0);
  const sf_real cosine = SF_R(1.0) / SF_SQRT(SF_R(1.0) + tangent * tangent), sine = tangent * cosine;
  const sf_real rp = S[r][p], rq = S[r][q];
  S[p][p] -= tangent * off;
  S[q][q] += tangent * off;
  S[p][q] = S[q][p] = SF_R(0.0);
  S[r][p] = S[p][r] = cosine * rp - sine * rq;
  S[r][q] = S[q][r] = sine * rp + cosine * rq;
}

void sf_principal_moments(const sf_real *s, sf_real *moments)
{
  const sf_real L[3][3] = {{sf_exp(s[0]), SF_R(0.0), SF_R(0.0)}, {s[2], sf_exp(s[1]), SF_R(0.0)}, {s[3], s[4], sf_exp(-s[0] - s[1])}};
  sf_real S[3][3];
  for (int i = 0; i < 3; ++i) /* S = L L' */
    for (int j = 0; j < 3; ++j) S[i][j] = L[i][0] * L[j][0] + L[i][1] * L[j][1] + L[i][2] * L[j][2];
  for (int k = 0; k < SF_SWEEPS; ++k) {
    sf_rotate(S, 0, 1, 2);
    sf_rotate(S, 0, 2, 1);
    sf_rotate(S, 1, 2, 0);
  }
  /* sums of two eigenvalues each: no difference loses digits where S is nearly flat */
  const sf_real a = S[1][1] + S[2][2], b = S[0][0] + S[2][2], c = S[0][0] + S[1][1];
  const sf_real largest = sf_max(a, sf_max(b, c)), smallest = sf_min(a, sf_min(b, c));
  const sf_real middle = sf_max(sf_min(a, b), sf_min(sf_max(a, b), c));
  moments[0] = smallest / largest;
  moments[1] = middle / largest;
  moments[2] = SF_R(1.0);
}
