"""Status of an estimate: the verdict, its reasons, and the quantities that it holds for."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Final

OWN_STATUS: Final = "estimator-says"
"""Name of the check of what an estimator says of itself without a name of its own, as those of plug-ins do."""


class Verdict(StrEnum):
    """Verdict on an estimate."""

    OK = "ok"
    DEGRADED = "degraded"
    FAILED = "failed"


class Holds(StrEnum):
    """Whether one quantity of an estimate holds."""

    OK = "ok"
    DOUBTFUL = "doubtful"
    NOT_DETERMINED = "not determined"


@dataclass(frozen=True)
class Finding:
    """One failed check of an estimate.

    Attributes
    ----------
    check : str
        Name of the check, with what it found after a colon where it is one of several ("model-error:drag").
    sentence, cure : str
        What is the matter, and what to do about it.
    numbers : Mapping[str, float or str]
        Numbers of the sentence by name.
    about : frozenset[str] or None
        Quantities that do not hold; None leaves those of the check.
    """

    check: str
    sentence: str
    cure: str = ""
    numbers: Mapping[str, float | str] = field(default_factory=dict)
    about: frozenset[str] | None = None

    @property
    def reason(self) -> str:
        """The sentence with its cure, after a colon unless it has one already."""
        if not self.cure:
            return self.sentence
        if ": " in self.sentence:
            return f"{self.sentence}. {self.cure[0].upper()}{self.cure[1:]}"
        return f"{self.sentence}: {self.cure}"


@dataclass(frozen=True)
class EstimatorStatus:
    """A verdict, the findings that speak against ``ok``, and what holds all the same.

    Attributes
    ----------
    verdict : Verdict
    findings : tuple[Finding, ...]
    holds : Mapping[str, Holds]
        By quantity; empty of an estimate that has not been judged.
    """

    verdict: Verdict = Verdict.OK
    findings: tuple[Finding, ...] = ()
    holds: Mapping[str, Holds] = field(default_factory=dict)

    @property
    def reasons(self) -> tuple[str, ...]:
        """Reasons for anything but ``ok``, each a sentence with its numbers and its cure."""
        return tuple(each.reason for each in self.findings)

    def degraded(self, reason: str, check: str = OWN_STATUS) -> "EstimatorStatus":
        """This status with one more reason for doubt; a failure stays a failure."""
        return self.doubted(Finding(check, reason))

    def doubted(self, finding: Finding) -> "EstimatorStatus":
        """This status with one more finding; a failure stays a failure."""
        verdict = Verdict.FAILED if self.verdict is Verdict.FAILED else Verdict.DEGRADED
        return EstimatorStatus(verdict, (*self.findings, finding), self.holds)

    def failed(self, reason: str, check: str = "not-finite") -> "EstimatorStatus":
        """This status as a failure for this reason."""
        return EstimatorStatus(Verdict.FAILED, (*self.findings, Finding(check, reason)), self.holds)


def verdict_sentences(statuses: Mapping[str, EstimatorStatus]) -> list[str]:
    """A sentence per reason why estimators are not ``ok``.

    Those of the same verdict for the same reason share one.
    """
    names: dict[tuple[Verdict, str], list[str]] = {}
    for name, status in statuses.items():
        for reason in status.reasons:
            names.setdefault((status.verdict, reason), []).append(name)
    return [
        f"{', '.join(those)} {'is' if len(those) == 1 else 'are'} {verdict}: {reason}"
        for (verdict, reason), those in names.items()
    ]


POSITION: Final = "position"
ATTITUDE: Final = "attitude"
VELOCITY: Final = "velocity"
RATE: Final = "rate"
MOMENTS: Final = "moments"
AXES: Final = "axes"
CENTRE: Final = "center_of_mass"

QUANTITIES: Final = (POSITION, ATTITUDE, VELOCITY, RATE, MOMENTS, AXES, CENTRE)
"""Position of the centre of mass, attitude, velocity, body rate, principal moments and axes, centre of mass in the body."""
LABELS: Final = {name: name for name in QUANTITIES} | {CENTRE: "centre of mass"}
"""As texts call them."""
ALL: Final = frozenset(QUANTITIES)
NOTHING: Final[frozenset[str]] = frozenset()
BODY: Final = frozenset({MOMENTS, AXES})
ROTATION: Final = frozenset({ATTITUDE, RATE, MOMENTS, AXES})
TRANSLATION: Final = frozenset({POSITION, VELOCITY, CENTRE})

OF_BLOCKS: Final = {
    "t": frozenset({POSITION}),
    "a": frozenset({ATTITUDE}),
    "v": frozenset({VELOCITY}),
    "w": frozenset({RATE}),
    "c": frozenset({CENTRE, POSITION}),
    "s": BODY,
}
"""Quantities that rest on a block of the state; other blocks are results of their own."""
