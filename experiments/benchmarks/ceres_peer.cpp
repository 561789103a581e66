/* The smoothing problem for Ceres, as `ceres_peer.py` hands it over: stereo observations with derivatives written out, and rows
 * of the motion that the caller makes for every point that Ceres evaluates. Landmarks are eliminated first (SPARSE_SCHUR). Nothing
 * here uses Eigen, whose vectors may be wider here than those that the library was built with. */
#include <ceres/ceres.h>
#include <time.h>

#include <cstdint>
#include <cstring>
#include <deque>

namespace {

enum { POSE = 7, TURN = 6, RATES = 6, CONSTANTS = 8, MOVING = 12, FULL = 20 };
enum { PRIOR_WIDTH = FULL + 1, STEP_WIDTH = 2 * MOVING + CONSTANTS + 1 };

/* Rows [J | y] of prior and steps at the present values of all parameters are made by the caller. */
typedef void (*MakeRows)();

struct Rows : ceres::EvaluationCallback {
  explicit Rows(MakeRows make) : make(make) {}
  void PrepareForEvaluation(bool, bool moved) override {
    if (moved) make();
  }
  MakeRows make;
};

/* Pose (t, q_ig) with the error (d, a): t + d and q (x) dq(a), a being 4 x MRP on the body side. Costs give their derivatives by
 * this error in the first six of the seven columns, so that the derivative of Plus is [I; 0]. */
struct PoseManifold : ceres::Manifold {
  int AmbientSize() const override { return POSE; }
  int TangentSize() const override { return TURN; }
  bool Plus(const double* x, const double* e, double* y) const override {
    for (int k = 0; k < 3; ++k) y[k] = x[k] + e[k];
    const double s[3] = {e[3] / 4, e[4] / 4, e[5] / 4}, square = s[0] * s[0] + s[1] * s[1] + s[2] * s[2];
    const double c = 2 / (1 + square), p[4] = {c * s[0], c * s[1], c * s[2], (1 - square) / (1 + square)};
    const double* q = x + 3;
    double* r = y + 3;
    r[0] = q[3] * p[0] + q[0] * p[3] + q[1] * p[2] - q[2] * p[1];
    r[1] = q[3] * p[1] - q[0] * p[2] + q[1] * p[3] + q[2] * p[0];
    r[2] = q[3] * p[2] + q[0] * p[1] - q[1] * p[0] + q[2] * p[3];
    r[3] = q[3] * p[3] - q[0] * p[0] - q[1] * p[1] - q[2] * p[2];
    const double length = std::sqrt(r[0] * r[0] + r[1] * r[1] + r[2] * r[2] + r[3] * r[3]);
    for (int k = 0; k < 4; ++k) r[k] /= length;
    return true;
  }
  bool PlusJacobian(const double*, double* jacobian) const override {
    memset(jacobian, 0, POSE * TURN * sizeof(double));
    for (int k = 0; k < TURN; ++k) jacobian[k * TURN + k] = 1;
    return true;
  }
  /* Only covariances and gradient checks ask for these two. */
  bool Minus(const double*, const double*, double*) const override { return false; }
  bool MinusJacobian(const double*, double*) const override { return false; }
};

/* Pixels (u_left, v_left, u_right) of a landmark p of frame g, seen as R_ig p + t. */
struct Stereo : ceres::SizedCostFunction<3, POSE, 3> {
  Stereo(const double* pixels, const double* camera, double std) : pixels(pixels), camera(camera), weight(1 / std) {}
  bool Evaluate(double const* const* x, double* residual, double** jacobian) const override {
    const double *t = x[0], *q = x[0] + 3, *p = x[1];
    const double fx = camera[0], fy = camera[1], cx = camera[2], cy = camera[3], baseline = camera[4];
    double R[3][3] = {
        {1 - 2 * (q[1] * q[1] + q[2] * q[2]), 2 * (q[0] * q[1] - q[2] * q[3]), 2 * (q[0] * q[2] + q[1] * q[3])},
        {2 * (q[0] * q[1] + q[2] * q[3]), 1 - 2 * (q[0] * q[0] + q[2] * q[2]), 2 * (q[1] * q[2] - q[0] * q[3])},
        {2 * (q[0] * q[2] - q[1] * q[3]), 2 * (q[1] * q[2] + q[0] * q[3]), 1 - 2 * (q[0] * q[0] + q[1] * q[1])}};
    double c[3];
    for (int k = 0; k < 3; ++k) c[k] = R[k][0] * p[0] + R[k][1] * p[1] + R[k][2] * p[2] + t[k];
    const double depth = 1 / c[2], u = fx * c[0] * depth, v = fy * c[1] * depth, w = fx * (c[0] - baseline) * depth;
    residual[0] = weight * (u + cx - pixels[0]);
    residual[1] = weight * (v + cy - pixels[1]);
    residual[2] = weight * (w + cx - pixels[2]);
    if (jacobian == nullptr) return c[2] > 0;
    /* D = derivative of the pixels by the point in camera axes, D R = that by p, and -D R [p x] = that by the error a. */
    const double D[3][3] = {{weight * fx * depth, 0, -weight * u * depth},
                            {0, weight * fy * depth, -weight * v * depth},
                            {weight * fx * depth, 0, -weight * w * depth}};
    for (int r = 0; r < 3; ++r) {
      double G[3];
      for (int k = 0; k < 3; ++k) G[k] = D[r][0] * R[0][k] + D[r][1] * R[1][k] + D[r][2] * R[2][k];
      if (jacobian[0]) {
        double* by_pose = jacobian[0] + r * POSE;
        for (int k = 0; k < 3; ++k) by_pose[k] = D[r][k];
        by_pose[3] = p[1] * G[2] - p[2] * G[1];
        by_pose[4] = p[2] * G[0] - p[0] * G[2];
        by_pose[5] = p[0] * G[1] - p[1] * G[0];
        by_pose[6] = 0;
      }
      if (jacobian[1])
        for (int k = 0; k < 3; ++k) jacobian[1][3 * r + k] = G[k];
    }
    return c[2] > 0;
  }
  const double *pixels, *camera, weight;
};

/* Columns first .. first + count of rows [r][width] into a Jacobian of so many columns or more. */
inline void take(const double* rows, int r, int width, int first, int count, double* jacobian, int columns) {
  if (jacobian == nullptr) return;
  memset(jacobian, 0, r * columns * sizeof(double));
  for (int k = 0; k < r; ++k) memcpy(jacobian + k * columns, rows + k * width + first, count * sizeof(double));
}

/* Prior of the first state by (pose, rates, constants); the residual is J e - y. */
struct Prior : ceres::SizedCostFunction<FULL, POSE, RATES, CONSTANTS> {
  explicit Prior(const double* rows) : rows(rows) {}
  bool Evaluate(double const* const*, double* residual, double** J) const override {
    for (int k = 0; k < FULL; ++k) residual[k] = -rows[k * PRIOR_WIDTH + FULL];
    if (J == nullptr) return true;
    take(rows, FULL, PRIOR_WIDTH, 0, TURN, J[0], POSE);
    take(rows, FULL, PRIOR_WIDTH, TURN, RATES, J[1], RATES);
    take(rows, FULL, PRIOR_WIDTH, MOVING, CONSTANTS, J[2], CONSTANTS);
    return true;
  }
  const double* rows;
};

/* Step by (pose, rates) here, (pose, rates) there, and constants. */
struct Step : ceres::SizedCostFunction<MOVING, POSE, RATES, POSE, RATES, CONSTANTS> {
  explicit Step(const double* rows) : rows(rows) {}
  bool Evaluate(double const* const*, double* residual, double** J) const override {
    for (int k = 0; k < MOVING; ++k) residual[k] = -rows[k * STEP_WIDTH + STEP_WIDTH - 1];
    if (J == nullptr) return true;
    for (int end = 0; end < 2; ++end) {
      take(rows, MOVING, STEP_WIDTH, MOVING * end, TURN, J[2 * end], POSE);
      take(rows, MOVING, STEP_WIDTH, MOVING * end + TURN, RATES, J[2 * end + 1], RATES);
    }
    take(rows, MOVING, STEP_WIDTH, 2 * MOVING, CONSTANTS, J[4], CONSTANTS);
    return true;
  }
  const double* rows;
};

double processor_seconds() {
  timespec time;
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &time);
  return time.tv_sec + 1e-9 * time.tv_nsec;
}

/* When each iteration ended, as far as there is room. */
struct Clock : ceres::IterationCallback {
  Clock(double* seconds, int room) : seconds(seconds), room(room) {}
  ceres::CallbackReturnType operator()(const ceres::IterationSummary& summary) override {
    if (summary.iteration < room) seconds[summary.iteration] = processor_seconds();
    return ceres::SOLVER_CONTINUE;
  }
  double* seconds;
  int room;
};

}  // namespace

extern "C" {
#pragma GCC visibility push(default)

struct Data {
  int64_t epochs, landmarks, observations;
  const int64_t *epoch, *landmark;
  const double *pixels, *camera;
  double pixel_std, tolerance;
  int64_t iterations;
  double *poses, *rates, *constants, *points; /* where they start, and where they end */
  const double *prior, *steps;                /* rows [20][21] and [epochs - 1][12][33], which `make_rows` writes */
  MakeRows make_rows;
};

struct Found {
  int64_t iterations, steps, usable;
  double initial_cost, final_cost, jacobian_seconds, residual_seconds, linear_seconds;
};

/* Solve, on one thread; times [iterations + 1]: processor seconds at the end of the start and of each iteration. */
void ceres_solve(const Data* data, Found* found, double* times) {
  Rows rows(data->make_rows);
  PoseManifold manifold;
  std::deque<Stereo> stereo; /* cost functions cannot be moved */
  std::deque<Step> steps;
  Prior prior(data->prior);
  ceres::Problem::Options owned;
  owned.cost_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  owned.manifold_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  owned.evaluation_callback = &rows;
  ceres::Problem problem(owned);
  ceres::Solver::Options options;
  options.linear_solver_ordering = std::make_shared<ceres::ParameterBlockOrdering>();
  for (int64_t k = 0; k < data->epochs; ++k) problem.AddParameterBlock(data->poses + POSE * k, POSE, &manifold);
  for (int64_t i = 0; i < data->observations; ++i) {
    stereo.emplace_back(data->pixels + 3 * i, data->camera, data->pixel_std);
    problem.AddResidualBlock(&stereo.back(), nullptr, data->poses + POSE * data->epoch[i], data->points + 3 * data->landmark[i]);
  }
  problem.AddResidualBlock(&prior, nullptr, data->poses, data->rates, data->constants);
  for (int64_t k = 0; k + 1 < data->epochs; ++k) {
    steps.emplace_back(data->steps + MOVING * STEP_WIDTH * k);
    double *pose = data->poses + POSE * k, *rates = data->rates + RATES * k;
    problem.AddResidualBlock(&steps.back(), nullptr, pose, rates, pose + POSE, rates + RATES, data->constants);
  }
  /* Landmarks are eliminated first; what remains is ordered by SuiteSparse. */
  for (int64_t l = 0; l < data->landmarks; ++l) options.linear_solver_ordering->AddElementToGroup(data->points + 3 * l, 0);
  for (int64_t k = 0; k < data->epochs; ++k) {
    options.linear_solver_ordering->AddElementToGroup(data->poses + POSE * k, 1);
    options.linear_solver_ordering->AddElementToGroup(data->rates + RATES * k, 1);
  }
  options.linear_solver_ordering->AddElementToGroup(data->constants, 1);
  options.linear_solver_type = ceres::SPARSE_SCHUR;
  options.num_threads = 1;
  options.max_num_iterations = (int)data->iterations;
  options.function_tolerance = data->tolerance;
  options.logging_type = ceres::SILENT;
  Clock clock(times, (int)data->iterations + 1);
  options.callbacks.push_back(&clock);
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem, &summary);
  found->iterations = (int64_t)summary.iterations.size() - 1;
  found->steps = summary.num_successful_steps;
  found->usable = summary.IsSolutionUsable();
  found->initial_cost = 2 * summary.initial_cost;
  found->final_cost = 2 * summary.final_cost;
  found->jacobian_seconds = summary.jacobian_evaluation_time_in_seconds;
  found->residual_seconds = summary.residual_evaluation_time_in_seconds;
  found->linear_seconds = summary.linear_solver_time_in_seconds;
}

const char* ceres_version() { return CERES_VERSION_STRING; }
#pragma GCC visibility pop
}
