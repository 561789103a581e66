"""Interface of a figure of a run, and the table of all."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

from spinfilters.plugins import PluginGroup, by_name

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from spinfilters.pipeline.figures import FigureData


class FigureEntry(ABC):
    """A figure of the table.

    A subclass states its attributes and writes `draw`; what else it does differently it overrides.

    Attributes
    ----------
    name: as in ``run.figure(name)``, and of its PNG file.   caption: what it shows, a sentence.   order: of the table.
    """

    name: str
    caption: str
    order: int = 100

    def names(self, estimators: Sequence[str]) -> tuple[str, ...]:
        """Names of the figures in a run of these estimators.

        One, unless it draws each estimator by itself.
        """
        return (self.name,)

    def lacks(self, shown: "FigureData") -> str | None:
        """Noun for what the figure needs and a run lacks.

        None where it can be drawn.
        """
        return None

    @abstractmethod
    def draw(self, shown: "FigureData", name: str) -> "Figure":
        """The figure of one of its names."""


TABLE: Final = PluginGroup(
    "spinfilters.pipeline.figure_entries", "FIGURE", FigureEntry, group="spinfilters.figures"
)
"""All figures: those of the modules of that package, and those of the entry points ``spinfilters.figures``."""


def figure_entries() -> list[FigureEntry]:
    """All figures, in their order.

    InputError: a plug-in that cannot be loaded, a name that stands twice.
    """
    return list(by_name(TABLE, "figure").values())


def picture_files(estimators: Sequence[str]) -> list[str]:
    """Files of the figures of a run of these estimators."""
    return [f"{name}.png" for entry in figure_entries() for name in entry.names(estimators)]
