"""Damaged run folders, given to ``plot`` and to ``compare --resume``."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from .case import Case
from .changes import Change, bytes_of, content

RUN_FILES = ("summary.json", "config.toml", "mekf/history.npz", "dataset/gyro.csv", "mekf/prediction.npz")


def _damages(name: str) -> dict[str, Change]:
    def remade(path: Path) -> None:
        path.unlink()
        path.mkdir()

    return {
        "missing": lambda folder: (folder / name).unlink(),
        "empty": content(name, b""),
        "cut off": bytes_of(name, lambda data: data[: len(data) // 2]),
        "with changed bytes": bytes_of(name, lambda data: data[:200] + bytes(9) + data[209:]),
        "of other text": content(name, "{}\n"),
        "a folder": lambda folder: remade(folder / name),
        "nested without end": content(name, "[" * 100_000),
        "not UTF-8": content(name, b"\xff\xfe{"),
    }


HISTORIES: dict[str, tuple[str, float]] = {
    "means of NaN": ("mean", np.nan),
    "means of 1e300": ("mean", 1e300),
    "means of zero": ("mean", 0.0),
    "factors of NaN": ("factor", np.nan),
    "factors of 1e300": ("factor", 1e300),
    "times of NaN": ("time", np.nan),
    "times of -1": ("time", -1.0),
    "an infinite NIS": ("nis", np.inf),
    "negative counts": ("dof", -5),
}
"""An array of a history, and what its second half becomes."""


def _spoiled(name: str, array: str, value: float) -> Change:
    """Change the second half of an array."""

    def change(folder: Path) -> None:
        with np.load(folder / name) as file:
            arrays = dict(file)
        arrays[array] = arrays[array].copy()
        arrays[array].flat[arrays[array].size // 2 :] = value
        np.savez(folder / name, **arrays)  # pyright: ignore[reportArgumentType]

    return change


SUMMARIES = {
    "estimators a list": ('"estimators": {', '"estimators": [], "old": {'),
    "start of words": ('"end_s":', '"end_s": "x", "old_s":'),
    "start of NaN": ('"end_s":', '"end_s": NaN, "old_s":'),
    "schema of 400 digits": ('"schema": 1', f'"schema": {"9" * 400}'),
    "an estimator that climbs": ('"mekf": {', '"../../in": {'),
    "blocks of numbers": ('"blocks": [', '"blocks": [1, '),
}


def run_cases() -> Iterator[Case]:
    """Damaged runs, in a folder that the command may write to: a copy of the run in the input."""
    plot = ("plot", "{in}/run")
    resume = ("compare", "{in}/data", "--estimators", "mekf", "--resume", "--predict", "1", "-o", "{in}/run")
    for name in RUN_FILES:
        for what, change in _damages(f"run/{name}").items():
            for command in (plot, resume):
                yield Case(
                    f"{command[0]} run, {name}: {what}", "run", change, command, "data", command is plot
                )
    for what, (array, value) in HISTORIES.items():
        for command in (plot, resume):
            change = _spoiled("run/mekf/history.npz", array, value)
            yield Case(
                f"{command[0]} run, history.npz: {what}", "run", change, command, "data", command is plot
            )
    for what, (old, new) in SUMMARIES.items():
        change = bytes_of("run/summary.json", lambda data, old=old, new=new: _swapped(data, old, new))
        for command in (plot, resume):
            yield Case(
                f"{command[0]} run, summary.json: {what}", "run", change, command, "data", command is plot
            )


def _swapped(data: bytes, old: str, new: str) -> bytes:
    assert old.encode() in data
    return data.replace(old.encode(), new.encode(), 1)
