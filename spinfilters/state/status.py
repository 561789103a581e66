"""Status of an estimate: a verdict with its reasons."""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum


class Verdict(StrEnum):
    """Verdict on an estimate."""

    OK = "ok"
    DEGRADED = "degraded"
    FAILED = "failed"


@dataclass(frozen=True)
class EstimatorStatus:
    """A verdict and the reasons for anything but ``ok``, each a sentence with its numbers."""

    verdict: Verdict = Verdict.OK
    reasons: tuple[str, ...] = ()

    def degraded(self, reason: str) -> "EstimatorStatus":
        """This status with one more reason for doubt; a failure stays a failure."""
        verdict = Verdict.FAILED if self.verdict is Verdict.FAILED else Verdict.DEGRADED
        return EstimatorStatus(verdict, (*self.reasons, reason))

    def failed(self, reason: str) -> "EstimatorStatus":
        """This status as a failure for this reason."""
        return EstimatorStatus(Verdict.FAILED, (*self.reasons, reason))


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
