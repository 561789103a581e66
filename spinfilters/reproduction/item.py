"""One numbered table or figure of a source: what is printed, what this package computes, what is possible, and why they differ.

An item is a function that makes an `ItemResult`: rows of numbers, figures and tables. It stands in one file with what it needs; the
tuple in `items.py` names it. Every row ends ``agrees``, ``better`` or ``differs``, and one that differs says why.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from typing import Final

from matplotlib.figure import Figure

from spinfilters.core.errors import InputError

TWEDDLE: Final[str] = "Tweddle 2013"
DECOUST: Final[str] = "Decoust 2008"


class Agreement(Enum):
    """How our number compares with the printed one."""

    AGREES = "agrees"
    BETTER = "better"
    DIFFERS = "differs"


@dataclass(frozen=True)
class ComparedNumber:
    """One number: printed, ours, and the bound where there is one.

    Parameters
    ----------
    what : str
        The quantity, in words.
    ours : float
        What this package computes, in ``unit``.
    printed : float or None
        What the source prints; None where it prints a curve or a picture, which ``expected`` then describes.
    unit : str
        Unit of all three numbers; empty for none.
    tolerance : float
        Largest difference that still agrees: half a unit of the last printed digit, where nothing random is involved.
    bound : float or None
        What no unbiased estimator can beat, where it was computed.
    smaller_is_better : bool
        Whether ours below the printed number is better (errors, times); else a difference is a difference.
    expected : tuple of float or None
        Interval that a printed curve or picture shows, in place of ``printed``.
    why : str
        Why they differ: a slip in print, other data, a choice that the source does not state.
    """

    what: str
    ours: float
    printed: float | None = None
    unit: str = ""
    tolerance: float = 0.0
    bound: float | None = None
    smaller_is_better: bool = False
    expected: tuple[float, float] | None = None
    why: str = ""

    def __post_init__(self) -> None:
        if (self.printed is None) == (self.expected is None):
            raise InputError(f"{self.what}: give what is printed, or the interval that a picture shows")
        if self.agreement is Agreement.DIFFERS and not self.why:
            raise InputError(f"{self.what}: {self.ours:g} differs from what is printed, and nothing says why")

    @property
    def agreement(self) -> Agreement:
        """Whether ours agrees with what is printed, is better, or differs."""
        low, high = self.expected or (0.0, 0.0)
        if self.printed is not None:
            low, high = self.printed - self.tolerance, self.printed + self.tolerance
        slack = 1e-9 * max(abs(end) for end in (low, high, 0.0) if math.isfinite(end))
        if math.isfinite(self.ours) and low - slack <= self.ours <= high + slack:
            return Agreement.AGREES
        return Agreement.BETTER if self.smaller_is_better and self.ours < low else Agreement.DIFFERS


@dataclass(frozen=True)
class ItemResult:
    """What an item gives.

    Parameters
    ----------
    rows : sequence of ComparedNumber
        At least one: every item ends with a number.
    figures : mapping
        Figures by the name of their file, without an ending.
    tables : mapping
        Tables by the name of their file: a list of equally named cells per row.
    note : str
        What was simulated in place of lost data, or what the print gets wrong; empty for nothing.
    """

    rows: Sequence[ComparedNumber]
    figures: Mapping[str, Figure] = field(default_factory=dict)
    tables: Mapping[str, Sequence[Mapping[str, float | int | str]]] = field(default_factory=dict)
    note: str = ""

    def __post_init__(self) -> None:
        if not self.rows:
            raise InputError("an item of a source needs at least one row with a number")

    @property
    def agreement(self) -> Agreement:
        """The worst of the rows; better where none differs and one is better."""
        found = {row.agreement for row in self.rows}
        worst = Agreement.BETTER if Agreement.BETTER in found else Agreement.AGREES
        return Agreement.DIFFERS if Agreement.DIFFERS in found else worst


@dataclass(frozen=True)
class Item:
    """A numbered table or figure of a source.

    Parameters
    ----------
    name : str
        By which the command knows it: ``tweddle-table-1.1``.
    source : str
        ``TWEDDLE`` or ``DECOUST``.
    number : str
        As printed, with the place: ``Table 1.1, section 1.2``.
    title : str
        What it shows, in a few words.
    make : callable
        Makes the outcome.
    seconds : float
        About how long it takes on one core; what several items share counts for the first.
    """

    name: str
    source: str
    number: str
    title: str
    make: Callable[[], ItemResult]
    seconds: float = 1.0


def decoust_item(
    number: str, place: str, title: str, make: Callable[[], ItemResult], seconds: float = 1.0
) -> Item:
    """An item of Decoust (2008), named after its number: ``Figure 3.3`` is ``decoust-figure-3.3``."""
    return Item(
        f"decoust-{number.lower().replace(' ', '-')}", DECOUST, f"{number}, {place}", title, make, seconds
    )


def tweddle_item(
    number: str, place: str, title: str, make: Callable[[], ItemResult], seconds: float = 1.0
) -> Item:
    """An item of Tweddle (2013), named after its number: ``Figure 2-6`` is ``tweddle-figure-2-6``."""
    return Item(
        f"tweddle-{number.lower().replace(' ', '-')}", TWEDDLE, f"{number}, {place}", title, make, seconds
    )
