/* Closest intersections of rays with triangles in float64: a bounding-volume hierarchy walked by packets of neighbouring rays.

   See `ray_tracing.brute_force_hits` for what is computed. A packet visits a node when one of its rays meets the node's box.
   A tree's arrays: nodes[2 n - 1], triangles[n][12] = (corner, edge 1, edge 2, smallest determinant, ...) in the order of
   leaves. */

#include <math.h>
#include <string.h>

typedef long long integer;
typedef struct { double sides[6]; integer first, count; } Node; /* low and high; count 0: children first and first + 1 */
enum { LANES = 16, BINS = 16, LEAF = 4, BALANCED_DEPTH = 48, STACK = 160 };
enum { WIDE = 4, TALL = LANES / WIDE, NEAR_STEPS = 4 };
static const double FAR = 1e300, PADDING = 1e-8;

typedef struct { double low[3], high[3]; } Box;

/* Smallest box around both boxes, axis by axis. */
static void grow(Box* box, const Box* other) {
  for (int a = 0; a < 3; ++a) {
    if (other->low[a] < box->low[a]) box->low[a] = other->low[a];
    if (other->high[a] > box->high[a]) box->high[a] = other->high[a];
  }
}

/* The empty box: low above high, so that `grow` by any box gives that box. */
static Box nothing(void) {
  Box box = {{FAR, FAR, FAR}, {-FAR, -FAR, -FAR}};
  return box;
}

/* Half of a box's surface area, 0 of the empty one. */
static double half_area(const Box* box) {
  double x = box->high[0] - box->low[0], y = box->high[1] - box->low[1], z = box->high[2] - box->low[2];
  return x < 0 ? 0 : x * y + y * z + z * x;
}

/* Twice the centre of a box along an axis. */
static double centre(const Box* box, int axis) { return box->low[axis] + box->high[axis]; }

static integer bin_of(const Box* box, int axis, double low, double scale) {
  integer bin = (integer)((centre(box, axis) - low) * scale);
  return bin < 0 ? 0 : bin >= BINS ? BINS - 1 : bin;
}

/* The split of least surface-area cost: its axis and the first bin of the right side; -1 where a leaf is not worse. */
static int best_split(const Box* boxes, const integer* order, integer n, const Box* centres, integer* first_right) {
  int best_axis = -1;
  double best = FAR;
  /* axis by axis; one along which all centres coincide cannot split */
  for (int axis = 0; axis < 3; ++axis) {
    double low = centres->low[axis], width = centres->high[axis] - low;
    if (!(width > 0)) continue;
    /* Boxes and counts of the triangles whose centres lie in each of BINS equal slabs along the axis. */
    Box bins[BINS];
    integer counts[BINS];
    for (int b = 0; b < BINS; ++b) { bins[b] = nothing(); counts[b] = 0; }
    for (integer k = 0; k < n; ++k) {
      integer b = bin_of(&boxes[order[k]], axis, low, BINS / width);
      grow(&bins[b], &boxes[order[k]]);
      ++counts[b];
    }
    /* Cost of the right side [b, BINS) of every split: its count times its half area; -1 where it is empty. */
    double right_cost[BINS];
    Box side = nothing();
    integer count = 0;
    for (int b = BINS - 1; b > 0; --b) {
      grow(&side, &bins[b]);
      count += counts[b];
      right_cost[b] = count ? count * half_area(&side) : -1;
    }
    side = nothing();
    count = 0;
    /* Left side [0, b) grown bin by bin: the split of least count times half area, summed over both sides. */
    for (int b = 1; b < BINS; ++b) {
      grow(&side, &bins[b - 1]);
      count += counts[b - 1];
      double cost = count * half_area(&side) + right_cost[b];
      if (count && right_cost[b] >= 0 && cost < best) { best = cost; best_axis = axis; *first_right = b; }
    }
  }
  return best_axis;
}

/* Split node `at` into a pair of children until leaves hold at most LEAF triangles; order[first, first + count) is permuted. */
static void split(const Box* boxes, integer* order, Node* nodes, integer at, integer* used, int depth) {
  integer first = nodes[at].first, n = nodes[at].count, middle = n / 2, first_right = 0;
  if (n <= LEAF) return;
  /* Bounds of the triangles' (doubled) centres: the range that the bins divide. */
  Box centres = nothing();
  for (integer k = 0; k < n; ++k)
    for (int a = 0; a < 3; ++a) {
      double c = centre(&boxes[order[first + k]], a);
      if (c < centres.low[a]) centres.low[a] = c;
      if (c > centres.high[a]) centres.high[a] = c;
    }
  int axis = depth < BALANCED_DEPTH ? best_split(boxes, order + first, n, &centres, &first_right) : -1;
  if (axis >= 0) {
    double low = centres.low[axis], scale = BINS / (centres.high[axis] - low);
    /* Partition in place: triangles of bins below first_right go to the front. */
    integer left = first, right = first + n - 1;
    while (left <= right) {
      integer triangle = order[left];
      if (bin_of(&boxes[triangle], axis, low, scale) < first_right) { ++left; continue; }
      order[left] = order[right];
      order[right--] = triangle;
    }
    middle = left - first;
  }
  integer child = *used, sizes[2] = {middle, n - middle}, starts[2] = {first, first + middle};
  *used += 2;
  /* Children as neighbours, child and child + 1, each with the box of its triangles; the parent then points to them. */
  for (int side = 0; side < 2; ++side) {
    Node* node = &nodes[child + side];
    Box box = nothing();
    for (integer k = 0; k < sizes[side]; ++k) grow(&box, &boxes[order[starts[side] + k]]);
    memcpy(node->sides, &box, sizeof box);
    node->first = starts[side];
    node->count = sizes[side];
  }
  nodes[at].first = child;
  nodes[at].count = 0;
  for (int side = 0; side < 2; ++side) split(boxes, order, nodes, child + side, used, depth + 1); /* each child in turn */
}

/* Nodes, the order of triangles in leaves, and their packed corners; scratch: n boxes. */
void build_tree(integer n, const double* corners, double smallest, Node* nodes, integer* order, double* packed, Box* scratch) {
  Box all = nothing();
  /* Box of every triangle (corners[n][3][3]), padded by its size so that rounding cannot lose a hit on its rim. */
  for (integer k = 0; k < n; ++k) {
    Box box = nothing();
    double size = 0;
    for (int c = 0; c < 3; ++c) {
      Box point;
      memcpy(point.low, corners + 9 * k + 3 * c, sizeof point.low);
      memcpy(point.high, point.low, sizeof point.low);
      grow(&box, &point);
    }
    for (int a = 0; a < 3; ++a) size = fmax(size, box.high[a] - box.low[a]);
    for (int a = 0; a < 3; ++a) {
      box.low[a] -= PADDING * size;
      box.high[a] += PADDING * size;
    }
    scratch[k] = box;
    order[k] = k;
    grow(&all, &box);
  }
  memcpy(nodes[0].sides, &all, sizeof all);
  nodes[0].first = 0;
  nodes[0].count = n;
  integer used = 1;
  split(scratch, order, nodes, 0, &used, 0);
  /* packed[n][12] in the order of leaves: corner, edges 1 and 2, smallest determinant = smallest |edge 1 x edge 2|, two unused. */
  for (integer k = 0; k < n; ++k) {
    const double* v = corners + 9 * order[k];
    double* out = packed + 12 * k;
    for (int a = 0; a < 3; ++a) {
      out[a] = v[a];
      out[3 + a] = v[3 + a] - v[a];
      out[6 + a] = v[6 + a] - v[a];
    }
    double x = out[4] * out[8] - out[5] * out[7], y = out[5] * out[6] - out[3] * out[8], z = out[3] * out[7] - out[4] * out[6];
    out[9] = smallest * sqrt(x * x + y * y + z * z);
  }
}

typedef struct { double o[3][LANES], d[3][LANES], inverse[3][LANES], t[LANES]; integer hit[LANES], entry[3]; } Packet;

/* The number of a box, low [3] and high [3], by which all rays enter it along each axis; entry[0] is -1 where rays differ. */
static void find_entries(Packet* p) {
  integer differ = 0;
  for (int a = 0; a < 3; ++a) {
    integer negative = 0;
    for (int k = 0; k < LANES; ++k) negative += p->inverse[a][k] < 0;
    p->entry[a] = negative ? 3 + a : a;
    differ |= negative && negative < LANES;
  }
  if (differ) p->entry[0] = -1;
}

/* `meets` of rays that all enter by the same sides, whose order then needs no comparison. */
static integer meets_by_entries(const Packet* p, const double* sides) {
  double enter[3], leave[3];
  integer any = 0;
  /* the other side of axis a is 3 + a or a */
  for (int a = 0; a < 3; ++a) {
    enter[a] = sides[p->entry[a]];
    leave[a] = sides[2 * a + 3 - p->entry[a]];
  }
  for (int k = 0; k < LANES; ++k) {
    double near = 0, far = p->t[k];
    for (int a = 0; a < 3; ++a) {
      const double first = (enter[a] - p->o[a][k]) * p->inverse[a][k], last = (leave[a] - p->o[a][k]) * p->inverse[a][k];
      near = first > near ? first : near;
      far = last < far ? last : far;
    }
    any += near <= far * (1 + 1e-12);
  }
  return any;
}

/* How many lanes meet a box before their nearest hit: slab test, entry and exit along each axis (1 / d is stored). */
static integer meets(const Packet* p, const Node* node) {
  const double *low = node->sides, *high = low + 3;
  integer any = 0;
  if (p->entry[0] >= 0) return meets_by_entries(p, low);
  /* lane k: latest entry and earliest exit over the axes, with a margin for rounding */
  for (int k = 0; k < LANES; ++k) {
    double near = 0, far = p->t[k];
    for (int a = 0; a < 3; ++a) {
      double one = (low[a] - p->o[a][k]) * p->inverse[a][k], two = (high[a] - p->o[a][k]) * p->inverse[a][k];
      double first = one < two ? one : two, last = one < two ? two : one;
      near = first > near ? first : near;
      far = last < far ? last : far;
    }
    any += near <= far * (1 + 1e-12);
  }
  return any;
}

/* Moeller-Trumbore for all lanes; the determinant is that of (edge 1, edge 2, -direction), positive from outside. */
static void intersect(Packet* p, const double* v, integer triangle, double tolerance, double both_sides) {
  for (int k = 0; k < LANES; ++k) {
    double dx = p->d[0][k], dy = p->d[1][k], dz = p->d[2][k];
    double px = dy * v[8] - dz * v[7], py = dz * v[6] - dx * v[8], pz = dx * v[7] - dy * v[6];
    double det = v[3] * px + v[4] * py + v[5] * pz;
    double sign = det < 0 ? (both_sides > 0 ? -1.0 : 0.0) : 1.0; /* 0: seen from behind, the determinant becomes 0 */
    double sx = p->o[0][k] - v[0], sy = p->o[1][k] - v[1], sz = p->o[2][k] - v[2];
    double qx = sy * v[5] - sz * v[4], qy = sz * v[3] - sx * v[5], qz = sx * v[4] - sy * v[3];
    double u = sign * (sx * px + sy * py + sz * pz), w = sign * (dx * qx + dy * qy + dz * qz);
    double along = sign * (v[6] * qx + v[7] * qy + v[8] * qz), slack = tolerance * sign * det;
    det *= sign;
    integer ok = (det > v[9]) & (u >= -slack) & (w >= -slack) & (u + w <= det + slack) & (along > 0) & (along < p->t[k] * det);
    double distance = along / (ok ? det : 1.0);
    p->t[k] = ok ? distance : p->t[k];
    p->hit[k] = ok ? triangle : p->hit[k];
  }
}

/* Nearest hits of a packet, depth first; the child nearer along lane 0 comes first, so that hits in it exclude the other. */
static void walk(Packet* p, const Node* nodes, const double* packed, double tolerance, double both_sides) {
  integer stack[STACK], depth = 0;
  if (meets(p, nodes)) stack[depth++] = 0;
  /* depth first: a leaf's triangles are intersected; of an inner node both children are pushed, the nearer on top */
  while (depth) {
    const Node* node = &nodes[stack[--depth]];
    if (!meets(p, node)) continue; /* again: hits found since it was pushed may be nearer */
    if (node->count) {
      for (integer k = 0; k < node->count; ++k)
        intersect(p, packed + 12 * (node->first + k), node->first + k, tolerance, both_sides);
      continue;
    }
    const Node* pair = &nodes[node->first];
    /* Direction of lane 0 times the vector from the first child's centre to the second's (doubled): its sign orders the pair. */
    double ahead = 0;
    for (int a = 0; a < 3; ++a)
      ahead += p->d[a][0] * (pair[1].sides[a] + pair[1].sides[3 + a] - pair[0].sides[a] - pair[0].sides[3 + a]);
    integer near = ahead > 0 ? 0 : 1;
    stack[depth++] = node->first + 1 - near;
    stack[depth++] = node->first + near;
  }
}

static double square_between(const double* a, const double* b) {
  const double x = a[0] - b[0], y = a[1] - b[1], z = a[2] - b[2];
  return x * x + y * y + z * z;
}

/* Rays in a row of a scan: those before the first step of the direction that is NEAR_STEPS times as long as the first one; 0
 * where the next row does not begin close to this one, or no row of as many follows it. */
integer row_length(integer n, const double* directions) {
  const double limit = n > 1 ? NEAR_STEPS * NEAR_STEPS * square_between(directions, directions + 3) : 0;
  integer count = 1;
  while (count < n && square_between(directions + 3 * count, directions + 3 * (count - 1)) <= limit) ++count;
  if (count < WIDE || 2 * count >= n) return 0;
  const double *next = directions + 3 * count, *third = next + 3 * count;
  if (square_between(next, directions) > limit) return 0;
  return square_between(third, third - 3) > limit && square_between(third, next) <= limit ? count : 0;
}

/* Nearest hits of the rays of one packet, stored at their places in n rays. */
static void trace_packet(const integer* rays, const double* origins, const double* directions, const Node* nodes,
                         const integer* order, const double* packed, double tolerance, double both_sides, double* distances,
                         integer* hits) {
  Packet p;
  /* Load LANES rays, component by component. Zero directions get a finite inverse. */
  for (int k = 0; k < LANES; ++k) {
    for (int a = 0; a < 3; ++a) {
      double d = directions[3 * rays[k] + a];
      p.o[a][k] = origins[3 * rays[k] + a];
      p.d[a][k] = d;
      p.inverse[a][k] = 1 / (fabs(d) < 1e-150 ? copysign(1e-150, d) : d);
    }
    p.t[k] = FAR;
    p.hit[k] = -1;
  }
  find_entries(&p);
  walk(&p, nodes, packed, tolerance, both_sides);
  /* Store: hits are places in the order of leaves, `order` maps them to triangles; a ray that is repeated is stored again. */
  for (int k = 0; k < LANES; ++k) {
    distances[rays[k]] = p.t[k];
    hits[rays[k]] = p.hit[k] < 0 ? -1 : order[p.hit[k]];
  }
}

/* Distances (FAR for a miss) and triangles (-1) of n rays with unit directions, in rows of `across` rays; 0: in no rows. */
void trace(integer n, integer across, const double* origins, const double* directions, const Node* nodes, const integer* order,
           const double* packed, double tolerance, double both_sides, double* distances, integer* hits) {
  const integer bands = across ? n / (across * TALL) : 0;
  integer rays[LANES];
  /* TALL rows at a time, in tiles of WIDE columns: their rays lie closer together than as many of one row, and meet fewer boxes.
   * The last tile of a band repeats its last column. */
  for (integer band = 0; band < bands; ++band)
    for (integer left = 0; left < across; left += WIDE) {
      for (int k = 0; k < LANES; ++k) {
        const integer column = left + k % WIDE;
        rays[k] = (band * TALL + k / WIDE) * across + (column < across ? column : across - 1);
      }
      trace_packet(rays, origins, directions, nodes, order, packed, tolerance, both_sides, distances, hits);
    }
  /* The rays that are left in their order; the last packet repeats the last ray. */
  for (integer start = bands * TALL * across; start < n; start += LANES) {
    for (int k = 0; k < LANES; ++k) rays[k] = start + k < n ? start + k : n - 1;
    trace_packet(rays, origins, directions, nodes, order, packed, tolerance, both_sides, distances, hits);
  }
}
