"""Prints the smallest versions that pyproject.toml declares, for pip: ``python .ci/minimum.py > .ci/minimum.txt``."""

import re
import tomllib
from pathlib import Path


def minimum_constraints(document: dict) -> list[str]:
    """A line per package that the program or its tests need."""
    project = document["project"]
    needed = [*project["dependencies"], *project["optional-dependencies"]["test"]]
    found = (re.fullmatch(r"([A-Za-z0-9._-]+)(?:\[[^\]]*\])?>=([0-9.]+)", line) for line in needed)
    return sorted({f"{each[1].lower()}=={each[2]}" for each in found if each is not None})


if __name__ == "__main__":
    text = (Path(__file__).parents[1] / "pyproject.toml").read_text(encoding="utf-8")
    print("\n".join(minimum_constraints(tomllib.loads(text))))
