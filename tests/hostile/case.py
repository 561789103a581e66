"""One hostile input: a valid folder, what is done to it, and the command that is given it."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from .changes import Change, unchanged

COMPARE = ("compare", "{in}", "-o", "{out}/run", "--estimators", "mekf")


@dataclass(frozen=True)
class Case:
    """A hostile input.

    Attributes
    ----------
    name: what is wrong, unique among all cases.
    original: the valid folder that is copied (`originals`).   change: made to the copy.
    arguments: of the command; ``{in}`` is the copy, which must stay as it is, ``{out}`` a folder to write in.
    keeps: files below the copy that must stay as they are; None for all.
    pictures: whether the figures of a run are drawn, which is most of a small run's time.
    installs: whether the folder ``site`` below the copy holds a distribution, which is on the path of modules.
    file_bytes: length at which every file that the command writes ends, as on a full disk; None for no such limit.
    """

    name: str
    original: str
    change: Change = unchanged
    arguments: Sequence[str] = COMPARE
    keeps: str | None = None
    pictures: bool = False
    installs: bool = False
    file_bytes: int | None = None

    def command(self, place: Path) -> list[str]:
        """The arguments for a case that was made in ``place``."""
        folders = {"{in}": str(place / "in"), "{out}": str(place / "out")}
        words = []
        for word in self.arguments:
            for name, folder in folders.items():
                word = word.replace(name, folder)
            words.append(word)
        return words
