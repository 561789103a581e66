"""Counts of a front end's losses by cause."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass
class LossCount:
    """Counts by stage and cause; ``kept`` is what went on.

    Attributes
    ----------
    lost: of (stage, cause).   kept: of a stage.
    """

    lost: Counter[tuple[str, str]] = field(default_factory=Counter)
    kept: Counter[str] = field(default_factory=Counter)

    def lose(self, stage: str, cause: str, count: int = 1) -> None:
        """Count what was lost."""
        if count:
            self.lost[stage, cause] += int(count)

    def keep(self, stage: str, count: int = 1) -> None:
        """Count what went on."""
        self.kept[stage] += int(count)

    def add(self, other: "LossCount") -> None:
        """Add the counts of another."""
        self.lost += other.lost
        self.kept += other.kept

    @property
    def document(self) -> dict[str, Mapping[str, int | Mapping[str, int]]]:
        """Counts by stage: how many were kept, and how many lost by cause."""
        stages = dict.fromkeys([*self.kept, *(stage for stage, _ in self.lost)])
        return {
            stage: {
                "kept": self.kept[stage],
                "lost": {cause: count for (of, cause), count in self.lost.items() if of == stage},
            }
            for stage in stages
        }

    def sentences(self) -> list[str]:
        """A line per stage."""
        lines = []
        for stage, counts in self.document.items():
            lost = counts["lost"]
            assert isinstance(lost, Mapping)
            causes = ", ".join(f"{count} {cause}" for cause, count in lost.items())
            lines.append(f"{stage}: {counts['kept']} kept" + (f"; lost: {causes}" if causes else ""))
        return lines
