"""All doubts about the estimates of a run that more than their own numbers tell."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

from spinfilters.estimators.history import EstimateHistory
from spinfilters.evaluation.evaluation import Evaluation
from spinfilters.pipeline.diagnostics import filter_diagnostics, shared_diagnostics
from spinfilters.pipeline.estimate_diagnostics import (
    agreement_diagnostics,
    motion_diagnostics,
    reference_smoother,
)
from spinfilters.pipeline.estimator_entry import AnyEntry
from spinfilters.pipeline.model_errors import NOT_TESTED, TestedModels, tested_models
from spinfilters.pipeline.noise_diagnostics import filter_noise_diagnostics, smoother_noise_diagnostics
from spinfilters.pipeline.setup import Setup
from spinfilters.pipeline.smoother_run import NAME as SMOOTHER
from spinfilters.settings.run_settings import Settings


@dataclass(frozen=True)
class Doubts:
    """Of one run.

    Attributes
    ----------
    shared: about every estimator.   of_filters: about those that continue from the initialisation.
    smoother: that filters are held against, None where there is none.   models: tests of the models' errors.
    """

    setup: Setup
    settings: Settings
    evaluations: Sequence[Evaluation]
    shared: list[str]
    of_filters: list[str]
    smoother: EstimateHistory | None
    models: TestedModels = NOT_TESTED

    def of(self, evaluation: Evaluation, entry: AnyEntry) -> list[str]:
        """About one estimator."""
        if self.setup.is_given:
            return [*self.shared, *(self.of_filters if entry.continues else [])]
        if not entry.continues:
            own = smoother_noise_diagnostics(evaluation.history, self.setup, self.settings)
            return [*self.shared, *own, *self._of_landmarks]
        agreement = agreement_diagnostics(evaluation, self.smoother)
        noise = [] if entry.is_baseline or agreement else self._noise(evaluation)
        return [*self.shared, *self.of_filters, *agreement, *noise]

    @cached_property
    def _of_landmarks(self) -> list[str]:
        """What the first filter beside a smoother of landmarks says of the noise that both are told, if they agree."""
        if not self.setup.initial.has_landmarks:
            return []
        for each in self.evaluations:
            if each.name != SMOOTHER and not agreement_diagnostics(each, self.smoother):
                return self._noise(each)
        return []

    def _noise(self, evaluation: Evaluation) -> list[str]:
        return filter_noise_diagnostics(evaluation.history, self.setup, self.settings)


def doubts_of(evaluations: Sequence[Evaluation], setup: Setup, settings: Settings) -> Doubts:
    """The doubts of a run, as far as they are the same for several estimators.

    Where the initialisation was given, filters alone are studied, by the thousand: what their innovations tell is all.
    """
    if setup.is_given:
        return Doubts(
            setup, settings, evaluations, shared_diagnostics(setup), filter_diagnostics(setup), None
        )
    smoothers = [each.history for each in evaluations if each.name == SMOOTHER]
    models = tested_models(setup, evaluations)
    return Doubts(
        setup,
        settings,
        evaluations,
        [
            *shared_diagnostics(setup),
            *motion_diagnostics(setup, settings),
            *models.reasons,
        ],
        filter_diagnostics(setup),
        reference_smoother(smoothers, setup, settings),
        models,
    )
