"""Counters of a live run."""

from collections import Counter
from dataclasses import dataclass, field

import numpy as np


@dataclass
class LiveSummary:
    """Counts and times of a run.

    Attributes
    ----------
    deadline: s.   latencies: s, of every answer, by the clock on the wall.   work: s of the processor that it took.
    events: of hand-overs, the smoother and losses, by name.
    """

    deadline: float
    latencies: list[float] = field(default_factory=list)
    work: list[float] = field(default_factory=list)
    events: Counter[str] = field(default_factory=Counter)

    @property
    def missed(self) -> int:
        """Answers after the deadline."""
        return sum(latency > self.deadline for latency in self.latencies)

    def document(self) -> dict[str, object]:
        """Counts and times for JSON."""
        return {
            "epochs": len(self.latencies),
            "deadline_ms": 1e3 * self.deadline,
            "deadlines_missed": self.missed,
            "latency_ms": _percentiles(self.latencies),
            "processor_ms": _percentiles(self.work),
            "events": dict(sorted(self.events.items())),
        }

    def text(self) -> str:
        """Counts and times in a few lines."""
        document = self.document()
        events = ", ".join(f"{name} {count}" for name, count in sorted(self.events.items())) or "none"
        return (
            f"{document['epochs']} epochs answered, {self.missed} after the deadline of {1e3 * self.deadline:g} ms; "
            f"latency (ms) {document['latency_ms']}, of it at work {document['processor_ms']}\n"
            f"events: {events}"
        )


def _percentiles(seconds: list[float]) -> dict[str, float | None]:
    """Percentiles in ms."""
    shares = (("median", 50), ("p99", 99), ("p99.9", 99.9), ("largest", 100))
    return {
        name: round(1e3 * float(np.percentile(seconds, share)), 3) if seconds else None
        for name, share in shares
    }
