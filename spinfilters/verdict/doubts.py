"""Doubts about the estimates of a run, and their verdicts."""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from jaxtyping import Float

from spinfilters.evaluation.estimator_evaluation import Evaluation, evaluate, not_failed
from spinfilters.evaluation.trajectory_errors import Alignment
from spinfilters.filters.history import EstimateHistory, finished_history
from spinfilters.filters.noise_levels import VarianceComponent
from spinfilters.inference.estimator_entry import AnyEntry
from spinfilters.inference.first_epochs import DETERMINED_STD
from spinfilters.inference.identified_noise import LARGEST_ERROR
from spinfilters.inference.setup import Setup
from spinfilters.inference.smoother_run import NAME as SMOOTHER
from spinfilters.models.sensor_registry import sensor_of
from spinfilters.models.state_blocks import CENTRE_OF_MASS
from spinfilters.models.status import Finding, Verdict
from spinfilters.settings.run_settings import FILTER, Settings
from spinfilters.verdict.calibration_errors import enlargements, possible_clock_drift
from spinfilters.verdict.checks import (
    LARGEST_MOMENT_STD,
    LEFT_OUT,
    MOST_MOMENTUM,
    Evidence,
    finding,
    rejected_share,
)
from spinfilters.verdict.filter_diagnostics import (
    agreement_diagnostics,
    expected_nis,
    filter_noise_diagnostics,
    motion_diagnostics,
    reference_smoother,
    stated_level_diagnostics,
)
from spinfilters.verdict.judge import judge
from spinfilters.verdict.model_tests import tested_epochs, tested_history, tested_models
from spinfilters.verdict.recording_tests import front_end_slips, pose_findings, wrong_units
from spinfilters.verdict.refits import (
    DoubtedMotion,
    with_camera_refit,
    with_flywheel_refit,
    with_hinge_refit,
    with_later_begin,
)
from spinfilters.verdict.tested_models import NOT_TESTED, TestedModels, model_findings

MotionFindings = Callable[[Setup, Settings], Sequence[Finding]]
"""Findings about what the motion leaves undetermined, as `motion_diagnostics`."""


def shared_diagnostics(setup: Setup) -> list[Finding]:
    """Findings that concern every estimator of a run."""
    found = [*setup.initial.status.findings, *(Finding("data-set", text) for text in setup.dataset.doubts)]
    found += [*_moving_camera(setup), *pose_findings(setup)]
    noise = setup.gyro_noise
    if noise is not None and not noise.is_of_flight:
        numbers = {"percent": 100 * noise.relative_error, "limit": 100 * LARGEST_ERROR}
        found.append(finding("not-a-free-flight", numbers))
    for stream in setup.dataset.log.streams:
        found += [Finding("sensor-data", text) for text in sensor_of(stream.sensor).diagnostics(stream)]
    return found


def _moving_camera(setup: Setup) -> list[Finding]:
    """Finding that a camera assumed at rest may move; none where the initialisation converged."""
    initial, dataset = setup.initial, setup.dataset
    is_at_rest = dataset.rig is not None and dataset.inspector is None
    if not is_at_rest or initial.converged or not initial.momentum_residual > MOST_MOMENTUM:
        return []
    return [finding("camera-may-move", {"percent": 100 * initial.momentum_residual})]


def filter_diagnostics(setup: Setup) -> list[Finding]:
    """Findings that concern filters alone: a smoother revises its first epochs."""
    if setup.initial.has_failed:
        return []
    std, count = setup.initial.moments_std, len(setup.initial.mean)
    if not std <= DETERMINED_STD:
        return [finding("vague-initialisation", {"epochs": count, "std": std})]
    return []


@dataclass(frozen=True)
class Doubts:
    """Doubts about the estimators of one run.

    Attributes
    ----------
    shared : list[Finding]
        About every estimator.
    of_filters : list[Finding]
        About those that continue from the initialisation, without a smoother.
    smoother : EstimateHistory or None
        Smoother with which filters are compared, None where there is none.
    models : TestedModels
        Tests of the models' errors.
    baselines : Collection[str]
        Names of others' estimators, whose noise levels say nothing of ours.
    untested : Collection[str]
        Names of estimators whose covariances do not show wrong noise (`EstimatorEntry.tests_noise`).
    """

    setup: Setup
    settings: Settings
    evaluations: Sequence[Evaluation]
    shared: list[Finding]
    of_filters: list[Finding]
    smoother: EstimateHistory | None
    models: TestedModels = NOT_TESTED
    baselines: Collection[str] = ()
    untested: Collection[str] = ()
    _agreements: dict[str, list[Finding]] = field(default_factory=dict)
    _noise: dict[str, list[Finding]] = field(default_factory=dict)
    _levels: dict[tuple[VarianceComponent, ...], list[Finding]] = field(default_factory=dict)

    def of(self, evaluation: Evaluation, entry: AnyEntry) -> list[Finding]:
        """Doubts about one estimator."""
        agreement = self._agreement_of(evaluation) if entry.continues or entry.forgets else []
        if self.setup.is_given:
            return [*self.shared, *agreement]
        if not entry.continues:
            return [*self.shared, *self.of_levels, *agreement, *self._of_landmarks]
        silent = entry.is_baseline or evaluation.name in self.untested
        noise = [] if silent or agreement else self._noise_of(evaluation)
        levels = [] if entry.is_baseline else self._levels_of(evaluation)
        return [*self.shared, *levels, *agreement, *noise]

    @cached_property
    def of_levels(self) -> list[Finding]:
        """Doubts about levels of noise, stated or of the best estimate; none where the smoothing problem is not asked."""
        if self.settings.verdict == FILTER:
            return []
        return stated_level_diagnostics(self.setup, self.settings, self._histories)

    @cached_property
    def _histories(self) -> list[EstimateHistory]:
        """Of our own estimators, the smoother's first: it has the best states."""
        own = [each.history for each in self.evaluations if each.name not in self.baselines]
        return own if self.smoother is None else [self.smoother, *own]

    def _levels_of(self, evaluation: Evaluation) -> list[Finding]:
        """Doubts about the levels of one filter, which it has identified from the first epochs, where the smoother has others."""
        if self.of_levels or self.settings.verdict == FILTER or self.setup.initial.has_landmarks:
            return self.of_levels
        best, used = finished_history(self._histories), evaluation.history.noise
        if best is None or used == best.noise:
            return self.of_levels
        if used not in self._levels:  # filters of one run share theirs
            found = stated_level_diagnostics(self.setup, self.settings, [replace(best, noise=used)])
            self._levels[used] = found
        return self._levels[used]

    @cached_property
    def _of_landmarks(self) -> list[Finding]:
        """Noise findings of the first filter that agrees with a landmark smoother, for both have the same noise."""
        if not self.setup.initial.has_landmarks:
            return []
        for each in self.evaluations:
            if each.name not in (SMOOTHER, *self.untested) and not self._agreement_of(each):
                return self._noise_of(each)
        return []

    def _agreement_of(self, evaluation: Evaluation) -> list[Finding]:
        """Agreement with the smoother, asked once of a filter."""
        if evaluation.name not in self._agreements:
            self._agreements[evaluation.name] = agreement_diagnostics(
                evaluation, self.smoother, self.of_filters
            )
        return self._agreements[evaluation.name]

    def _noise_of(self, evaluation: Evaluation) -> list[Finding]:
        """Noise doubts from a filter's own epochs, where nothing has been said yet."""
        if self._levels_of(evaluation):
            return []
        if evaluation.name not in self._noise:
            found = filter_noise_diagnostics(evaluation.history, self.setup, self.settings)
            self._noise[evaluation.name] = found
        return self._noise[evaluation.name]


def doubts_of(
    evaluations: Sequence[Evaluation],
    setup: Setup,
    settings: Settings,
    baselines: Collection[str] = (),
    untested: Collection[str] = (),
    motion_findings: MotionFindings = motion_diagnostics,
) -> Doubts:
    """The doubts of a run, as far as they are the same for several estimators.

    A given initialisation means that filters alone are studied, by the thousand: their innovations are the only evidence, and the
    smoother where the belief is too wide for a linearisation.
    """
    if setup.is_given:
        shared, own, reference = shared_diagnostics(setup), filter_diagnostics(setup), None
        if settings.verdict == FILTER:
            shared.append(finding("smoothed-checks-left-out", {}))
        else:
            reference = reference_smoother([], setup, settings)
        return Doubts(setup, settings, evaluations, shared, own, reference, NOT_TESTED, baselines, untested)
    smoothers = [each.history for each in evaluations if each.name == SMOOTHER]
    shared = [*shared_diagnostics(setup), *motion_findings(setup, settings)]
    if settings.verdict == FILTER:
        models = models_of_recording(setup)
        tested, reference = None, finished_history(smoothers)
        shared.append(finding("smoothed-checks-left-out", {}))
    else:
        tested = tested_history(setup, evaluations)
        models = _test_models(setup, settings, tested)
        reference = reference_smoother(smoothers, setup, settings)
    shared += [*model_findings(models, tested), *measurement_findings(smoothers, evaluations)]
    own = filter_diagnostics(setup)
    return Doubts(setup, settings, evaluations, shared, own, reference, models, baselines, untested)


def _stated_std(
    setup: Setup, best: EstimateHistory | None, models: TestedModels
) -> Float[np.ndarray, "k n"] | None:
    """Deviations of the tested epochs as a verdict states them (`TestedModels.stated_std`)."""
    if best is None or models.std is None:
        return None
    variance = models.std**2
    if best.calibration is not None:
        times = _calibration_enlargements(setup, models)
        variance = variance + (best.calibration[: len(variance)] ** 2) @ (times**2 - 1)
    for error in _possible_errors(models, len(variance)):
        variance = variance + error**2
    return np.sqrt(variance)


def _possible_errors(models: TestedModels, epochs: int) -> Iterator[Float[np.ndarray, "k n"]]:
    """Errors by the drift of a clock and by possible contacts, at the first epochs; those beyond the tested ones know of none."""
    drift = () if models.clock_drift is None else (models.clock_drift,)
    for error in (*drift, *models.possible_contacts):
        counted = np.zeros((epochs, error.shape[1]))
        counted[: len(error)] = error[:epochs]
        yield counted


def _calibration_enlargements(setup: Setup, models: TestedModels) -> Float[np.ndarray, " c"]:
    return enlargements([each for each in setup.calibration if each.std > 0], models.tests)


def models_of_recording(setup: Setup) -> TestedModels:
    """Errors that the recording shows by itself, without a smoothed motion: wrong units, and slips of front ends."""
    slips = front_end_slips(setup, with_fits=False)
    return replace(NOT_TESTED, units=tuple(wrong_units(setup.dataset)), slips=slips)


def _test_models(setup: Setup, settings: Settings, best: EstimateHistory | None) -> TestedModels:
    """Score tests about the best estimate, with slips of front ends; fits of a flywheel and of a camera where any is suspected.

    None of measurements that their own front end doubts: wrong poses look like contact, and no other cause is named before that
    one is mended.
    """
    if setup.dataset.doubts:
        return models_of_recording(setup)
    models = tested_models(setup, best)
    drift = None if best is None else possible_clock_drift(setup, best, models)
    models = replace(models, clock_drift=drift, solved=None)  # large, and not needed beyond
    models = replace(models, stated_std=_stated_std(setup, best, models))
    is_suspect = models.is_suspect or best is None or best.status.verdict is not Verdict.OK
    models = replace(models, slips=front_end_slips(setup, with_fits=is_suspect))
    if not models.slips:
        models = with_later_begin(models, setup, settings)
    if best is None or not is_suspect or models.slips or models.later_begin is not None:
        return models
    motion = DoubtedMotion(setup, best.mean[: tested_epochs(setup)])
    models = with_hinge_refit(with_flywheel_refit(models, settings, motion), motion)
    return with_camera_refit(models, motion)


def measurement_findings(
    smoothers: Sequence[EstimateHistory], evaluations: Sequence[Evaluation]
) -> list[Finding]:
    """Findings about a recording's measurements, the same for all of its estimators.

    Of the smoother, which sees all measurements at once; without one, of the estimator that leaves out fewest. What another one
    leaves out more is its own failing.
    """
    histories = [*smoothers] or [each.history for each in evaluations]
    finished = [each for each in histories if not each.has_failed]
    if not finished:
        return []
    best = min(finished, key=lambda each: int(each.rejected[each.own].sum()))
    numbers = rejected_share(best)
    return [] if numbers is None else [finding(LEFT_OUT, numbers)]


def evaluated(history: EstimateHistory, setup: Setup) -> Evaluation:
    """A history of this data set, with its errors where there is a truth."""
    alignment = Alignment.NONE if setup.known_frames else Alignment.FIRST_FRAME
    observed = replace(history, observations=setup.observations[: len(history.time)])
    return evaluate(observed, setup.dataset.truth, alignment)


def with_verdicts(doubts: Doubts, settings: Settings, entries: Mapping[str, AnyEntry]) -> list[Evaluation]:
    """Evaluations with their verdicts, for estimators of a table of entries by name."""
    setup = doubts.setup
    widened = {each.name: _widen_evaluation(each, doubts) for each in doubts.evaluations}
    peers = [each for each in widened.values() if not entries[each.name].is_baseline]
    others = not_failed(peers)
    found = []
    for evaluation in doubts.evaluations:
        entry, wider = entries[evaluation.name], widened[evaluation.name]
        evidence = Evidence(
            wider,
            others,
            entry.false_alarm_probability(setup, settings),
            [*doubts.of(evaluation, entry), *_explain_undetermined(evaluation, wider, doubts)],
            _centre_prior_std(setup),
            0.0 if entry.is_baseline else expected_nis(setup),
            setup.log.streams,
        )
        found.append(wider.with_status(judge(evidence)))
    return found


def _widen_evaluation(evaluation: Evaluation, doubts: Doubts) -> Evaluation:
    """With covariances that hold with possibly correlated errors, and with possible ones of the calibration."""
    setup, history = doubts.setup, evaluation.history
    if history.has_failed or history.layout != setup.process.layout:
        return evaluation
    widening = doubts.models.correlated.widening
    if widening is not None:
        history = history.widened(widening)
    if history.calibration is not None:
        times = _calibration_enlargements(setup, doubts.models)
        history = history if (times == 1).all() else history.with_larger_calibration(times)
    for error in _possible_errors(doubts.models, len(history.time)):
        if np.isfinite(error).all():
            history = history.with_calibration_error(error)
    mixture = doubts.models.correlated.mixture
    if mixture is not None:
        own = evaluation.history.last_mixture(mixture, history.calibration)
        history = replace(history, mixture=own)
    return evaluation if history is evaluation.history else evaluated(history, setup)


def _centre_prior_std(setup: Setup) -> float:
    """Standard deviation of the centre of mass before anything was measured, m; infinite without a prior of it."""
    layout, prior = setup.process.layout, setup.initial.prior
    if not layout.has(CENTRE_OF_MASS) or prior is None:
        return np.inf
    std = np.linalg.norm(prior.factor[layout.slice(CENTRE_OF_MASS.name)], axis=1).max()
    return float(std) if np.isfinite(std) else np.inf


def _explain_undetermined(evaluation: Evaluation, wider: Evaluation, doubts: Doubts) -> list[Finding]:
    """Why moments are not determined that would be, were errors surely white."""
    before, after = (float(np.max(each.body.principal_moments_std)) for each in (evaluation, wider))
    undecided = doubts.models.correlated.undecided
    return [undecided] if undecided is not None and before <= LARGEST_MOMENT_STD < after else []
