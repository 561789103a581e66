/* The steps of an epoch's observations of landmarks; `landmark_steps.py` says what they compute, and computes it in NumPy where
 * there is no compiler. D components of an observation, C columns of the state that it depends on, M modes, N rows of the
 * factor, LANES, and `stored`, float or double, are defined in front of this text, which follows `correction.c`. Matrices are
 * row by row.
 *
 * The small matrices of LANES landmarks are handled side by side: a `lane` holds one entry of each. A group that is
 * not full is filled up with its last landmark, whose observation then has no weight. */
enum { LINEAR = C + 4, BAND = 4, STEP = 3 };

/* `LandmarkMap`: where its arrays lie. */
typedef struct {
  integer *epoch, *hits, *wrong, *last;
  double *transform, *spread, *shift, *points;
  stored *modes, *roots;
} Map;

/* LANES observations of `WhitenedLandmarks`: rows (D x W), replaced in the end by the pull X' rows on their landmarks (3 x W); X
 * and H_p L. */
typedef struct {
  loose rows[D * W], spread[D * 3], gram[D * 3];
} Group;

static inline lane square_roots(lane x) {
  double each[LANES] __attribute__((aligned(ALIGNMENT)));
  *(lane*)each = x;
  /* one by one: vector types have no square root */
  for (int i = 0; i < LANES; ++i) each[i] = sqrt(each[i]);
  return *(lane*)each;
}

/* x with the sign of y. */
static inline lane with_sign(lane x, lane y) {
  const mask sign = (mask)(-(lane){0});
  return (lane)(((mask)x & ~sign) | ((mask)y & sign));
}

/* Lower triangular L (3 x 3) with L L' = X X', X (3 x count) overwritten, by reflections: squares of numbers of very
 * different size would lose the smaller ones to rounding. */
static inline __attribute__((always_inline)) void lower_root(lane* X, const int count, lane* L) {
  /* Reflection j from the right takes row j, columns j .. count, to (-length, 0 ..), and the rows below with it. */
  for (int j = 0; j < 3; ++j) {
    lane *v = X + j * count, square = {0};
    for (int k = j; k < count; ++k) square += v[k] * v[k];
    const lane length = with_sign(square_roots(square), v[j]);
    const lane scale = 1 / (square + v[j] * length + TINY);
    v[j] += length;
    for (int i = 0; i < j; ++i) L[3 * i + j] = (lane){0};
    L[4 * j] = -length;
    for (int i = j + 1; i < 3; ++i) {
      lane *row = X + i * count, sum = {0};
      for (int k = j; k < count; ++k) sum += v[k] * row[k];
      sum *= scale;
      for (int k = j; k < count; ++k) row[k] -= sum * v[k];
      L[3 * i + j] = row[j];
    }
  }
}

/* Point and modes of one landmark to the present; lower triangle of P = A spread A', by which its own covariance grows. */
static inline void follow(const Map* map, integer k, integer slots, double* P) {
  const integer slot = map->epoch[k] % slots;
  const double *T = map->transform + slot * M * M, *S = map->spread + slot * M * M, *b = map->shift + slot * M;
  double AS[3 * M] = {0}, moved[3 * M] = {0};
  stored* A = map->modes + k * 3 * M;
  /* Point += A shift; A transform and A spread, row a of 3. */
  for (int a = 0; a < 3; ++a) {
    double sum = 0;
    for (int m = 0; m < M; ++m) {
      const double s = A[a * M + m];
      sum += s * b[m];
      for (int l = 0; l < M; ++l) {
        moved[a * M + l] += s * T[m * M + l];
        AS[a * M + l] += s * S[m * M + l];
      }
    }
    map->points[3 * k + a] += sum;
  }
  /* P = (A spread) A', lower triangle. */
  for (int a = 0; a < 3; ++a)
    for (int c = 0; c <= a; ++c) {
      double sum = 0;
      for (int m = 0; m < M; ++m) sum += AS[a * M + m] * A[c * M + m];
      P[3 * a + c] = sum;
    }
  /* the moved modes at last: P above needs A as it was */
  for (int a = 0; a < 3 * M; ++a) A[a] = (stored)moved[a];
}

/* Roots of so many landmarks take in their P, which is overwritten. */
static void widen(const Map* map, const integer* at, int count, lane* P) {
  const lane least[] = {1e-14 * P[0], 1e-14 * P[4], 1e-14 * P[8]};
  lane X[18], L[9];
  /* X = [root | .], 3 x 6: a landmark's root in the first three columns; spare lanes repeat the last landmark */
  for (int i = 0; i < LANES; ++i) {
    const stored* root = map->roots + 9 * at[i < count ? i : count - 1];
    for (int a = 0; a < 3; ++a) TAKE(root + 3 * a, 3, i, X + 6 * a);
  }
  for (int j = 0; j < 3; ++j) { /* X = [. | lower root of P], by elimination; pivots that are nothing but rounding count as zero */
    const mask good = P[4 * j] > least[j];
    const lane out = (lane)((mask)(1 / square_roots(P[4 * j])) & good);
    for (int a = 0; a < 3; ++a) X[6 * a + 3 + j] = (a < j ? 0 : 1) * P[3 * a + j] * out;
    for (int a = j + 1; a < 3; ++a)
      for (int c = j + 1; c <= a; ++c) P[3 * a + c] -= X[6 * a + 3 + j] * X[6 * c + 3 + j];
  }
  lower_root(X, 6, L);
  /* L L' = root root' + P, back to each landmark; spare lanes are not written */
  for (int i = 0; i < count; ++i) PUT(L, 9, i, map->roots + 9 * at[i], stored);
}

/* `LandmarkMap.refresh`: landmarks in these rows, to the present modes; of all, where none are given, those whose turn it is, from
 * `begin` to `end`, and those that fall behind. */
void refresh(integer count, const integer* at, integer begin, integer end, integer now, integer slots, const Map* map) {
  integer late[LANES];
  lane P[9] = {0};
  int some = 0;
  /* Landmarks that are behind are collected and widened LANES at a time; the last group may be smaller. */
  for (integer i = 0; i < count; ++i) {
    const integer k = at ? at[i] : i, behind = now - map->epoch[k];
    if (behind > 0 && (at || (i >= begin && i < end) || behind > slots - 2)) {
      double own[9] = {0};
      follow(map, k, slots, own);
      TAKE(own, 9, some, P);
      map->epoch[k] = now;
      late[some++] = k;
    }
    if (some == LANES || (some > 0 && i + 1 == count)) {
      widen(map, late, some, P);
      some = 0;
    }
  }
}

/* Transformations of all slots, one step on: of the modes, and what is dropped of them, by the last M rows of `turned`. */
static void compose(integer slots, const double* turned, const double* by, const Map* map) {
  enum { QL = (Q + LANES - 1) / LANES, ML = (M + LANES - 1) / LANES };
  lane from[M * QL] = {{0}};
  /* rows of `turned`, filled up to whole lanes */
  for (int m = 0; m < M; ++m) memcpy(from + m * QL, turned + (C + m) * Q, Q * sizeof(double));
  for (integer s = 0; s < slots; ++s) {
    double *T = map->transform + s * M * M, *S = map->spread + s * M * M;
    lane f[C * ML] = {{0}};
    /* Row a of transform [modes kept | dropped]: shift += T by, T <- T kept, f = T dropped (stored [C][M]). */
    for (int a = 0; a < M; ++a) {
      double sum = 0;
      lane row[QL] = {{0}};
      for (int m = 0; m < M; ++m) {
        const double t = T[a * M + m];
        sum += t * by[m];
        for (int l = 0; l < QL; ++l) row[l] += t * from[m * QL + l];
      }
      map->shift[s * M + a] += sum;
      memcpy(T + a * M, row, M * sizeof(double));
      for (int l = 0; l < C; ++l) ((double*)(f + l * ML))[a] = ((double*)row)[M + l];
    }
    /* spread += f f', the dropped modes at unit covariance. */
    for (int a = 0; a < M; ++a) {
      lane row[ML] = {{0}};
      memcpy(row, S + a * M, M * sizeof(double));
      for (int l = 0; l < C; ++l)
        for (int c = 0; c < ML; ++c) row[c] += ((double*)(f + l * ML))[a] * f[l * ML + c];
      memcpy(S + a * M, row, M * sizeof(double));
    }
  }
}

/* `whitened`: the groups; returns the log determinant of what whitens all. */
double whiten(integer count, const double* linear, const double* weights, const integer* at, const Map* map, Group* g) {
  double log_noise = 0;
  /* a group: H = [by columns | by point | innovation] of each observation, modes A and root L of its landmark, in lanes */
  for (integer first = 0; first < count; first += LANES, ++g) {
    lane H[D * LINEAR], A[3 * M], L[9], root = {0}, X[3 * (3 + D)], T[9], out[D], volume = 1 + root;
    const int some = (int)(count - first < LANES ? count - first : LANES);
    for (int i = 0; i < LANES; ++i) {
      const integer k = first + (i < some ? i : some - 1);
      TAKE(linear + k * D * LINEAR, D * LINEAR, i, H);
      TAKE(map->modes + at[k] * 3 * M, 3 * M, i, A);
      TAKE(map->roots + at[k] * 9, 9, i, L);
      ((double*)&root)[i] = i < some ? weights[k] : 0;
    }
    /* gram = sqrt(weight) H_p L (D x 3); the lower root T of X X', X = [I | gram], whitens the rows. */
    root = square_roots(root);
    for (int d = 0; d < D; ++d) {
      const lane* h = H + d * LINEAR + C;
      for (int a = 0; a < 3; ++a) {
        const lane x = root * (h[0] * L[a] + h[1] * L[3 + a] + h[2] * L[6 + a]);
        g->gram[3 * d + a] = X[d * (D + 3) + D + a] = x;
      }
      for (int e = 0; e < D; ++e) X[d * (D + 3) + e] = (lane){0} + (d == e);
    }
    lower_root(X, D + 3, T);
    for (int d = 0; d < D; ++d) {
      out[d] = 1 / T[4 * d];
      volume *= T[4 * d] / root;
    }
    /* Forward substitution by T of the columns: pose (C), modes through the landmark (M), innovation, then gram (3) to X. */
    for (int k = 0; k < W + 3; ++k) {
      lane v[D];
      for (int d = 0; d < D; ++d) {
        const lane* h = H + d * LINEAR;
        if (k < C) v[d] = root * h[k];
        else if (k < Q) v[d] = root * (h[C] * A[k - C] + h[C + 1] * A[M + k - C] + h[C + 2] * A[2 * M + k - C]);
        else if (k == Q) v[d] = root * h[C + 3];
        else v[d] = g->gram[3 * d + k - W];
        for (int e = 0; e < d; ++e) v[d] -= T[3 * d + e] * v[e];
        v[d] *= out[d];
        if (k < W) g->rows[d * W + k] = v[d];
        else g->spread[3 * d + k - W] = v[d];
      }
    }
    for (int i = 0; i < some; ++i) log_noise += log(fabs(((double*)&volume)[i]));
  }
  return log_noise;
}

/* `lever_squares`: sums of squares of X in so many groups, of the roots of these landmarks, and of their points about the mean. */
void sum_levers(integer groups, const Group* g, integer count, const integer* at, const Map* map, double* squares) {
  lane sum = {0};
  double mean[3] = {0};
  squares[0] = squares[1] = squares[2] = 0;
  for (; groups > 0; --groups, ++g) /* lanes that fill the last group up hold zeros */
    for (int k = 0; k < 3 * D; ++k) sum += g->spread[k] * g->spread[k];
  for (int i = 0; i < LANES; ++i) squares[0] += ((const double*)&sum)[i];
  /* their mean first: differences of large sums would lose the lever arms to rounding */
  for (integer i = 0; i < count; ++i) {
    const stored* root = map->roots + 9 * at[i];
    for (int a = 0; a < 9; ++a) squares[1] += (double)root[a] * (double)root[a];
    for (int a = 0; a < 3; ++a) mean[a] += map->points[3 * at[i] + a] / (double)count;
  }
  for (integer i = 0; i < count; ++i)
    for (int a = 0; a < 3; ++a) {
      const double lever = map->points[3 * at[i] + a] - mean[a];
      squares[2] += lever * lever;
    }
}

/* `corrected`: see `correct_rows`, which this ends with. */
double correct(integer count, integer n, const Group* g, const integer* columns, double* factor, double* root, double* shift,
               double* error) {
  double R[W * WP] __attribute__((aligned(ALIGNMENT))) = {0}, block[BAND * D * LANES * WP] __attribute__((aligned(ALIGNMENT)));
  /* BAND groups fill the block of ordinary rows */
  for (integer left = (count + LANES - 1) / LANES; left > 0; left -= BAND) {
    const int some = (int)(left < BAND ? left : BAND);
    /* Lanes apart again: rows [BAND D LANES][WP] of ordinary numbers, absorbed into the triangle R. */
    for (int i = 0; i < some; ++i, ++g)
      for (int d = 0; d < D; ++d)
        for (int k = 0; k < W; ++k)
          for (int l = 0; l < LANES; ++l) block[((i * D + d) * LANES + l) * WP + k] = ((double*)(g->rows + d * W + k))[l];
    absorb_rows(R, block, some * D * LANES, W);
  }
  return correct_rows(R, n, columns, factor, root, shift, error);
}

/* `solved_rows`: 1 where no innovation is longer than the limit, and else 0, with nothing done. said: log determinant of what
 * whitens all, by which it grows, the normalised innovation squared, and three squares of `sum_levers`. */
int solve_rows(integer count, const double* linear, const double* weights, const integer* at, double limit, const Map* map,
               double* said, Group* g, integer n, const integer* columns, double* factor, double* root, double* shift,
               double* error) {
  said[0] += whiten(count, linear, weights, at, map, g);
  /* squared length of each whitened innovation, which stands in column Q of its lane's rows */
  for (integer i = 0; i < count; ++i) {
    double length = 0;
    for (int d = 0; d < D; ++d) {
      const double v = ((const double*)(g[i / LANES].rows + d * W + Q))[i % LANES];
      length += v * v;
    }
    if (!(length <= limit)) return 0;
  }
  said[1] = correct(count, n, g, columns, factor, root, shift, error);
  sum_levers((count + LANES - 1) / LANES, g, count, at, map, said + 2);
  return 1;
}

/* `solved`: 1 where every observation is valid and no innovation is longer than the limit, and else 0, with nothing done. The
 * parameters are those behind the point; they and the values have rows of so many numbers. room: [count][D * LINEAR + 3]; said: as
 * above. */
int solve(integer count, Sighted* sighted, const double* x, const double* parameters, integer width, const double* values,
          integer components, const integer* at, double weight, double limit, const Map* map, double* room, double* said, Group* g,
          integer n, const integer* columns, double* factor, double* root, double* shift, double* error) {
  double *linear = room, *valid = linear + count * D * LINEAR, *square = valid + count, *noise = square + count;
  const double* from[] = {x, map->points, parameters, values};
  const integer pitch[] = {0, 3, width, components}, *rows[] = {0, at, 0, 0};
  double* const to[] = {linear, valid, square, noise};
  sighted(count, from, pitch, rows, to);
  said[0] = 0;
  /* one invalid observation undoes all; `valid` then holds the weights that `solve_rows` reads */
  for (integer i = 0; i < count; ++i) {
    if (!(valid[i] > 0 && square[i] < INFINITY)) return 0;
    said[0] += log(noise[i]);
    valid[i] = weight;
  }
  return solve_rows(count, linear, valid, at, limit, map, said, g, n, columns, factor, root, shift, error);
}

/* A set of sigma points: the centre, a step along each of AXES coordinates, and a step back; weights in a mean and square
 * roots of those in a covariance, of the centre and of any other. */
enum { AXES = C + 3, POINTS = 2 * AXES + 1, ITEMS = POINTS * LANES };
typedef struct {
  double step, mean[2], root[2];
} Sigma;

/* `Spread`: what of the pose and of the modes the first C coordinates move, and a root of what the others make of the modes. */
typedef struct {
  const double *states, *pose, *modes, *late;
} Spread;

/* Whitened innovations of LANES landmarks at all sigma points (D x POINTS), 0 in `good` where one is not valid, and the log
 * determinants of the noise at the centre. */
static void sight_points(Sighted* sighted, const double* const* from, const integer* pitch, const lane* places,
                         const integer* which, lane* away, double* good, double* noise) {
  double here[ITEMS * 3], out[ITEMS * D], valid[ITEMS], determinants[ITEMS];
  integer point[ITEMS], each[ITEMS];
  /* Items point by point, landmark by landmark: place, state (point) and values (each) of every item. */
  for (int p = 0; p < POINTS; ++p)
    for (int i = 0; i < LANES; ++i) {
      PUT(places + 3 * p, 3, i, here + 3 * (p * LANES + i), double);
      point[p * LANES + i] = p;
      each[p * LANES + i] = which[i];
    }
  const double* moved[] = {from[0], here, from[1], from[2]};
  const integer *rows[] = {point, 0, each, each};
  double* const to[] = {out, valid, determinants};
  sighted(ITEMS, moved, pitch, rows, to);
  /* Innovations back into lanes [D][POINTS]; a landmark is good where all of its points are valid and finite. */
  for (int i = 0; i < LANES; ++i) {
    double square = 0;
    good[i] = 1;
    noise[i] = log(determinants[i]);
    for (int p = 0; p < POINTS; ++p) {
      if (!(valid[p * LANES + i] > 0)) good[i] = 0;
      for (int d = 0; d < D; ++d) {
        const double v = out[(p * LANES + i) * D + d];
        ((double*)(away + d * POINTS + p))[i] = v;
        square += v * v;
      }
    }
    if (!(square < INFINITY)) good[i] = 0;
  }
}

/* Regression of one component's innovations on the coordinates: its mean, slopes, and what is left over. */
static inline lane fit(const Sigma* set, const lane* away, lane* slope, lane* left) {
  const double scale = set->root[1] * set->root[1] * set->step, root = set->root[1];
  lane mean = set->mean[0] * away[0];
  /* weighted mean over the points: one weight for the centre, one for all others */
  for (int p = 1; p < POINTS; ++p) mean += set->mean[1] * away[p];
  left[0] = set->root[0] * (mean - away[0]);
  /* Axis j has the points 1 + j (plus) and 1 + AXES + j (minus): slope by their difference, remainder of both. */
  for (int j = 0; j < AXES; ++j) {
    const lane plus = mean - away[1 + j], minus = mean - away[1 + AXES + j];
    slope[j] = scale * (plus - minus);
    left[1 + j] = root * (plus - set->step * slope[j]);
    left[1 + AXES + j] = root * (minus + set->step * slope[j]);
  }
  return mean;
}

/* Slopes by coordinates become those by the pose's errors and by the landmark, which moves by `moves` (3 x AXES): 0 by what
 * no coordinate moves. */
static inline void by_errors(const double* pose, const lane* moves, lane* slope) {
  /* Back substitution by the landmark's own lower root, moves[:, C ..]: slopes by the landmark. */
  for (int c = 2; c >= 0; --c) {
    for (int e = c + 1; e < 3; ++e) slope[C + c] -= slope[C + e] * moves[e * AXES + C + c];
    const lane pivot = moves[c * AXES + C + c];
    slope[C + c] = (lane)((mask)(slope[C + c] / pivot) & (mask)(pivot != 0));
  }
  /* The landmark's share of coordinates 0 .. C is taken off, then back substitution by the pose's lower factor. */
  for (int j = C - 1; j >= 0; --j) {
    for (int c = 0; c < 3; ++c) slope[j] -= slope[C + c] * moves[c * AXES + j];
    for (int i = j + 1; i < C; ++i) slope[j] -= slope[i] * pose[i * C + j];
    slope[j] *= 1 / pose[j * (C + 1)];
  }
}

/* How LANES landmarks move with the coordinates (3 x AXES), and where they are at the sigma points. */
static inline void move_landmarks(const Spread* spread, const Map* map, const integer* at, const integer* which, double step,
                                  lane* moves, lane* places) {
  lane A[3 * M], X[3 * (M + 3)], L[9];
  /* modes and points of the landmarks into lanes, and their roots as the last three columns of X */
  for (int i = 0; i < LANES; ++i) {
    const integer k = at[which[i]];
    TAKE(map->modes + k * 3 * M, 3 * M, i, A);
    for (int a = 0; a < 3; ++a) TAKE(map->roots + k * 9 + 3 * a, 3, i, X + a * (M + 3) + M);
    TAKE(map->points + 3 * k, 3, i, places);
  }
  /* moves[:, 0 .. C] = A modes; X = [A late | own root], `late` lower triangular. */
  for (int a = 0; a < 3; ++a) {
    for (int j = 0; j < C; ++j) {
      lane sum = {0};
      for (int m = 0; m < M; ++m) sum += A[a * M + m] * spread->modes[m * C + j];
      moves[a * AXES + j] = sum;
    }
    for (int j = 0; j < M; ++j) {
      lane sum = {0};
      for (int m = j; m < M; ++m) sum += A[a * M + m] * spread->late[m * M + j];
      X[a * (M + 3) + j] = sum;
    }
  }
  lower_root(X, M + 3, L);
  /* moves[:, C ..] = root of X X'; places = point +- step moves[:, j]. */
  for (int a = 0; a < 3; ++a) {
    for (int c = 0; c < 3; ++c) moves[a * AXES + C + c] = L[3 * a + c];
    for (int j = 0; j < AXES; ++j) {
      places[3 * (1 + j) + a] = places[a] + step * moves[a * AXES + j];
      places[3 * (1 + AXES + j) + a] = places[a] - step * moves[a * AXES + j];
    }
  }
}

/* `regressed`: linear [count][D][LINEAR], valid [count] and noise [count]. States [POINTS] have rows of so many
 * numbers; parameters are those behind the point. */
void regress(integer count, Sighted* sighted, const Spread* spread, integer numbers, const double* parameters, integer width,
             const double* values, integer components, const integer* at, const Sigma* set, const Map* map, double* linear,
             double* valid, double* noise) {
  const double* from[] = {spread->states, parameters, values};
  const integer pitch[] = {numbers, 3, width, components};
  /* groups of LANES landmarks; spare lanes of the last group repeat its last landmark */
  for (integer first = 0; first < count; first += LANES) {
    lane moves[3 * AXES], places[3 * POINTS], away[D * POINTS], left[D * POINTS], rows[D * LINEAR], T[D * D], volume = {0};
    double good[LANES], logs[LANES];
    integer which[LANES];
    const int some = (int)(count - first < LANES ? count - first : LANES);
    for (int i = 0; i < LANES; ++i) which[i] = first + (i < some ? i : some - 1);
    move_landmarks(spread, map, at, which, set->step, moves, places);
    sight_points(sighted, from, pitch, places, which, away, good, logs);
    /* component d: regression on the coordinates, then slopes by the pose's errors and by the landmark */
    for (int d = 0; d < D; ++d) {
      lane* row = rows + d * LINEAR;
      row[C + 3] = fit(set, away + d * POINTS, row, left + d * POINTS);
      by_errors(spread->pose, moves, row);
    }
    volume += 1;
    for (int d = 0; d < D; ++d) { /* row d of T, T T' = I + left left' by Cholesky, and forward substitution of the rows by it */
      for (int e = 0; e <= d; ++e) {
        lane sum = (lane){0} + (d == e);
        for (int p = 0; p < POINTS; ++p) sum += left[d * POINTS + p] * left[e * POINTS + p];
        for (int c = 0; c < e; ++c) sum -= T[d * D + c] * T[e * D + c];
        if (e < d) T[d * D + e] = sum / T[e * (D + 1)];
        else T[d * D + e] = square_roots(sum);
      }
      volume *= T[d * (D + 1)];
      const lane out = 1 / T[d * (D + 1)];
      for (int k = 0; k < LINEAR; ++k) {
        for (int e = 0; e < d; ++e) rows[d * LINEAR + k] -= T[d * D + e] * rows[e * LINEAR + k];
        rows[d * LINEAR + k] *= out;
      }
    }
    /* lanes apart again: a landmark's rows, whether they are usable, and the log determinant of its noise */
    for (int i = 0; i < some; ++i) {
      double *row = linear + (first + i) * D * LINEAR, square = 0;
      PUT(rows, D * LINEAR, i, row, double);
      for (int k = 0; k < D * LINEAR; ++k) square += row[k] * row[k];
      valid[first + i] = square < INFINITY ? good[i] : 0;
      noise[first + i] = logs[i] + log(((const double*)&volume)[i]);
    }
  }
}

/* Givens rotation of rows a and b of V. */
static inline void turn(double* restrict a, double* restrict b, double c, double s) {
  /* (a, b) <- (c a - s b, s a + c b) */
  for (int k = 0; k < Q; ++k) {
    const double x = a[k], y = b[k];
    a[k] = c * x - s * y;
    b[k] = s * x + c * y;
  }
}

/* Eigenvalues d of a symmetric A (order Q, overwritten), eigenvectors in the rows of V: Householder's reflections to a
 * tridiagonal matrix, then QL with implicit shifts (Wilkinson and Reinsch, 1971). */
static void eigenvectors(double* A, double* d, double* V) {
  double e[Q] = {0};
  memset(V, 0, Q * Q * sizeof(double));
  /* V = I at first */
  for (int j = 0; j < Q; ++j) V[j * (Q + 1)] = 1;
  /* Reflection j makes row and column j tridiagonal: A <- A - v w' - w v', V <- (I - scale v v') V. */
  for (int j = 0; j + 2 < Q; ++j) {
    double v[Q] = {0}, w[Q] = {0}, z[Q] = {0}, square = 0, along = 0;
    for (int k = j + 1; k < Q; ++k) v[k] = A[j * Q + k];
    for (int k = j + 2; k < Q; ++k) square += v[k] * v[k];
    if (square < TINY) continue;
    const double length = sqrt(square + v[j + 1] * v[j + 1]);
    v[j + 1] += v[j + 1] > 0 ? length : -length;
    const double scale = 2 / (square + v[j + 1] * v[j + 1]);
    for (int a = j; a < Q; ++a)
      for (int k = 0; k < Q; ++k) {
        w[k] += scale * v[a] * A[a * Q + k];
        z[k] += scale * v[a] * V[a * Q + k];
      }
    for (int k = 0; k < Q; ++k) along += 0.5 * scale * v[k] * w[k];
    for (int k = 0; k < Q; ++k) w[k] -= along * v[k];
    for (int a = j; a < Q; ++a)
      for (int k = 0; k < Q; ++k) {
        A[a * Q + k] -= v[a] * w[k] + w[a] * v[k];
        V[a * Q + k] -= v[a] * z[k];
      }
  }
  /* diagonal d and subdiagonal e of the tridiagonal matrix */
  for (int j = 0; j < Q; ++j) d[j] = A[j * (Q + 1)];
  for (int j = 0; j + 1 < Q; ++j) e[j] = A[j * (Q + 1) + 1];
  /* QL sweeps with implicit shift until e[l] is negligible; rotations go into the rows of V. */
  for (int l = 0; l < Q; ++l)
    for (int sweep = 0; sweep < 60; ++sweep) {
      int m = l;
      /* e[m] is the first negligible element from l on: rows l .. m are still coupled */
      while (m + 1 < Q && !(fabs(e[m]) <= 1e-16 * (fabs(d[m]) + fabs(d[m + 1])))) ++m;
      if (m == l) break;
      double g = (d[l + 1] - d[l]) / (2 * e[l]), r = sqrt(g * g + 1), s = 1, c = 1, p = 0;
      g = d[m] - d[l] + e[l] / (g > 0 ? g + r : g - r);
      int i = m - 1;
      /* one sweep from m back to l by Givens rotations; it ends early where an element becomes zero */
      for (; i >= l; --i) {
        const double f = s * e[i], b = c * e[i];
        e[i + 1] = r = sqrt(f * f + g * g);
        if (r == 0) break;
        s = f / r;
        c = g / r;
        g = d[i + 1] - p;
        r = (d[i] - g) * s + 2 * c * b;
        p = s * r;
        d[i + 1] = g + p;
        g = c * r - b;
        turn(V + i * Q, V + (i + 1) * Q, c, s);
      }
      if (i >= l) d[i + 1] -= p;
      else {
        d[l] -= p;
        e[l] = g;
      }
      e[m] = 0;
    }
}

/* Rows of `from` (Q x n) by reflections from the right: lower triangular R (Q x Q), and the reflections. */
static void lower_by_reflections(const double* from, int n, double* R, double* reflect) {
  memcpy(reflect, from, Q * n * sizeof(double));
  memset(R, 0, Q * Q * sizeof(double));
  /* Reflection j from the right zeroes row j behind column j; rows below follow, the reflection stays in `reflect`. */
  for (int j = 0; j < Q; ++j) {
    double *u = reflect + j * n, square = 0;
    for (int k = 0; k < j; ++k) {
      R[j * Q + k] = u[k];
      u[k] = 0;
    }
    for (int k = j; k < n; ++k) square += u[k] * u[k];
    double length = u[j] > 0 ? -sqrt(square) : sqrt(square);
    R[j * Q + j] = length;
    u[j] -= length;
    square = 2 * (square - length * (length + u[j]));
    if (square < TINY) {
      memset(u, 0, n * sizeof(double));
      continue;
    }
    double scale = sqrt(2 / square);
    for (int k = j; k < n; ++k) u[k] *= scale;
    for (int i = j + 1; i < Q; ++i) {
      double *row = reflect + i * n, sum = 0;
      for (int k = j; k < n; ++k) sum += row[k] * u[k];
      for (int k = j; k < n; ++k) row[k] -= sum * u[k];
    }
  }
}

/* What observations make of their landmarks, in place of the rows; and how much of it pose and modes explain, added to G. */
static void pull(Group* g, integer groups, double* G) {
  lane square[Q * Q] = {{0}};
  /* a group at a time: its rows become what its observations make of their landmarks; its share of G stays in lanes */
  for (integer i = 0; i < groups; ++i, ++g) {
    lane seen[D * Q];
    /* Column k: rows <- X' row (3); seen = the part explained by pose and modes, row - X X' row (of the pose - X X' row). */
    for (int k = 0; k < W; ++k) {
      lane row[D], sum[3];
      for (int d = 0; d < D; ++d) row[d] = g->rows[d * W + k];
      for (int a = 0; a < 3; ++a) {
        sum[a] = g->spread[a] * row[0];
        for (int d = 1; d < D; ++d) sum[a] += g->spread[3 * d + a] * row[d];
      }
      for (int a = 0; a < 3; ++a) g->rows[a * W + k] = sum[a];
      for (int d = 0; d < D && k < Q; ++d) {
        if (k < C) row[d] = (lane){0};
        for (int a = 0; a < 3; ++a) row[d] -= g->spread[3 * d + a] * sum[a];
        seen[d * Q + k] = row[d];
      }
    }
    /* G += seen' seen, upper triangle per lane; below, the sum over lanes, mirrored. */
    for (int a = 0; a < Q; ++a)
      for (int b = a; b < Q; ++b)
        for (int d = 0; d < D; ++d) square[a * Q + b] += seen[d * Q + a] * seen[d * Q + b];
  }
  /* sum of the lanes into G, mirrored */
  for (int a = 0; a < Q; ++a)
    for (int b = a; b < Q; ++b) {
      double sum = 0;
      for (int i = 0; i < LANES; ++i) sum += ((double*)(square + a * Q + b))[i];
      G[a * Q + b] += sum;
      if (b > a) G[b * Q + a] += sum;
    }
}

/* `compress`: turned [Q][Q] of kept and dropped side by side, mode_rows [M][n], explained [M] (in: what is remembered). G:
 * what pose and modes of all observed landmarks explain. */
static void compress(double* G, integer n, const double* both, double* explained, double* turned, double* mode_rows) {
  double R[Q * Q], A[Q * Q] = {0}, d[Q], V[Q * Q], T[Q * Q] = {0}, reflect[Q * N];
  /* on the diagonal of the modes: what earlier observations explained by each */
  for (int m = 0; m < M; ++m) G[(C + m) * (Q + 1)] += explained[m];
  lower_by_reflections(both, (int)n, R, reflect);
  /* A = R' G R with R lower triangular: T = G R, then R' T. */
  for (int a = 0; a < Q; ++a)
    for (int b = 0; b < Q; ++b)
      for (int k = 0; k <= b; ++k) T[a * Q + k] += G[a * Q + b] * R[b * Q + k];
  for (int b = 0; b < Q; ++b)
    for (int a = 0; a <= b; ++a)
      for (int k = 0; k < Q; ++k) A[a * Q + k] += R[b * Q + a] * T[b * Q + k];
  eigenvectors(A, d, V);
  int order[Q];
  /* Eigenvalues by insertion in descending order: the first M are the modes kept. */
  for (int j = 0; j < Q; ++j) {
    int at = j;
    for (; at > 0 && d[order[at - 1]] < d[j]; --at) order[at] = order[at - 1];
    order[at] = j;
  }
  double side[N * M] = {0}; /* the modes' rows side by side */
  /* turned = R V, kept columns first; `side` starts as the kept eigenvectors [Q][M]. */
  for (int j = 0; j < Q; ++j) {
    const double* v = V + order[j] * Q;
    for (int a = 0; a < Q; ++a) {
      double sum = 0;
      for (int b = 0; b <= a; ++b) sum += R[a * Q + b] * v[b];
      turned[a * Q + j] = sum;
      if (j < M) side[a * M + j] = v[a];
    }
    if (j < M) explained[j] = d[order[j]];
  }
  /* Reflections in reverse order take the eigenvectors to the n columns of the factor. */
  for (int k = Q - 1; k >= 0; --k) {
    const double* u = reflect + k * n;
    double sum[M] = {0};
    for (int l = k; l < n; ++l)
      for (int m = 0; m < M; ++m) sum[m] += u[l] * side[l * M + m];
    for (int l = k; l < n; ++l)
      for (int m = 0; m < M; ++m) side[l * M + m] -= u[l] * sum[m];
  }
  /* transposed: modes as rows [M][n] */
  for (int m = 0; m < M; ++m)
    for (int l = 0; l < n; ++l) mode_rows[m * n + l] = side[l * M + m];
}

/* Dependence on the new modes and own roots of landmarks that depended on (pose, modes) by `both` (3 x width) and on themselves by
 * `own`; `turned` has rows of PITCH numbers. */
enum { PITCH = (Q + STEP - 1) / STEP * STEP };
static inline __attribute__((always_inline)) void settle(const lane* both, const int width, const lane* own, const double* turned,
                                                         lane* modes, lane* root) {
  lane by[3 * PITCH], X[3 * (C + 3)];
  /* by = both turned, STEP columns in registers at a time. */
  for (int m = 0; m < PITCH; m += STEP) {
    lane sum[3 * STEP] = {{0}};
    for (int k = 0; k < width; ++k)
      for (int a = 0; a < 3; ++a)
        for (int s = 0; s < STEP; ++s) sum[a * STEP + s] += both[a * width + k] * turned[k * PITCH + m + s];
    for (int a = 0; a < 3; ++a)
      for (int s = 0; s < STEP; ++s) by[a * PITCH + m + s] = sum[a * STEP + s];
  }
  /* Columns 0 .. M are the modes; the dropped C columns join the landmark's own error, X = [dropped | own]. */
  for (int a = 0; a < 3; ++a) {
    for (int m = 0; m < M; ++m) modes[a * M + m] = by[a * PITCH + m];
    for (int c = 0; c < C; ++c) X[a * (C + 3) + c] = by[a * PITCH + M + c];
    for (int b = 0; b < 3; ++b) X[a * (C + 3) + C + b] = own[3 * a + b];
  }
  lower_root(X, C + 3, root);
}

/* Observed landmarks, in place; `pull` has gone over the groups. error [Q] of pose and modes. */
static void observe(integer count, const Group* g, const integer* at, const double* error, const double* turned, integer now,
                    const Map* map) {
  /* LANES landmarks at a time: modes and roots into lanes */
  for (integer first = 0; first < count; first += LANES, ++g) {
    const int some = (int)(count - first < LANES ? count - first : LANES);
    lane A[3 * M], L[9], X[3 * (D + 3)], U[9], both[3 * Q], own[9], step[3], modes[3 * M], root[9];
    for (int i = 0; i < LANES; ++i) {
      const integer l = at[first + (i < some ? i : some - 1)];
      TAKE(map->modes + l * 3 * M, 3 * M, i, A);
      TAKE(map->roots + l * 9, 9, i, L);
    }
    /* X = [I | gram'], whose lower root U has U U' = I + gram' gram */
    for (int a = 0; a < 3; ++a) {
      for (int d = 0; d < D; ++d) X[a * (D + 3) + 3 + d] = g->gram[3 * d + a];
      for (int b = 0; b < 3; ++b) X[a * (D + 3) + b] = (lane){0} + (a == b);
    }
    lower_root(X, D + 3, U);
    /* both = [0 | A] - L (X' rows), step = L X' rho + both error, own = L U'^-1 with U U' = I + gram' gram. */
    for (int a = 0; a < 3; ++a) {
      const lane* l = L + 3 * a;
      step[a] = l[0] * g->rows[Q] + l[1] * g->rows[W + Q] + l[2] * g->rows[2 * W + Q];
      for (int k = 0; k < Q; ++k) {
        const lane sum = l[0] * g->rows[k] + l[1] * g->rows[W + k] + l[2] * g->rows[2 * W + k];
        both[a * Q + k] = (k < C ? (lane){0} : A[a * M + k - C]) - sum;
        step[a] += both[a * Q + k] * error[k];
      }
      own[3 * a] = l[0] / U[0];
      own[3 * a + 1] = (l[1] - own[3 * a] * U[3]) / U[4];
      own[3 * a + 2] = (l[2] - own[3 * a] * U[6] - own[3 * a + 1] * U[7]) / U[8];
    }
    settle(both, Q, own, turned, modes, root);
    /* lanes apart again: the corrected point, modes and root of each landmark, and its counts */
    for (int i = 0; i < some; ++i) {
      const integer l = at[first + i];
      for (int a = 0; a < 3; ++a) map->points[3 * l + a] += ((double*)(step + a))[i];
      PUT(modes, 3 * M, i, map->modes + l * 3 * M, stored);
      PUT(root, 9, i, map->roots + l * 9, stored);
      map->epoch[l] = now;
      map->last[l] = now - 1;
      map->hits[l] += 1;
      map->wrong[l] = 0;
    }
  }
}

/* New landmarks, which depend on the pose by [count][3][C] and have their own roots. */
static void settle_new(integer count, const double* by_pose, const double* own, const double* turned, stored* modes,
                       stored* roots) {
  /* LANES new landmarks at a time: dependence on the pose and own root into lanes, out as modes and root */
  for (integer first = 0; first < count; first += LANES) {
    const int some = (int)(count - first < LANES ? count - first : LANES);
    lane both[3 * C], L[9], A[3 * M], root[9];
    for (int i = 0; i < LANES; ++i) {
      const integer k = first + (i < some ? i : some - 1);
      TAKE(by_pose + k * 3 * C, 3 * C, i, both);
      TAKE(own + k * 9, 9, i, L);
    }
    settle(both, C, L, turned, A, root);
    for (int i = 0; i < some; ++i) {
      PUT(A, 3 * M, i, modes + (first + i) * 3 * M, stored);
      PUT(root, 9, i, roots + (first + i) * 9, stored);
    }
  }
}

/* `LandmarkSteps.close`: everything after the correction of an epoch, in the order of its NumPy reference. error [n] and factor
 * [n][n] of all errors, of which pose and modes are the columns [Q] and the state the first `states`, with its reset Jacobian;
 * after [n][n] gets the factor about the new mean. fresh: new landmarks, by_pose [fresh][3][C] and own [fresh][3][3]; begin and end
 * of the rows whose turn it is. */
void close_epoch(integer count, Group* groups, const integer* at, const double* error, integer fresh, const double* by_pose,
                 const double* own, double share, integer n, integer states, const integer* columns, const double* reset,
                 const double* factor, double* after, double* explained, double* turned, stored* new_modes, stored* new_roots,
                 integer total, integer begin, integer end, integer slots, integer now, const Map* map) {
  double G[Q * Q] = {0}, wide[Q * PITCH] = {0}, both[Q * N], moved[Q];
  /* factor and error of pose and modes */
  for (int k = 0; k < Q; ++k) {
    memcpy(both + k * n, factor + columns[k] * n, n * sizeof(double));
    moved[k] = error[columns[k]];
  }
  /* rows of the state by its reset Jacobian, most entries of which are zero; those of modes come below, the move's stay */
  memset(after, 0, states * n * sizeof(double));
  memcpy(after + states * n, factor + states * n, (n - states) * n * sizeof(double));
  for (integer i = 0; i < states; ++i)
    for (integer r = 0; r < states; ++r) {
      const double j = reset[i * states + r];
      if (j != 0)
        for (integer k = 0; k < n; ++k) after[i * n + k] += j * factor[r * n + k];
    }
  pull(groups, (count + LANES - 1) / LANES, G);
  /* New landmarks in G, poses only: share (L^-1 by_pose)' (L^-1 by_pose). */
  for (integer i = 0; i < fresh; ++i) {
    double scaled[3 * C];
    for (int k = 0; k < C; ++k) {
      const double *L = own + 9 * i, *x = by_pose + i * 3 * C + k, a = x[0] / L[0], b = (x[C] - L[3] * a) / L[4];
      scaled[k] = a;
      scaled[C + k] = b;
      scaled[2 * C + k] = (x[2 * C] - L[6] * a - L[7] * b) / L[8];
    }
    for (int a = 0; a < C; ++a)
      for (int b = 0; b < C; ++b)
        for (int d = 0; d < 3; ++d) G[a * Q + b] += share * scaled[d * C + a] * scaled[d * C + b];
  }
  compress(G, n, both, explained, turned, after + states * n);
  refresh(total, 0, begin, end, now, slots, map);
  compose(slots, turned, moved + C, map);
  const integer slot = ++now % slots;
  memset(map->transform + slot * M * M, 0, M * M * sizeof(double));
  memset(map->spread + slot * M * M, 0, M * M * sizeof(double));
  memset(map->shift + slot * M, 0, M * sizeof(double));
  /* the slot of this epoch begins without a change: transform = I, spread = 0, shift = 0 */
  for (int a = 0; a < M; ++a) map->transform[slot * M * M + a * M + a] = 1;
  /* rows of PITCH numbers, as `settle` reads them */
  for (int k = 0; k < Q; ++k) memcpy(wide + k * PITCH, turned + k * Q, Q * sizeof(double));
  observe(count, groups, at, moved, wide, now, map);
  settle_new(fresh, by_pose, own, wide, new_modes, new_roots);
}
