"""One simulated run of the filters of tracks without a map, with the Cramer-Rao bound of what each used."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from experiments.landmark_bound import CramerRaoBound, TrueLandmarks
from spinfilters.data.dataset import Dataset
from spinfilters.estimators.estimator import MapChange
from spinfilters.estimators.filters.multiplicative_filter import MultiplicativeFilter
from spinfilters.estimators.history import EstimateHistory, GrowingHistory
from spinfilters.estimators.initialisation.initialiser import SmoothingOptions, smooth_first_epochs
from spinfilters.estimators.landmarks.belief import LandmarkBelief
from spinfilters.estimators.landmarks.landmark_map import LandmarkOptions
from spinfilters.estimators.run import advance
from spinfilters.estimators.smoothing.problem.least_squares import InitialGuess
from spinfilters.estimators.smoothing.state_prior import FirstStatePrior
from spinfilters.evaluation.body import body_history
from spinfilters.evaluation.consistency import true_states
from spinfilters.evaluation.errors import Alignment
from spinfilters.evaluation.evaluation import Evaluation, evaluate
from spinfilters.evaluation.trajectory import trajectory_of
from spinfilters.models.gauge import GAUGE_STD
from spinfilters.pipeline.estimation import build_estimator
from spinfilters.pipeline.setup import Setup, prepare
from spinfilters.settings.run_settings import ProcessSettings, Settings
from spinfilters.simulation.faults import WrongAssociations, with_faults
from spinfilters.simulation.scenario import RICH_RPM, THESIS_RPM, Scenario, simulate, without_map
from spinfilters.state.gaussian import Gaussian
from spinfilters.state.status import EstimatorStatus

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
    whole = simulate(Scenario.common_workload(MOTIONS[case.motion], case.seed))
    dataset = without_map(whole)
    if case.wrong:
        dataset = with_faults(dataset, (WrongAssociations(case.wrong),), case.seed)
    setup = prepare(dataset, settings)
    arrays: dict[str, np.ndarray] = {}
    for name in settings.estimators:
        history, changes = filtered(name, setup, settings)
        bound = bound_history(setup, whole, changes)
        figures = _figures(evaluate(history, dataset.truth, Alignment.FIRST_FRAME), bound)
        arrays |= {f"{name}/{what}": array for what, array in figures.items()}
    return arrays


def filtered(name: str, setup: Setup, settings: Settings) -> tuple[EstimateHistory, list[MapChange]]:
    """History of a filter, with the smoothed frames of the start in front, and what it did to its landmarks in every frame."""
    estimator = build_estimator(name, setup, settings)
    assert isinstance(estimator, MultiplicativeFilter)
    assert isinstance(setup.belief, LandmarkBelief)
    estimator.start(setup.belief)
    rows, changes = _smoothed_rows(setup), []
    for frame in setup.timeline[len(rows) :]:
        reports = advance(estimator, frame, frame.time - rows.time)
        rows.append(frame.time, estimator.belief, reports, 0.0)
        assert reports[0].map_change is not None
        changes.append(reports[0].map_change)
    return rows.ended(name, EstimatorStatus()), changes


def bound_history(setup: Setup, whole: Dataset, changes: list[MapChange]) -> EstimateHistory:
    """The bound of a filter's frames after the start: a history whose means are the truth."""
    assert whole.truth is not None
    assert whole.known_map is not None
    layout, begin = setup.process.layout, len(setup.initial.mean)
    truth = true_states(whole.truth, layout)
    landmarks = TrueLandmarks(whole.known_map.ids, whole.known_map.points)
    bound = CramerRaoBound(setup.process, landmarks, OPTIONS)
    bound.start(_true_start(setup, truth[:begin], landmarks))
    rows = GrowingHistory(layout, setup.end_of_initialisation)
    for k, change in zip(range(begin, len(truth)), changes, strict=True):
        bound.step(truth[k], setup.timeline[k].time - rows.time)
        bound.repeat(setup.timeline[k].measurements[0], change)
        rows.append(setup.timeline[k].time, bound.belief, [], 0.0)
    return rows.ended("bound", EstimatorStatus())


def _true_start(setup: Setup, truth: Float[np.ndarray, "k m"], landmarks: TrueLandmarks) -> LandmarkBelief:
    """The belief at the end of the start, had everything been linearised at the truth."""
    assert setup.initial.has_landmarks
    layout, options = setup.process.layout, SmoothingOptions(iterations=0)
    std = np.repeat([GAUGE_STD, GAUGE_STD, 1.0, 1.0, 1.0, 1.5], [3, 3, 3, 3, 3, 5])
    mean = truth[0].copy()
    mean[layout.mean_slice("s")] = 0.0
    epochs = setup.timeline[: len(truth)]
    trial = InitialGuess(truth, landmarks.ids, landmarks.points)
    found = smooth_first_epochs(setup.process, epochs, trial, FirstStatePrior(mean, std), options)
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


def _smoothed_rows(setup: Setup) -> GrowingHistory:
    start, layout = setup.initial, setup.process.layout
    rows = GrowingHistory(layout, setup.timeline[0].time)
    for frame, mean, factor in zip(setup.timeline, start.mean, start.factor, strict=False):
        rows.append(frame.time, Gaussian(layout, mean, factor), [], 0.0)
    return rows
