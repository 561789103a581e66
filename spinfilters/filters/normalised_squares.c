/* e' P^-1 e of many errors and of parts of them, P = S S', a matrix in each lane of a vector: `normalised_squares` of
 * `normalised_squares.py`. LANES is defined in front of this text. */
#include <float.h>
#include <math.h>
#include <stdlib.h>

typedef long long integer;
enum { ALIGNMENT = 8 * LANES, BLOCK = 4 };
typedef double lane __attribute__((vector_size(ALIGNMENT), may_alias));
typedef integer mask __attribute__((vector_size(ALIGNMENT), may_alias));

static lane roots(lane square) {
  lane root;
  for (int l = 0; l < LANES; ++l) root[l] = sqrt(square[l]);
  return root;
}

/* w' w of R' w = e, with R'R = rows' rows of columns [count] in `rows` [most][count]: by reflections of the rows that take column
 * after column to the diagonal, and forward substitution on the way. Infinite where a diagonal element vanishes to rounding relative
 * to the norm of its column. */
static lane square_of(lane* restrict rows, integer most, integer count, lane* restrict e) {
  lane sum = {0};
  mask singular = {0};
  for (integer j = 0; j < count; ++j) {
    lane *top = rows + j * count, square = {0}, above = {0};
    for (integer i = 0; i < j; ++i) above += rows[i * count + j] * rows[i * count + j];
    for (integer i = 1; i < most - j; ++i) square += top[i * count + j] * top[i * count + j];
    /* (top[j], rows[:, j]) to (-+length, 0); nothing is reflected where all below is zero */
    const lane alpha = top[j], length = roots(alpha * alpha + square);
    const mask positive = alpha > 0, flat = square == 0;
    const lane head = (lane)(((mask)(alpha + length) & positive) | ((mask)(alpha - length) & ~positive));
    const lane scale = (lane)((mask)(2 / (head * head + square)) & ~flat);
    const lane diagonal = alpha - head * scale * (head * alpha + square), norm = roots(above + length * length);
    singular |= ~((diagonal > DBL_EPSILON * norm) | (-diagonal > DBL_EPSILON * norm));
    const lane w = e[j] / diagonal;
    sum += w * w;
    for (integer k = j + 1; k < count; k += BLOCK) {
      const int some = (int)(count - k < BLOCK ? count - k : BLOCK);
      lane step[BLOCK] = {{0}};
      for (integer i = 1; i < most - j; ++i) {
        const lane v = top[i * count + j];
        for (int b = 0; b < some; ++b) step[b] += v * top[i * count + k + b];
      }
      for (int b = 0; b < some; ++b) {
        step[b] = scale * (head * top[k + b] + step[b]);
        top[k + b] -= head * step[b];
        e[k + b] -= top[k + b] * w; /* R' w = e, its row k + b */
      }
      for (integer i = 1; i < most - j; ++i) {
        const lane v = top[i * count + j];
        for (int b = 0; b < some; ++b) top[i * count + k + b] -= v * step[b];
      }
    }
  }
  const lane infinite = (lane){0} + INFINITY;
  return (lane)(((mask)infinite & singular) | ((mask)sum & ~singular));
}

/* Of each of `items` errors [n] with factors [n][m], the squares of `parts` that begin and end at these components, to [items]
 * [parts]. 0 where there is no memory. */
int normalised_squares(integer items, integer n, integer m, const double* errors, const double* factors, integer parts,
                       const integer* begin, const integer* end, double* squares) {
  lane *all = 0, *rows;
  const size_t bytes = (m * n + n) * sizeof(lane) + ALIGNMENT;
  all = malloc(bytes);
  if (!all) return 0;
  rows = (lane*)(((size_t)all + ALIGNMENT - 1) / ALIGNMENT * ALIGNMENT);
  for (integer first = 0; first < items; first += LANES)
    for (integer p = 0; p < parts; ++p) {
      const integer count = end[p] - begin[p];
      lane* e = rows + m * count;
      /* rows [m][count]: the part's rows of the factors, transposed; lanes without an item repeat the first */
      for (int l = 0; l < LANES; ++l) {
        const integer item = first + l < items ? first + l : first;
        const double *S = factors + (item * n + begin[p]) * m, *own = errors + item * n + begin[p];
        for (integer c = 0; c < count; ++c) {
          ((double*)(e + c))[l] = own[c];
          for (integer k = 0; k < m; ++k) ((double*)(rows + k * count + c))[l] = S[c * m + k];
        }
      }
      const lane found = square_of(rows, m, count, e);
      for (int l = 0; l < LANES && first + l < items; ++l) squares[(first + l) * parts + p] = found[l];
    }
  free(all);
  return 1;
}
