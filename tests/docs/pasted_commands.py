"""Shell commands of README, docs and help texts, and the table that makes them small enough for a test."""

import re
import shlex
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
BLOCK = re.compile(r"^```(?:sh|bash|shell|console)\n(.*?)^```", re.MULTILINE | re.DOTALL)
INLINE = re.compile(r"`(spinfilters [a-z][^`]*)`")
MODULE = re.compile(r"python -m ((?:experiments|tests)(?:\.\w+)*)")


@dataclass(frozen=True)
class Rewriting:
    """What a test changes of a command that begins with some words, and why.

    Attributes
    ----------
    words: that the command begins with.   added: arguments at its end, "" to leave it out.   reason: for the reader.
    """

    words: str
    added: str | None
    reason: str


SMALL_RUN = "--estimators mekf,smoother"
REWRITINGS = (
    Rewriting(
        "make", None, "builds an environment, runs all tests, or needs a compiler for microcontrollers"
    ),
    Rewriting("dask", None, "starts a cluster"),
    Rewriting("spinfilters campaign study.toml -o runs/study --scheduler", None, "needs a cluster"),
    Rewriting("spinfilters study lags", "--seeds 1", "one recording of each motion"),
    Rewriting("spinfilters study motions", "--seeds 1", "one recording of each cell"),
    Rewriting("spinfilters study cases", "--seeds 1", "one recording of each cell"),
    Rewriting("spinfilters simulate --kind stereo-images", "--frames 2", "115 pairs of images take minutes"),
    Rewriting(
        "spinfilters simulate --kind lidar-points", "--frames 25 --interval 0.5", "a shorter recording"
    ),
    Rewriting("spinfilters simulate", "--frames 30", "a shorter recording"),
    Rewriting("spinfilters lidar scan --preset", "", "as it stands"),
    Rewriting("spinfilters lidar scan body.stl --scale", "--rays 40 40", "fewer rays"),
    Rewriting("spinfilters lidar scan", "--rays 40 40 --scans 8", "fewer scans of fewer rays"),
    Rewriting(
        "spinfilters compare images",
        "--estimators smoother --config floating.toml",
        "eight pairs do not tell a motion from a fall",
    ),
    Rewriting("spinfilters reconstruct", "--voxels 64", "a coarser volume"),
    Rewriting("spinfilters align", "--scale 0.00014", "the body of those images"),
    Rewriting("spinfilters compare tosses", "--estimators mekf", "one estimator"),
    Rewriting("spinfilters compare toss.csv", "--estimators mekf --no-figures", "one estimator"),
    Rewriting(
        "spinfilters compare recording -o runs/explained",
        f"{SMALL_RUN} --no-figures",
        "two estimators, whose tests it prints",
    ),
    Rewriting(
        "spinfilters compare recording -o runs/race", f"{SMALL_RUN} --verdict filter", "two estimators"
    ),
    Rewriting(
        "spinfilters compare circling -o runs/converging",
        "--estimators smoother --verdict filter",
        "the estimator that converges",
    ),
    *(
        Rewriting(f"spinfilters compare {words}", "--estimators mekf --verdict filter", "one estimator")
        for words in (
            *("recording -o runs/mine --predict", "recording -o runs/against"),
            "my-recording -o runs/mine --predict",
        )
    ),
    *(
        Rewriting(
            f"spinfilters compare {name}",
            f"{SMALL_RUN} --verdict filter --no-figures",
            "two estimators, few tests, no figures, which other commands draw",
        )
        for name in (
            *("biased", "fusion", "my-recording", "recording"),
            *("runs/rates", "runs/tracked", "scans/tumble"),
        )
    ),
    Rewriting("spinfilters compare", SMALL_RUN, "two estimators"),
    Rewriting("spinfilters observe", "--frames 20", "fewer epochs"),
    Rewriting("spinfilters live", "--speed 1000 --deadline-ms 10000", "faster than it was recorded"),
)
"""The first that fits is used; what none fits is run as it stands."""

PLACEHOLDERS = {
    "DATASET": "recording",
    "RECORDING": "recording",
    "DATA": "data",
    "RUN": "run",
    "FOLDER": "folder",
    "DIR": "folder",
    "TABLES": "tables",
}
"""What stands for a path in a line of prose."""


def blocks_of(page: Path) -> list[str]:
    """Commands of the shell blocks of a page, in their order, without comments."""
    text = "\n".join(BLOCK.findall(page.read_text())).replace("\\\n", " ")
    return [line for each in text.splitlines() if (line := re.sub(r"\s#.*", "", each).strip())]


def inline_of(page: Path) -> list[str]:
    """Commands of ``spinfilters`` that a page quotes in its prose."""
    outside = BLOCK.sub("", page.read_text())
    return [" ".join(each.split()) for each in INLINE.findall(outside)]


def rewriting_of(command: str) -> Rewriting | None:
    """The change that a command needs, None where it is run as it stands."""
    return next((each for each in REWRITINGS if command.startswith(each.words)), None)


def added_to(command: str, change: Rewriting | None) -> str:
    """Arguments that a test adds to a command: a command that names its estimators keeps them."""
    if change is None or change.added is None:
        return ""
    added = change.added
    for option, words in (("--estimators", SMALL_RUN), ("--no-figures", "--no-figures")):
        added = added.replace(words, "") if option in command else added
    return " ".join(added.split())


def arguments_of(command: str) -> list[str]:
    """Arguments of a quoted command, with names in the place of placeholders and optional parts included."""
    words = shlex.split(command.replace("[", "").replace("]", ""))[1:]
    return ["/".join(PLACEHOLDERS.get(part, part) for part in word.split("/")) for word in words]
