"""One simulated run of the filters of tracks without a map, with the Cramer-Rao bound of what each used."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from experiments.landmark_bound import CramerRaoBound, TrueLandmarks
from spinfilters.estimators.estimator import MapChange
from spinfilters.estimators.history import EstimateHistory, GrowingHistory
from spinfilters.estimators.initialisation.initialiser import SmoothingOptions, smooth_first_epochs
from spinfilters.estimators.landmarks.belief import LandmarkBelief
from spinfilters.estimators.landmarks.landmark_map import LandmarkOptions
from spinfilters.estimators.multiplicative_filter import MultiplicativeFilter
from spinfilters.estimators.run import advance
from spinfilters.estimators.smoothing.problem import Trial
from spinfilters.estimators.smoothing.state_prior import FirstStatePrior
from spinfilters.evaluation.body import body_history
from spinfilters.evaluation.consistency import true_states
from spinfilters.evaluation.errors import Alignment
from spinfilters.evaluation.evaluation import Evaluation, evaluate
from spinfilters.evaluation.trajectory import trajectory_of
from spinfilters.logs.dataset import Dataset
from spinfilters.models.gauge import GAUGE_STD
from spinfilters.simulation.faults import WrongAssociations, with_faults
from spinfilters.simulation.scenario import RICH_RPM, THESIS_RPM, Scenario, simulate, without_map
from spinfilters.state.gaussian import Gaussian
from spinfilters.state.status import EstimatorStatus
from spinfilters.workflow.estimation import build_estimator
from spinfilters.workflow.preparation import Prepared, prepare
from spinfilters.workflow.settings import ProcessSettings, Settings

NAMES = ("mekf", "ukf")
MOTIONS = {"rich": RICH_RPM, "thesis": THESIS_RPM}
OPTIONS = LandmarkOptions()
SETTINGS = Settings(
    estimators=NAMES, landmarks=OPTIONS, process=ProcessSettings(force_psd=1e-6, torque_psd=1e-6)
)


@dataclass(frozen=True)
class Case:
    """One run: motion, seed, share of wrong associations."""

    motion: str
    seed: int
    wrong: float = 0.0

    @property
    def label(self) -> str:
        """A name for files."""
        return f"{self.motion}-{self.wrong:g}-{self.seed}"


def run_case(case: Case, settings: Settings = SETTINGS) -> dict[str, np.ndarray]:
    """Simulate, start, filter and bound: arrays by ``<estimator>/<what>``, see `_figures`."""
    whole = simulate(Scenario.disam115(MOTIONS[case.motion], case.seed))
    dataset = without_map(whole)
    if case.wrong:
        dataset = with_faults(dataset, (WrongAssociations(case.wrong),), case.seed)
    prepared = prepare(dataset, settings)
    arrays: dict[str, np.ndarray] = {}
    for name in settings.estimators:
        history, changes = filtered(name, prepared, settings)
        bound = bound_history(prepared, whole, changes)
        figures = _figures(evaluate(history, dataset.truth, Alignment.FIRST_FRAME), bound)
        arrays |= {f"{name}/{what}": array for what, array in figures.items()}
    return arrays


def filtered(name: str, prepared: Prepared, settings: Settings) -> tuple[EstimateHistory, list[MapChange]]:
    """History of a filter, with the smoothed frames of the start in front, and what it did to its landmarks in every frame."""
    estimator = build_estimator(name, prepared, settings)
    assert isinstance(estimator, MultiplicativeFilter)
    assert isinstance(prepared.belief, LandmarkBelief)
    estimator.start(prepared.belief)
    rows, changes = _smoothed_rows(prepared), []
    for frame in prepared.timeline[len(rows) :]:
        reports = advance(estimator, frame, frame.time - rows.time)
        rows.append(frame.time, estimator.belief, reports, 0.0)
        assert reports[0].map_change is not None
        changes.append(reports[0].map_change)
    return rows.ended(name, EstimatorStatus()), changes


def bound_history(prepared: Prepared, whole: Dataset, changes: list[MapChange]) -> EstimateHistory:
    """The bound of a filter's frames after the start: a history whose means are the truth."""
    assert whole.truth is not None
    assert whole.known_map is not None
    layout, begin = prepared.process.layout, len(prepared.start.mean)
    truth = true_states(whole.truth, layout)
    landmarks = TrueLandmarks(whole.known_map.ids, whole.known_map.points)
    bound = CramerRaoBound(prepared.process, landmarks, OPTIONS)
    bound.start(_true_start(prepared, truth[:begin], landmarks))
    rows = GrowingHistory(layout, prepared.start_end)
    for k, change in zip(range(begin, len(truth)), changes, strict=True):
        bound.step(truth[k], prepared.timeline[k].time - rows.time)
        bound.repeat(prepared.timeline[k].measurements[0], change)
        rows.append(prepared.timeline[k].time, bound.belief, [], 0.0)
    return rows.ended("bound", EstimatorStatus())


def _true_start(
    prepared: Prepared, truth: Float[np.ndarray, "k m"], landmarks: TrueLandmarks
) -> LandmarkBelief:
    """The belief at the end of the start, had everything been linearised at the truth."""
    assert prepared.start.has_landmarks
    layout, options = prepared.process.layout, SmoothingOptions(iterations=0)
    std = np.repeat([GAUGE_STD, GAUGE_STD, 1.0, 1.0, 1.0, 1.5], [3, 3, 3, 3, 3, 5])
    mean = truth[0].copy()
    mean[layout.mean_slice("s")] = 0.0
    frames = prepared.timeline[: len(truth)]
    trial = Trial(truth, landmarks.ids, landmarks.points)
    found = smooth_first_epochs(prepared.process, frames, trial, FirstStatePrior(mean, std), options)
    belief = found.joint_belief(OPTIONS)
    assert isinstance(belief, LandmarkBelief)
    return belief


def _figures(evaluation: Evaluation, bound: EstimateHistory) -> dict[str, np.ndarray]:
    """Of all n frames: nees (n,), nees_<block> (n,), moments (n, 3) errors, position and velocity (n, 3) errors, m and m/s.

    Of the frames after the start: position_bound, velocity_bound, moments_bound (k, 3) standard deviations.
    """
    assert evaluation.nees is not None
    assert evaluation.errors is not None
    assert evaluation.errors.position is not None
    assert evaluation.errors.velocity is not None
    assert evaluation.body_errors is not None
    limits, body = trajectory_of(bound), body_history(bound)
    own, moments = evaluation.bodies.principal_moments, body.principal_moments[-1]
    return {
        "nees": evaluation.nees.total,
        **{f"nees_{block}": values for block, values in evaluation.nees.blocks.items()},
        "position": evaluation.errors.position,
        "velocity": evaluation.errors.velocity,
        "moments": own - moments,
        "moments_std": np.sqrt(np.diagonal(evaluation.bodies.principal_moments_cov, axis1=1, axis2=2)),
        "rejected": evaluation.history.rejected,
        "position_bound": limits.std_position,
        "velocity_bound": limits.std_velocity,
        "moments_bound": np.sqrt(np.diagonal(body.principal_moments_cov, axis1=1, axis2=2)),
    }


def _smoothed_rows(prepared: Prepared) -> GrowingHistory:
    start, layout = prepared.start, prepared.process.layout
    rows = GrowingHistory(layout, prepared.timeline[0].time)
    for frame, mean, factor in zip(prepared.timeline, start.mean, start.factor, strict=False):
        rows.append(frame.time, Gaussian(layout, mean, factor), [], 0.0)
    return rows
