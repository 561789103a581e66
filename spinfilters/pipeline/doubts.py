"""Findings about estimates from other estimates, models and noise levels."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

from spinfilters.estimators.history import EstimateHistory
from spinfilters.evaluation.estimator_evaluation import Evaluation
from spinfilters.pipeline.diagnostics import filter_diagnostics, shared_diagnostics
from spinfilters.pipeline.estimate_diagnostics import (
    agreement_diagnostics,
    motion_diagnostics,
    reference_smoother,
)
from spinfilters.pipeline.estimator_entry import AnyEntry
from spinfilters.pipeline.flywheel_refit import with_flywheel_refit
from spinfilters.pipeline.front_end_slips import front_end_slips
from spinfilters.pipeline.model_errors import tested_epochs, tested_history, tested_models
from spinfilters.pipeline.model_findings import model_findings
from spinfilters.pipeline.noise_diagnostics import filter_noise_diagnostics
from spinfilters.pipeline.setup import Setup
from spinfilters.pipeline.smoother_run import NAME as SMOOTHER
from spinfilters.pipeline.stated_levels import stated_level_diagnostics
from spinfilters.pipeline.tested_models import NOT_TESTED, TestedModels
from spinfilters.settings.run_settings import Settings
from spinfilters.state.status import Finding, Verdict
from spinfilters.verdict.checks import finding
from spinfilters.verdict.estimate_tests import LEFT_OUT, rejected_share


@dataclass(frozen=True)
class Doubts:
    """Doubts about the estimators of one run.

    Attributes
    ----------
    shared: about every estimator.   of_filters: about those that continue from the initialisation, with no smoother beside.
    smoother: that filters are held against, None where there is none.   models: tests of the models' errors.
    baselines: names of others' estimators, whose noise levels say nothing of ours.
    """

    setup: Setup
    settings: Settings
    evaluations: Sequence[Evaluation]
    shared: list[Finding]
    of_filters: list[Finding]
    smoother: EstimateHistory | None
    models: TestedModels = NOT_TESTED
    baselines: Collection[str] = ()
    _agreements: dict[str, list[Finding]] = field(default_factory=dict)
    _noise: dict[str, list[Finding]] = field(default_factory=dict)

    def of(self, evaluation: Evaluation, entry: AnyEntry) -> list[Finding]:
        """Doubts about one estimator."""
        if self.setup.is_given:
            own = self._agreement_of(evaluation) if entry.continues else []
            return [*self.shared, *own]
        if not entry.continues:
            return [*self.shared, *self.of_levels, *self._of_landmarks]
        agreement = self._agreement_of(evaluation)
        noise = [] if entry.is_baseline or agreement else self._noise_of(evaluation)
        levels = [] if entry.is_baseline else self.of_levels
        return [*self.shared, *levels, *agreement, *noise]

    @cached_property
    def of_levels(self) -> list[Finding]:
        """Doubts about stated levels of noise."""
        own = [each.history for each in self.evaluations if each.name not in self.baselines]
        first = [] if self.smoother is None else [self.smoother]
        return stated_level_diagnostics(self.setup, self.settings, [*first, *own])

    @cached_property
    def _of_landmarks(self) -> list[Finding]:
        """Doubts about noise by the first filter beside a landmark smoother.

        What it says of the noise that both are told, if they agree.
        """
        if not self.setup.initial.has_landmarks:
            return []
        for each in self.evaluations:
            if each.name != SMOOTHER and not self._agreement_of(each):
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
        if self.of_levels:
            return []
        if evaluation.name not in self._noise:
            found = filter_noise_diagnostics(evaluation.history, self.setup, self.settings)
            self._noise[evaluation.name] = found
        return self._noise[evaluation.name]


def doubts_of(
    evaluations: Sequence[Evaluation], setup: Setup, settings: Settings, baselines: Collection[str] = ()
) -> Doubts:
    """The doubts of a run, as far as they are the same for several estimators.

    A given initialisation means that filters alone are studied, by the thousand: what their innovations tell is all, and the
    smoother where the belief is too wide for a linearisation.
    """
    if setup.is_given:
        shared, reference = shared_diagnostics(setup), reference_smoother([], setup, settings)
        own = filter_diagnostics(setup)
        return Doubts(setup, settings, evaluations, shared, own, reference, baselines=baselines)
    smoothers = [each.history for each in evaluations if each.name == SMOOTHER]
    models = _explained(setup, settings, evaluations)
    return Doubts(
        setup,
        settings,
        evaluations,
        [
            *shared_diagnostics(setup),
            *motion_diagnostics(setup, settings),
            *model_findings(models, tested_history(setup, evaluations)),
            *measurement_findings(smoothers, evaluations),
        ],
        filter_diagnostics(setup),
        reference_smoother(smoothers, setup, settings),
        models,
        baselines,
    )


def _explained(setup: Setup, settings: Settings, evaluations: Sequence[Evaluation]) -> TestedModels:
    """Score tests of the models, with slips of front ends, and a flywheel fitted where anything is suspected."""
    models, best = tested_models(setup, evaluations), tested_history(setup, evaluations)
    is_suspect = models.is_suspect or best is None or best.status.verdict is not Verdict.OK
    models = replace(models, slips=front_end_slips(setup, with_fits=is_suspect))
    if best is None or not is_suspect or models.slips:
        return models
    return with_flywheel_refit(models, setup, settings, best.mean[: tested_epochs(setup)])


def measurement_findings(
    smoothers: Sequence[EstimateHistory], evaluations: Sequence[Evaluation]
) -> list[Finding]:
    """Findings about a recording's measurements, the same for all of its estimators.

    Of the smoother, which sees all measurements at once; without one, of the estimator that leaves out fewest. What another one
    leaves out more is its own failing.
    """
    histories = [*smoothers] or [each.history for each in evaluations]
    finished = [each for each in histories if each.status.verdict is not Verdict.FAILED]
    if not finished:
        return []
    best = min(finished, key=lambda each: int(each.rejected[each.own].sum()))
    numbers = rejected_share(best)
    return [] if numbers is None else [finding(LEFT_OUT, numbers)]
