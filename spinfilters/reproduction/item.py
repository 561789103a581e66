"""One numbered table or figure of a source: what is printed, what this package computes, what is possible, and why they differ.

An item is a function that makes an `ItemResult`: rows of numbers, figures and tables. It stands in one file with what it needs; the
tuple in `items.py` names it. A row that is compared with a printed number ends ``agrees``, ``better`` or ``differs``, and one that
differs says why, with a number. Where the source prints a picture or words, a row ends ``consistent``; where its number was put
into the simulation, ``input``: neither counts as agreement.
"""

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from typing import Final

from matplotlib.figure import Figure

from spinfilters.core.errors import InputError

TWEDDLE: Final[str] = "Tweddle 2013"
DECOUST: Final[str] = "Decoust 2008"
NO_ESTIMATE: Final[str] = "no estimate"
"""What a row without a bound says: a number that nothing random enters."""
NO_BOUND_OF_ERRORS: Final[str] = "in deviations: 1 on average"
"""Bound of an error over its stated deviation."""


class Agreement(Enum):
    """How our number compares with the printed one."""

    AGREES = "agrees"
    BETTER = "better"
    DIFFERS = "differs"
    CONSISTENT = "consistent"
    INPUT = "input"


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
    bound : float or str
        What no unbiased estimator can beat, in ``unit``; why there is none, in words, of what is not an error of an estimate.
    smaller_is_better : bool
        Whether ours of a smaller size than the printed number is better (errors, times); else a difference is a difference.
    expected : tuple of float or None
        Interval that a printed curve, a picture or the text allows, in place of ``printed``.
    why : str
        Why they differ, with the number that shows it: a slip in print, other data, a choice that the source does not state.
    given : bool
        Whether the printed number was put into what is simulated, so that ours cannot but be the same.
    """

    what: str
    ours: float
    printed: float | None = None
    unit: str = ""
    tolerance: float = 0.0
    bound: float | str = NO_ESTIMATE
    smaller_is_better: bool = False
    expected: tuple[float, float] | None = None
    why: str = ""
    given: bool = False

    def __post_init__(self) -> None:
        if (self.printed is None) == (self.expected is None):
            raise InputError(f"{self.what}: give what is printed, or the interval that a picture shows")
        if self.agreement is Agreement.DIFFERS and not self.why:
            raise InputError(f"{self.what}: {self.ours:g} differs from what is printed, and nothing says why")
        if self.why and not states_number(self.why):
            raise InputError(f'{self.what}: give a number with the cause "{self.why}"')

    @property
    def agreement(self) -> Agreement:
        """How ours compares with what is printed."""
        low, high = self.expected or (0.0, 0.0)
        if self.printed is not None:
            low, high = self.printed - self.tolerance, self.printed + self.tolerance
        slack = 1e-9 * max(abs(end) for end in (low, high, 0.0) if math.isfinite(end))
        if math.isfinite(self.ours) and low - slack <= self.ours <= high + slack:
            if self.given:
                return Agreement.INPUT
            return Agreement.AGREES if self.expected is None else Agreement.CONSISTENT
        smaller = self.smaller_is_better and abs(self.ours) < min(abs(low), abs(high))
        return Agreement.BETTER if smaller else Agreement.DIFFERS


def states_number(text: str) -> bool:
    """Whether a sentence has a number besides those of equations, figures, sections and names such as k1.

    Parameters
    ----------
    text : str
        A cause.
    """
    return re.search(r"(?<![\w.])\d", re.sub(_REFERENCES, "", text)) is not None


_REFERENCES: Final[str] = (
    r"\b(?:Tables?|Figures?|Eqs?\.|Equations?|[Ss]ections?|[Cc]hapters?|Listing|appendix|p\.)\s+(?:[A-Z]\.?)?\d[\w.-]*"
    r"(?:(?:,| and| to) (?:[A-Z]\.?)?\d[\d.-]*)*"
)


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
        """The first of differs, better, agrees, consistent and input that a row is."""
        found = {row.agreement for row in self.rows}
        return next(word for word in RANKED if word in found)


RANKED: Final = (
    Agreement.DIFFERS,
    Agreement.BETTER,
    Agreement.AGREES,
    Agreement.CONSISTENT,
    Agreement.INPUT,
)
"""Words of rows, by which of them an item is named."""


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
    short : callable or None
        Makes the same of a shorter recording or of fewer poses, for tests; None where ``make`` takes no time.
    """

    name: str
    source: str
    number: str
    title: str
    make: Callable[[], ItemResult]
    seconds: float = 1.0
    short: Callable[[], ItemResult] | None = None


def decoust_item(
    number: str,
    place: str,
    title: str,
    make: Callable[[], ItemResult],
    seconds: float = 1.0,
    short: Callable[[], ItemResult] | None = None,
) -> Item:
    """An item of Decoust (2008), named after its number: ``Figure 3.3`` is ``decoust-figure-3.3``."""
    return Item(
        f"decoust-{number.lower().replace(' ', '-')}",
        DECOUST,
        f"{number}, {place}",
        title,
        make,
        seconds,
        short,
    )


def tweddle_item(
    number: str,
    place: str,
    title: str,
    make: Callable[[], ItemResult],
    seconds: float = 1.0,
    short: Callable[[], ItemResult] | None = None,
) -> Item:
    """An item of Tweddle (2013), named after its number: ``Figure 2-6`` is ``tweddle-figure-2-6``."""
    return Item(
        f"tweddle-{number.lower().replace(' ', '-')}",
        TWEDDLE,
        f"{number}, {place}",
        title,
        make,
        seconds,
        short,
    )
