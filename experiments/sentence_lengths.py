"""Words a sentence of the documents: ``python -m experiments.sentence_lengths [FILE ...]``.

Prints median, 90th percentile and number of sentences of each page, the longest first. Code, tables and headings do not count; the
aim is a median of 16 and a 90th percentile of 28.
"""

import re
import sys
from pathlib import Path
from typing import Final

import numpy as np

from experiments.command_line import run_study

ROOT: Final = Path(__file__).parents[1]
PAGES: Final = ("README.md", "CHANGELOG.md", "docs/**/*.md", "observability/README.md")
FEWEST_WORDS: Final = 3
"""A shorter piece is no sentence."""


def sentence_lengths(text: str) -> list[int]:
    """Words of every sentence of a Markdown text."""
    text = re.sub(r"```.*?```|<!--.*?-->", "", text, flags=re.DOTALL)
    found: list[int] = []
    for block in re.split(r"\n\s*\n", text):
        lines = [line for line in block.splitlines() if not re.match(r"\s*(\||#|>|!\[|<)", line)]
        for item in re.split(r"\n\s*(?:[-*]|\d+\.)\s+", "\n" + "\n".join(lines)):
            plain = re.sub(
                r"`[^`]*`", "code", re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", " ".join(item.split()))
            )
            for sentence in re.split(r"(?<=[.!?:])\s+(?=[A-Z*(])", plain):
                count = len(re.findall(r"[A-Za-z0-9][\w'/^-]*", sentence))
                found += [count] if count >= FEWEST_WORDS else []
    return found


def main() -> None:
    """Print the table of the named pages, or of all."""
    paths = [Path(page) for page in sys.argv[1:]] or sorted(
        path for each in PAGES for path in ROOT.glob(each)
    )
    rows = []
    for path in paths:
        lengths = sentence_lengths(path.read_text(encoding="utf-8"))
        if lengths:
            middle, long = np.percentile(lengths, (50, 90))
            rows.append((middle, long, len(lengths), path))
    print("median  90 %  sentences  page")
    for middle, long, count, path in sorted(rows, reverse=True):
        print(f"{middle:6.0f} {long:5.0f} {count:10d}  {path.resolve().relative_to(ROOT)}")


if __name__ == "__main__":
    run_study(main)
