"""What an estimator is to a comparison, and the table of all of them."""

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import TYPE_CHECKING, Final

import numpy as np
from jaxtyping import Float

from spinfilters.errors import InputError
from spinfilters.plugins import PluginGroup

if TYPE_CHECKING:
    from spinfilters.estimators.estimator import Estimator
    from spinfilters.estimators.history import EstimateHistory
    from spinfilters.workflow.preparation import Prepared
    from spinfilters.workflow.settings import Settings

OnEpoch = Callable[[int, int], None]
"""Called with epochs done and epochs in all."""


class EstimatorEntry(ABC):
    """An estimator of the table. A subclass states its attributes and writes `build`; what else it does differently it overrides.

    Attributes
    ----------
    name: as in ``--estimators``; also its folder in a run.
    order: of the table and of messages.   is_default: whether a comparison has it where nobody names estimators.
    holds_landmarks: whether tracks without a known map are something for it.
    is_baseline: another's estimator to compare with, whose disagreement says nothing of ours.
    continues: whether it continues from the initialisation, so that doubts about that are doubts about it.
    """

    name: str
    order: int = 100
    is_default: bool = False
    holds_landmarks: bool = False
    is_baseline: bool = False
    continues: bool = True

    @abstractmethod
    def build(self, prepared: "Prepared", settings: "Settings") -> "Estimator | None":
        """The estimator, not begun; None where it takes all epochs at once (`at_once`)."""

    def begin(self, estimator: "Estimator", prepared: "Prepared") -> None:
        """Let it begin at the end of the initialisation."""
        estimator.start(prepared.start.belief)

    def at_once(self, prepared: "Prepared", settings: "Settings", on_epoch: OnEpoch) -> "EstimateHistory":
        """All epochs of a data set for which `build` gives none."""
        raise InputError(f"{self.name} cannot take all epochs at once; choose another estimator")

    def final(
        self, estimator: "Estimator", passed: "EstimateHistory", prepared: "Prepared"
    ) -> "EstimateHistory | None":
        """What it says in the end of all epochs, those of the initialisation among them; None where that is what it said of each
        as it came. ``passed`` holds the epochs behind the initialisation."""
        return None

    def points(
        self, estimator: "Estimator", history: "EstimateHistory", prepared: "Prepared"
    ) -> Float[np.ndarray, "k 3"] | None:
        """Landmarks that it ended with, m, frame g; None without any."""
        return prepared.map_points

    def false_alarm_probability(self, prepared: "Prepared", settings: "Settings") -> float:
        """That it leaves a measurement out although its noise is what it is said to be."""
        return 0.0


TABLE: Final = PluginGroup(
    "spinfilters.workflow.estimators", "ESTIMATOR", EstimatorEntry, group="spinfilters.estimators"
)
"""All estimators: one per module of that package, and those of the entry points ``spinfilters.estimators``."""


def estimator_entries() -> dict[str, EstimatorEntry]:
    """Entries by name, in their order. InputError: a plug-in that cannot be loaded, a name that stands twice."""
    entries = sorted(TABLE.entries, key=lambda entry: entry.order)
    names = [entry.name for entry in entries]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise InputError(f"estimator {twice!r} is registered twice; uninstall one of the plug-ins")
    return dict(zip(names, entries, strict=True))


def estimator_names() -> tuple[str, ...]:
    """Of all estimators."""
    return tuple(estimator_entries())
