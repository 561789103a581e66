"""One check of the verdict: what is asked, of which quantities, and what is said where it fails."""

import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import TYPE_CHECKING, Final

from spinfilters.state.status import Finding, Holds

if TYPE_CHECKING:
    from spinfilters.verdict.evidence import Evidence


MOST_DIGITS: Final = 17
"""With which two different numbers are printed differently."""


class Needs(StrEnum):
    """Evidence that a check is computed from."""

    RECORDING = "the recording"
    INITIALISATION = "the first epochs, smoothed"
    ESTIMATE = "the estimate"
    FILTER = "a filter's own epochs"
    SMOOTHER = "the smoother of the same measurements"
    PEERS = "other estimators"
    RESIDUALS = "the residuals of the smoothed motion"


@dataclass(frozen=True)
class Failure:
    """What a failed test found.

    Attributes
    ----------
    numbers : Mapping[str, float or str]
        For the templates of the check.
    about : frozenset[str] or None
        Quantities that do not hold; None leaves those of the check.
    """

    numbers: Mapping[str, float | str] = field(default_factory=dict)
    about: frozenset[str] | None = None


Test = Callable[["Evidence"], Iterable[Failure]]


@dataclass(frozen=True)
class Check:
    """One reason to doubt a result.

    Attributes
    ----------
    name : str
        As summary.json and the docs call it.
    about : frozenset[str]
        Quantities that do not hold where it fails, unless its finding tells which.
    needs : Needs
        What it is computed from.
    asks : str
        The test in one sentence, with its limit.
    false_alarm : str
        Probability that it fails where nothing is wrong.
    sentence, cure : str
        Templates over the numbers of a finding.
    test : Test or None
        Outcomes of the evidence, none where all is well. None of a check that is made where its numbers arise, in readers,
        initialisation, estimators and the tests of models and noise; its findings come with the evidence.
    leaves : Holds
        What the quantities are then, doubtful or not determined.
    is_cause : bool
        Whether what it finds is certain and makes other checks fail: it is stated first, and their cures would hide it.
    """

    name: str
    about: frozenset[str]
    needs: Needs
    asks: str
    false_alarm: str
    sentence: str
    cure: str
    test: Test | None = None
    leaves: Holds = Holds.DOUBTFUL
    is_cause: bool = False

    @property
    def may_follow(self) -> bool:
        """Whether it may fail because of a cause alone: what estimates say, not what the recording itself shows."""
        speaks_of_estimate = bool(self.about) or self.leaves is Holds.NOT_DETERMINED
        return self.needs is not Needs.RECORDING and speaks_of_estimate

    def finding(
        self, numbers: Mapping[str, float | str], about: frozenset[str] | None = None, which: str = ""
    ) -> Finding:
        """Finding with these numbers.

        Parameters
        ----------
        numbers : Mapping[str, float or str]
            For the templates.
        about : frozenset[str] or None
            Quantities that do not hold; None leaves those of the check.
        which : str
            What was found, of a check that looks for several things.
        """
        name = f"{self.name}:{which}" if which else self.name
        return Finding(name, _filled(self.sentence, numbers), self.cure.format(**numbers), numbers, about)


def _filled(sentence: str, numbers: Mapping[str, float | str]) -> str:
    """A sentence with its numbers, of which those get more digits that would read like the limit which they miss."""
    limit = float(numbers.get("limit", "nan"))

    def apart(field: re.Match[str]) -> str:
        """A field with so many digits that its number is not printed as the limit."""
        value, digits = float(numbers[field[1]]), int(field[2])
        while value != limit and float(f"{value:.{digits}g}") == limit and digits < MOST_DIGITS:
            digits += 1
        return f"{{{field[1]}:.{digits}g}}"

    return re.sub(r"\{(\w+):\.(\d)g\}", apart, sentence).format(**numbers)


def base_name(finding: str) -> str:
    """Name of the check of a finding's name."""
    return finding.split(":", 1)[0]
