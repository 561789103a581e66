/* Closest intersections of rays with triangles in float64: a bounding-volume hierarchy walked by packets of neighbouring rays.

   See `ray_tracing.brute_force_hits` for what is computed. A binary tree is built, and its nodes are then gathered into wide ones,
   whose boxes are compared with a packet side by side. A packet visits a node whose box one of its rays may meet.
   A tree's arrays: nodes[2 n - 1] while it is built, branches, and triangles[n][12] = (corner, edge 1, edge 2, smallest
   determinant, ...) in the order of leaves. */

#include <math.h>
#include <string.h>

typedef long long integer;
typedef struct { double sides[6]; integer first, count; } Node; /* low and high; count 0: children first and first + 1 */
enum { LANES = 16, BINS = 16, LEAF = 3, BRANCHES = 16, BALANCED_DEPTH = 48, STACK = 80 * BRANCHES };
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

/* Up to BRANCHES children with their boxes side by side; a child of count 0 is the inner node `first`, else a leaf's triangles. */
typedef struct { double sides[6][BRANCHES]; int first[BRANCHES], count[BRANCHES]; integer children; } Branch;

/* Children of a wide node: those of a binary one, of which the one of the largest area is replaced by its own until there are
 * enough. Stores them where `branches` is given, and returns how many wide nodes there are then. */
static integer widen(const Node* nodes, integer at, Branch* branches, integer used) {
  integer held[BRANCHES], count = 1, own = used++;
  held[0] = at;
  while (count < BRANCHES) {
    integer widest = -1;
    double largest = -1;
    for (integer j = 0; j < count; ++j) {
      const Node* node = &nodes[held[j]];
      if (node->count) continue;
      Box box;
      memcpy(&box, node->sides, sizeof box);
      if (half_area(&box) > largest) { largest = half_area(&box); widest = j; }
    }
    if (widest < 0) break;
    held[count++] = nodes[held[widest]].first + 1;
    held[widest] = nodes[held[widest]].first;
  }
  if (branches) branches[own].children = count;
  for (integer j = 0; j < BRANCHES; ++j) {
    const Node* node = &nodes[held[j < count ? j : 0]];
    if (branches) {
      for (int side = 0; side < 6; ++side) branches[own].sides[side][j] = j < count ? node->sides[side] : side < 3 ? FAR : -FAR;
      branches[own].count[j] = (int)node->count;
      branches[own].first[j] = (int)(node->count ? node->first : used);
    }
    if (j < count && !node->count) used = widen(nodes, held[j], branches, used);
  }
  return used;
}

/* How many wide nodes the binary tree gives; they are stored where there is room for them. */
integer gather_branches(const Node* nodes, Branch* branches) { return widen(nodes, 0, branches, 0); }

typedef struct {
  double o[3][LANES], d[3][LANES], inverse[3][LANES], t[LANES], farthest;
  integer hit[LANES];
  /* axes along which all rays have the same sense: their number, which they are, the sides of a box by which the rays enter it
   * and leave it there, the origins that come first to these sides, and the bounds of the inverse directions */
  integer alike, enter[3], leave[3];
  double first_origin[3], last_origin[3], smallest[3], largest[3];
} Packet;

/* Smallest and largest of LANES values. */
static void bounds(const double* values, double* low, double* high) {
  double small[LANES], large[LANES];
  memcpy(small, values, sizeof small);
  memcpy(large, values, sizeof large);
  for (int half = LANES / 2; half; half /= 2)
    for (int k = 0; k < half; ++k) {
      small[k] = small[k + half] < small[k] ? small[k + half] : small[k];
      large[k] = large[k + half] > large[k] ? large[k + half] : large[k];
    }
  *low = small[0];
  *high = large[0];
}

static void find_bounds(Packet* p) {
  p->alike = 0;
  for (int a = 0; a < 3; ++a) {
    double low, high, smallest, largest;
    bounds(p->inverse[a], &smallest, &largest);
    if (smallest < 0 && largest > 0) continue;
    bounds(p->o[a], &low, &high);
    const integer j = p->alike++, backward = largest < 0;
    p->enter[j] = backward ? 3 + a : a;
    p->leave[j] = backward ? a : 3 + a;
    p->first_origin[j] = backward ? low : high;
    p->last_origin[j] = backward ? high : low;
    p->smallest[j] = smallest;
    p->largest[j] = largest;
  }
}

/* How many lanes meet a child's box before their nearest hit: slab test, entry and exit along each axis (1 / d is stored). */
static integer meets(const Packet* p, const Branch* node, integer child) {
  integer any = 0;
  double low[3], high[3];
  for (int a = 0; a < 3; ++a) { low[a] = node->sides[a][child]; high[a] = node->sides[3 + a][child]; }
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

/* The earliest that any ray may enter each child's box; FAR where none meets it. An interval holds all rays' entries, so no box
 * that one of them meets is lost; axes along which the rays' senses differ say nothing. */
static void entries(const Packet* p, const Branch* node, double* entry) {
  double near[BRANCHES], far[BRANCHES];
  for (int c = 0; c < BRANCHES; ++c) { near[c] = 0; far[c] = p->farthest; }
  for (integer j = 0; j < p->alike; ++j) {
    const double *enter = node->sides[p->enter[j]], *leave = node->sides[p->leave[j]];
    const double ahead = p->first_origin[j], behind = p->last_origin[j], s = p->smallest[j], l = p->largest[j];
    for (int c = 0; c < BRANCHES; ++c) {
      const double in_s = (enter[c] - ahead) * s, in_l = (enter[c] - ahead) * l;
      const double out_s = (leave[c] - behind) * s, out_l = (leave[c] - behind) * l;
      const double in = in_s < in_l ? in_s : in_l, out = out_s > out_l ? out_s : out_l;
      near[c] = in > near[c] ? in : near[c];
      far[c] = out < far[c] ? out : far[c];
    }
  }
  for (int c = 0; c < BRANCHES; ++c) entry[c] = near[c] <= far[c] * (1 + 1e-12) ? near[c] : FAR;
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

typedef struct { double entry; int first, count; } Waiting;

/* Nearest hits of a packet, depth first, the child that is entered first before the others, so that hits in it exclude these. */
static void walk(Packet* p, const Branch* branches, const double* packed, double tolerance, double both_sides) {
  Waiting stack[STACK];
  integer depth = 1;
  stack[0] = (Waiting){0, 0, 0};
  while (depth) {
    const Waiting next = stack[--depth];
    if (next.entry > p->farthest) continue; /* hits found since it was pushed are nearer */
    if (next.count) {
      for (integer k = 0; k < next.count; ++k)
        intersect(p, packed + 12 * (next.first + k), next.first + k, tolerance, both_sides);
      double nearest;
      bounds(p->t, &nearest, &p->farthest);
      continue;
    }
    const Branch* node = &branches[next.first];
    double entry[BRANCHES];
    entries(p, node, entry);
    const integer bottom = depth;
    for (integer c = 0; c < node->children; ++c) {
      if (entry[c] >= FAR || (p->alike < 3 && !meets(p, node, c))) continue;
      integer place = depth++;
      for (; place > bottom && stack[place - 1].entry < entry[c]; --place) stack[place] = stack[place - 1];
      stack[place] = (Waiting){entry[c], node->first[c], node->count[c]};
    }
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
static void trace_packet(const integer* rays, const double* origins, const double* directions, const Branch* nodes,
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
  p.farthest = FAR;
  find_bounds(&p);
  walk(&p, nodes, packed, tolerance, both_sides);
  /* Store: hits are places in the order of leaves, `order` maps them to triangles; a ray that is repeated is stored again. */
  for (int k = 0; k < LANES; ++k) {
    distances[rays[k]] = p.t[k];
    hits[rays[k]] = p.hit[k] < 0 ? -1 : order[p.hit[k]];
  }
}

/* Distances (FAR for a miss) and triangles (-1) of n rays with unit directions, in rows of `across` rays; 0: in no rows. */
void trace(integer n, integer across, const double* origins, const double* directions, const Branch* nodes, const integer* order,
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
