/* Second-order terms of the motion along soft directions of a belief, as `flow_curvature.py` defines them. `filter_step.c` stands
 * before this text. */
enum { LARGEST_FACTOR = 64, MOST_SWEEPS = 30 };
static const double ORTHOGONAL = 1e-15; /* cosine of the angle between rows that count as orthogonal */

/* Turns rows A [count][width] into one another until all are orthogonal (Jacobi's method on one side): row k becomes w v', a
 * singular value and its right vector. */
static void orthogonalise(double* A, integer count, integer width) {
  for (int sweep = 0, turned = 1; turned && sweep < MOST_SWEEPS; ++sweep) {
    turned = 0;
    /* every pair of rows by the angle that makes it orthogonal */
    for (integer i = 0; i < count; ++i)
      for (integer j = i + 1; j < count; ++j) {
        double *a = A + i * width, *b = A + j * width, aa = 0, bb = 0, ab = 0;
        for (integer k = 0; k < width; ++k) {
          aa += a[k] * a[k];
          bb += b[k] * b[k];
          ab += a[k] * b[k];
        }
        if (!(fabs(ab) > ORTHOGONAL * sqrt(aa * bb))) continue;
        const double zeta = (bb - aa) / (2 * ab), tangent = copysign(1, zeta) / (fabs(zeta) + sqrt(1 + zeta * zeta));
        const double cosine = 1 / sqrt(1 + tangent * tangent), sine = cosine * tangent;
        for (integer k = 0; k < width; ++k) {
          const double before = a[k];
          a[k] = cosine * before - sine * b[k];
          b[k] = sine * before + cosine * b[k];
        }
        turned = 1;
      }
  }
}

/* X of A X = B, where W [n][n + count] is [A | B] and becomes [* | X]: elimination with partial pivoting, 0 where A is singular. */
static int solve_beside(double* W, integer n, integer count) {
  const integer w = n + count;
  for (integer j = 0; j < n; ++j) {
    integer pivot = j;
    for (integer i = j + 1; i < n; ++i)
      if (fabs(W[i * w + j]) > fabs(W[pivot * w + j])) pivot = i;
    if (!(fabs(W[pivot * w + j]) > 0)) return 0;
    if (pivot != j)
      for (integer k = j; k < w; ++k) {
        const double other = W[j * w + k];
        W[j * w + k] = W[pivot * w + k];
        W[pivot * w + k] = other;
      }
    /* rows below: less their share of the pivot's */
    for (integer i = j + 1; i < n; ++i) {
      const double share = W[i * w + j] / W[j * w + j];
      if (share != 0)
        for (integer k = j + 1; k < w; ++k) W[i * w + k] -= share * W[j * w + k];
    }
  }
  /* substitution from the last row up, in the columns of B */
  for (integer i = n - 1; i >= 0; --i)
    for (integer k = n; k < w; ++k) {
      double sum = W[i * w + k];
      for (integer j = i + 1; j < n; ++j) sum -= W[i * w + j] * W[j * w + k];
      W[i * w + k] = sum / W[i * w + i];
    }
  return 1;
}

/* F^-1 c of a stretch of this duration at x along `soft` changes b [soft][n] of the state, each of these lengths (in deviations of
 * the belief): W [n][n + soft] gets them in its last columns. 0 where that is not possible here. */
static int bends_along(const Filter* f, integer soft, double duration, const double* x, const double* lengths, double* b, double* W,
                       double* room) {
  const Points* u = f->points;
  const integer n = f->n, m = f->point, p = 2 * soft + 1, w = n + soft, *none[] = {0, 0};
  const Step at = parts_of(f, room);
  double *points = room + step_room(f), *moved = points + p * m, *away = moved + p * m, *stepping = away + 2 * soft * n;
  if (!linearise_step(f, duration, x, &at)) return 0;
  /* points x [+] b, x [+] -b, and x, to their ends */
  for (integer k = 0; k < soft * n; ++k) b[soft * n + k] = -b[k];
  {
    const double* from[] = {x, b};
    const integer width[] = {0, n};
    double* const to[] = {points};
    u->retract(2 * soft, from, width, none, to);
  }
  memcpy(points + 2 * soft * m, x, m * sizeof(double));
  if (!step_points(f, p, duration, points, moved, stepping)) return 0;
  {
    const double* from[] = {moved + 2 * soft * m, moved};
    const integer width[] = {0, m};
    double* const to[] = {away};
    u->local(2 * soft, from, width, none, to);
  }
  /* [F | c], c of a whole deviation */
  for (integer i = 0; i < n; ++i) {
    memcpy(W + i * w, at.transition + i * n, n * sizeof(double));
    for (integer k = 0; k < soft; ++k)
      W[i * w + n + k] = (away[k * n + i] + away[(soft + k) * n + i]) / (lengths[k] * lengths[k]);
  }
  return solve_beside(W, n, soft);
}

/* Numbers of the room of `widen` for factors [size][size]. */
static integer widening_room(const Filter* f, integer size) {
  if (!f->curvature) return 0;
  const integer n = f->n, q = f->curvature->count, p = 2 * q + 1, w = n > size ? n : size;
  return q * size + 2 * q * n + q * n + w * (w + q) + size * size + step_room(f) + 2 * p * f->point + 2 * q * n + points_room(f, p);
}

/* The largest of changes [soft][n] in deviations of a belief of factor S, of which the state has the first rows: infinite where the
 * belief is singular. */
static double largest_of(const Filter* f, const double* changes, integer soft, const double* S, integer size, double* L,
                         double* W) {
  const integer n = f->n, w = n + soft;
  double largest = 0;
  /* [S | changes'], with a square factor of the state's own covariance where there are errors besides */
  if (size > n) f->triangle(S, size, n, 1, size, L);
  for (integer i = 0; i < n; ++i) {
    memcpy(W + i * w, size > n ? L + i * n : S + i * n, n * sizeof(double));
    for (integer k = 0; k < soft; ++k) W[i * w + n + k] = changes[k * n + i];
  }
  if (!solve_beside(W, n, soft)) return INFINITY;
  for (integer k = 0; k < soft; ++k) {
    double square = 0;
    for (integer i = 0; i < n; ++i) square += W[i * w + n + k] * W[i * w + n + k];
    if (!(sqrt(square) <= largest)) largest = sqrt(square);
  }
  return largest;
}

/* `FlowCurvature.widened`: factor S [size][size], of which the state has the first rows, before a step of dt from x. `stretch` are
 * the seconds left of the present one, and the pause. 0 where that is not possible here; then nothing is done. */
static int widen(const Filter* f, double dt, const double* x, double* S, integer size, double* stretch, double* room) {
  const Curvature* c = f->curvature;
  if (!c || !(stretch[0] < dt / 2)) return 1;
  if (size > LARGEST_FACTOR) return 0;
  const integer n = f->n, q = c->count, wide = n > size ? n : size;
  double *rows = room, *b = rows + q * size, *bends = b + 2 * q * n, *W = bends + q * n, *L = W + wide * (wide + q);
  double square = 0, shares[LARGEST_FACTOR];
  memcpy(rows, S + c->first * size, q * size * sizeof(double));
  for (integer k = 0; k < q * size; ++k) square += rows[k] * rows[k];
  if (!isfinite(square)) return 0;
  /* b = S v along each principal direction of the mass distribution that is soft, no longer than where the second order holds */
  integer soft = 0;
  if (square > c->soft * c->soft) orthogonalise(rows, q, size);
  for (integer k = 0; k < q; ++k) {
    const double *v = rows + k * size, width = length(v, size), share = fmin(1, c->longest_step / width);
    if (!(width > c->soft)) continue;
    for (integer i = 0; i < n; ++i) {
      double sum = 0;
      for (integer j = 0; j < size; ++j) sum += S[i * size + j] * v[j];
      b[soft * n + i] = sum * share / width;
    }
    shares[soft++] = share;
  }
  if (!soft) { /* the mass distribution is known, and does not change */
    stretch[0] = INFINITY;
    return 1;
  }
  const double rate = length(x + f->rate, 3), duration = rate > 0 && c->turn / rate > dt ? c->turn / rate : dt;
  if (!bends_along(f, soft, duration, x, shares, b, W, L + size * size)) return 0;
  for (integer k = 0; k < soft; ++k)
    for (integer i = 0; i < n; ++i) bends[k * n + i] = W[i * (n + soft) + n + k];
  if (!all_finite(bends, soft * n)) return 0;
  const int is_negligible = largest_of(f, bends, soft, S, size, L, W) < c->negligible;
  stretch[1] = is_negligible ? fmin(2 * stretch[1], c->longest_pause) : 1;
  stretch[0] = stretch[1] * duration;
  if (is_negligible) return 1;
  /* S S' + 3/4 sum of c c': the triangle of [S'; root(3/4) c'], column by column of S */
  for (integer j = 0; j < size; ++j)
    for (integer i = 0; i < size; ++i) W[j * size + i] = S[i * size + j];
  memset(W + size * size, 0, soft * size * sizeof(double));
  for (integer k = 0; k < soft; ++k)
    for (integer i = 0; i < n; ++i) W[(size + k) * size + i] = sqrt(0.75) * bends[k * n + i];
  f->triangle(W, size + soft, size, size, 1, S);
  return 1;
}
