"""Restarts of a window: its latest epoch by consensus where its guess is poor, its motion from conserved momentum."""

from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise

import numpy as np
from jaxtyping import Bool, Float

from spinfilters.core.absolute_orientation import absolute_orientation, absolute_orientations
from spinfilters.core.attitude_conversions import matrix_from_quaternion
from spinfilters.core.errors import InputError
from spinfilters.core.robust_losses import RobustLoss, UngatedRows
from spinfilters.models.sensor import MotionSamples
from spinfilters.models.state_layout import POSE_BLOCKS, StateLayout
from spinfilters.smoother.batch_smoother import GATE, AnnealedSchedule
from spinfilters.smoother.closed_form import MASS_SHARES, MOMENTUM_BLOCKS, initial_motion, initial_state
from spinfilters.smoother.landmark_factors import OBSERVATIONS_NEEDED, linearise_observations, reinitialised
from spinfilters.smoother.linear_system import SchurSystem
from spinfilters.smoother.problem import LinearizationPoint, LinearProblem, NormalEquations, Problem, Stage
from spinfilters.smoother.solver import ConstantSchedule, SolverOptions, solve
from spinfilters.smoother.window import Window

POOR_GUESS_SHARE = 0.3
"""Share of the latest epoch's observations without weight from which the epoch's guess, not the observations, is taken to be
wrong."""
WIDTH = 5.0
"""Standard deviations within which observations' own points agree."""


def is_poor_guess(problem: Problem, here: LinearizationPoint, loss: RobustLoss) -> bool:
    """Whether the loss rejects most observations of the latest epoch."""
    if here.linear is None or problem.observations is None:
        return False
    lost = here.linear.weight(loss)[problem.observations.latest] == 0
    return bool(np.count_nonzero(lost) > POOR_GUESS_SHARE * len(lost))


def with_landmarks_put_right(problem: Problem, here: LinearizationPoint, stage: Stage) -> LinearizationPoint:
    """Linearisation point with landmarks of fewer than two inliers re-initialised."""
    if problem.observations is None or here.linear is None:
        return here
    inliers = here.linear.weight(stage.loss) > 0
    if inliers.all():
        return here
    landmark, count = problem.observations.landmark, problem.observations.landmarks
    every, good = np.bincount(landmark, minlength=count), np.bincount(landmark[inliers], minlength=count)
    if not ((every > OBSERVATIONS_NEEDED) & (good < OBSERVATIONS_NEEDED)).any():
        return here
    points = reinitialised(problem.observations, here.trajectory, here.points, inliers, WIDTH)
    if points is None:
        return here
    linear = linearise_observations(problem.observations, here.trajectory, points)
    return replace(here, points=points, linear=linear)


def linear_problem(problem: Problem, here: LinearizationPoint, loss: RobustLoss) -> LinearProblem:
    """Linear problem about a point, or one at which misplaced landmarks are re-initialised."""
    stage = Stage(loss)
    here = with_landmarks_put_right(problem, here, stage)
    return LinearProblem(here, problem.normal(here, stage))


def observation_weights(
    window: Window, normal: NormalEquations, epoch: int, ends: list[int]
) -> list[Float[np.ndarray, " n"]]:
    """Weights of the observations of an epoch between these ends; zero where there is no solution."""
    fit, (first, last) = normal.eliminated, np.searchsorted(window.seen.epoch, [epoch, epoch + 1]).tolist()
    weight = np.zeros(last - first)
    if fit is not None:
        order, seen = np.argsort(window.seen.landmark[first:last], kind="stable"), fit.observations
        is_last = epoch == len(seen.counts) - 1
        weight[order] = fit.weight[seen.latest if is_last else seen.epoch == epoch]
    return [weight[begin - first : end - first] for begin, end in pairwise(ends)]


JOINING_ITERATIONS = 10
"""From a prediction to where few observations put the state: a body that moves nearly freely is never far from it."""


def with_few_joined(
    problem: Problem, here: LinearizationPoint, loss: RobustLoss
) -> LinearizationPoint | None:
    """Point at which the few observations of the latest epoch fit; None where they are likelier to be wrong.

    The loss refuses an observation by its distance from the predicted state in standard deviations of the observation alone. Behind
    a gap, or where few landmarks are in view, the prediction is less certain than that, and good observations are refused together.
    A pose by consensus needs more of them. The motion is therefore fitted with them ungated, and stays where the robust cost of
    everything is lower there than where they are refused: an error of gross size bends the motion or stays beyond the gate, and
    costs more.
    """
    observations = problem.observations
    if observations is None or len(_matches(problem, here.trajectory, here.points).seen) >= FEWEST:
        return None
    is_latest = observations.epoch == problem.ordering.epochs - 1
    options = SolverOptions(iterations=JOINING_ITERATIONS)
    refused = solve(problem, here, options, ConstantSchedule(loss)).point
    fitted = solve(problem, here, options, ConstantSchedule(UngatedRows(loss, is_latest))).point
    joined = solve(problem, fitted, options, ConstantSchedule(loss)).point
    stage = Stage(loss)
    return joined if joined.robust_cost(stage) < refused.robust_cost(stage) else None


AGREEMENT, ROUGH_AGREEMENT = 5.0, 15.0
"""Mahalanobis distance within which a point agrees with a fitted pose, and with that of three points alone."""
FEWEST, SMALLEST_SHARE, CLEAR_SHARE = 6, 0.2, 0.5
"""Points that must agree with a pose: so many, and such a share. From the last share on no other pose can have more."""
TRIPLES, REFITS, SEED = 200, 3, 0
"""Of random points, from a seed of their own, so that the same observations give the same pose."""


@dataclass(frozen=True)
class _LatestMatches:
    """Points in camera coordinates matched to landmarks in g; factors (k, 3, 3) whiten their distance (m)."""

    seen: Float[np.ndarray, "k 3"]
    landmarks: Float[np.ndarray, "k 3"]
    whitening: Float[np.ndarray, "k 3 3"]

    def distance(
        self, R: Float[np.ndarray, "h 3 3"], t: Float[np.ndarray, "h 3"]
    ) -> Float[np.ndarray, "h k"]:
        """Mahalanobis distance of every match under h motions."""
        away = self.seen - (self.landmarks @ R.swapaxes(1, 2) + t[:, None])
        return np.sqrt(np.square(np.einsum("kab,hkb->hka", self.whitening, away)).sum(axis=2))

    def agreeing(self, pose: Float[np.ndarray, " 7"], bound: float) -> Bool[np.ndarray, " k"]:
        """Matches within a distance of a pose."""
        return self.distance(matrix_from_quaternion(pose[3:])[None], pose[None, :3])[0] < bound


def latest_pose(
    problem: Problem, trajectory: Float[np.ndarray, "k m"], points: Float[np.ndarray, "L 3"]
) -> Float[np.ndarray, " 7"] | None:
    """Pose (t m, q_ig) of the latest epoch from its observations; None where too few known landmarks agree on one."""
    matches = _matches(problem, trajectory, points)
    if len(matches.seen) < FEWEST:
        return None
    layout = problem.layout
    state = trajectory[-1]
    predicted = np.concatenate([state[layout.mean_slice("t")], state[layout.mean_slice("a")]])
    pose = _refit_pose(matches, predicted)
    if pose is None or matches.agreeing(pose, AGREEMENT).mean() < CLEAR_SHARE:
        other = _refit_pose(matches, _best_of_triples(matches))
        pose = _choose_better(matches, pose, other)
    return pose


def _choose_better(
    matches: _LatestMatches, one: np.ndarray | None, other: np.ndarray | None
) -> np.ndarray | None:
    """The pose that more matches agree with."""
    if one is None or other is None:
        return other if one is None else one
    return max((one, other), key=lambda pose: np.count_nonzero(matches.agreeing(pose, AGREEMENT)))


def _matches(problem: Problem, trajectory: np.ndarray, points: np.ndarray) -> _LatestMatches:
    """Observations of the last epoch that determine a point, of landmarks that were observed before."""
    observations = problem.observations
    assert observations is not None
    last = problem.ordering.epochs - 1
    before = np.zeros(observations.landmarks, dtype=bool)
    before[observations.landmark[observations.epoch < last]] = True
    rows = (observations.epoch == last) & before[observations.landmark]
    origin = problem.layout.origin()
    found = [(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros((0, 3, 3)))]
    for group in observations.groups:
        at = np.flatnonzero(rows[group.rows])
        if not len(at):
            continue
        parameters = np.concatenate([np.zeros((len(at), 3)), group.parameters[at]], axis=1)
        made = group.model.new_landmarks(origin, parameters, group.values[at])
        good = made.determined & np.isfinite(made.points).all(axis=1)
        at, here = at[good], made.points[good]
        whitening = np.linalg.inv(
            np.sqrt(2) * made.root[good]
        )  # the landmark is about as uncertain as the observation
        found.append((here, points[observations.landmark[group.rows[at]]], whitening))
    return _LatestMatches(*(np.concatenate(parts) for parts in zip(*found, strict=True)))


def _refit_pose(matches: _LatestMatches, pose: Float[np.ndarray, " 7"]) -> Float[np.ndarray, " 7"] | None:
    """Fitted again and again to what agrees with it; None where too little does."""
    weight = np.square(matches.whitening).sum(axis=(1, 2))
    for bound in np.linspace(ROUGH_AGREEMENT, AGREEMENT, REFITS):
        good = matches.agreeing(pose, bound)
        if not _require_a_step(good):
            return None
        try:
            q, t = absolute_orientation(matches.seen[good], matches.landmarks[good], weight[good])
        except InputError:  # on one line
            return None
        pose = np.concatenate([t, q])
    return pose if _require_a_step(matches.agreeing(pose, AGREEMENT)) else None


def _require_a_step(good: Bool[np.ndarray, " k"]) -> bool:
    return bool(good.sum() >= FEWEST and good.mean() >= SMALLEST_SHARE)


def _best_of_triples(matches: _LatestMatches) -> Float[np.ndarray, " 7"]:
    """The motion of three points that all others fit best."""
    generator = np.random.default_rng(SEED)
    chosen = generator.random((TRIPLES, len(matches.seen))).argpartition(2, axis=1)[:, :3]
    motions = absolute_orientations(matches.seen[chosen], matches.landmarks[chosen])
    cost = np.square(np.minimum(matches.distance(motions.R, motions.t), ROUGH_AGREEMENT)).sum(axis=1)
    return motions.poses[np.argmin(cost)]


FIRST, GROWTH, RETRY = 4, 1.5, 1.2
"""Number of epochs at which it is first asked, and by how much more before it is asked again: where all fits, and where not."""
GOOD_FIT, INLIER_SHARE = 1.5, 0.4
"""Cost per degree of freedom, and share of the observations, from which a fit is not in doubt."""


@dataclass
class RetrySchedule:
    """Schedule of restart attempts by number of epochs. Sparser where everything fits."""

    next: float = FIRST
    retry: float = FIRST

    def is_due(self, epochs: int, good: bool) -> bool:
        """Whether enough epochs have come for the next attempt."""
        if epochs < (self.next if good else self.retry):
            return False
        self.next, self.retry = GROWTH * epochs, RETRY * epochs
        return True


def fits(here: "LinearizationPoint", normal: "NormalEquations") -> bool:
    """Whether a point fits as well as the noise allows.

    Its own cost counts, not the one that its linear problem predicts.
    """
    if not normal.solved:
        return False
    if normal.eliminated is None or here.linear is None:
        return True
    used, constrained = int(np.count_nonzero(normal.eliminated.used)), normal.eliminated.is_constrained
    dof = here.linear.rows.shape[1] * used - 3 * int(np.count_nonzero(constrained))
    every = int(np.diff(normal.eliminated.observations.start)[constrained].sum())
    cost = here.cost(normal.used, normal.stage)
    if here.marginal_prior is not None:
        prior = here.marginal_prior.marginal_prior
        cost -= (
            prior.constant_cost
        )  # of observations that have left, which are not among these degrees of freedom
        dof += max(len(prior.right) - prior.ordering.layout.error_dim, 0)  # beyond what one state takes
    return used >= INLIER_SHARE * every and cost <= GOOD_FIT * max(dof, 1)


ITERATIONS = 15
"""From where it points to, with an annealed schedule."""
MARGIN, KNOWN = 1.0, 0.5
"""Of the cost: by how much another optimum must fit better, and how close to the present one a point leads to no other."""


def restarted_from_momentum(
    problem: Problem, window: Window, linear: LinearProblem
) -> tuple[LinearizationPoint | None, int]:
    """Better-fitting point from the closed form, or None; and linearisations used.

    Parameters
    ----------
    window : Window
        At its present optimum.
    linear : LinearProblem
        The last linear problem on the way to it.
    """
    layout, here, candidates, count = problem.layout, window.trajectory, [], 0
    if not layout.translates or problem.observations is None:
        return None, 0
    trajectory = trajectory_from_momentum(layout, here, np.array([epoch.time for epoch in window.epochs]))
    if trajectory is None:
        return None, 0
    optimum = linear.normal.solution if fits(linear.point, linear.normal) else None
    is_known = partial(_leads_to, optimum, layout, here)
    for share in MASS_SHARES:
        start = trajectory.copy()
        start[:, layout.mean_slice("s")] *= share
        at, schedule = problem.at(start, window.points), AnnealedSchedule(problem, ITERATIONS, GATE)
        found = solve(problem, at, SolverOptions(ITERATIONS), schedule, is_known=is_known)
        count += found.linearisations
        if is_known(found.point):
            break
        candidates.append(found.point)
        if fits(found.point, found.normal):
            break
    return _choose_best(problem, window, candidates, linear.normal.stage), count


def _leads_to(
    optimum: SchurSystem | None,
    layout: StateLayout,
    trajectory: Float[np.ndarray, "k m"],
    point: LinearizationPoint,
) -> bool:
    """Whether iterations from a point would end at an optimum that fits, so close is it."""
    return optimum is not None and optimum.rise(layout.local(trajectory, point.trajectory)) < KNOWN


def _choose_best(
    problem: Problem, window: Window, candidates: list[LinearizationPoint], stage: Stage
) -> LinearizationPoint | None:
    """The candidate of least cost, if it fits better than the window does."""
    if not candidates:
        return None
    costs = np.nan_to_num([point.robust_cost(stage) for point in candidates], nan=np.inf)
    best = int(np.argmin(costs))
    now = problem.at(window.trajectory, window.points).robust_cost(stage)
    return candidates[best] if costs[best] < now - MARGIN else None


def trajectory_from_momentum(
    layout: StateLayout, given: Float[np.ndarray, "k m"], times: Float[np.ndarray, " k"]
) -> Float[np.ndarray, "k m"] | None:
    """Trajectory with rates and constants of conserved angular momentum; None where its poses show no motion."""
    poses = np.concatenate([given[:, layout.mean_slice(b)] for b in POSE_BLOCKS], axis=1)
    try:
        evidence = initial_motion(MotionSamples(times, poses[:, 3:], positions=poses[:, :3]), len(times))
        first, _ = initial_state(layout, evidence)
    except InputError:  # no rotation yet, or too few poses: nothing better is known
        return None
    trajectory = given.copy()
    for block in MOMENTUM_BLOCKS:
        if layout.has(block):
            trajectory[:, layout.mean_slice(block.name)] = first[layout.mean_slice(block.name)]
    # of poses that contradict the others there is no evidence
    by_axis = [np.interp(times, evidence.time, rate) for rate in evidence.rates.T]
    trajectory[:, layout.mean_slice("w")] = np.stack(by_axis, axis=1)
    return trajectory
