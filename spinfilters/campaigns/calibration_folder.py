"""Folder of a calibration: the study that its draws belong to, and the draws as lines of JSON.

A line holds one draw with all estimators, and is written as soon as the draw is made. Lines that hold none (a kill has cut them
short, a bit has flipped) are never read, and their draws are made again. Where a seed stands twice, its last line counts.
"""

import json
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any, Final

from spinfilters.campaigns.calibration_draws import CalibrationDraw
from spinfilters.core.errors import InputError
from spinfilters.io.input_file import path_text, read_bytes, read_settings_text, reason, value_text
from spinfilters.io.output_files import write_json
from spinfilters.models.status import AXES, CENTRE, MOMENTS, RATE, Verdict

STUDY_FILE: Final = "calibration-study.json"
DRAWS_FILE: Final = "draws.jsonl"
LARGEST_FILE: Final = 1 << 30
"""Bytes of draws that are read: a hundred thousand draws of two estimators are a third of it."""
COMPONENT_COUNTS: Final = {MOMENTS: 4, AXES: 3, RATE: 3, CENTRE: 3}
ADDED_LATER: Final = frozenset({"scores", "mixture_nees"})
"""Entries of a draw that lines of earlier versions lack."""
_ORIGIN: Final = ("sensor", "noise")
"""Keys of a line that say what its draw is of; lines of earlier versions lack them."""


@dataclass(frozen=True)
class CalibrationStudy:
    """What the draws of a folder are of.

    Attributes
    ----------
    sensor : str
        Kind of recording.
    estimators : tuple of str
        Names.
    noise : str
        "stated" or "identified".
    """

    sensor: str
    estimators: tuple[str, ...]
    noise: str

    def document(self) -> dict[str, Any]:
        """As it is written."""
        return {**asdict(self), "estimators": list(self.estimators)}


def claim_folder(folder: Path, study: CalibrationStudy) -> None:
    """Write what a folder's draws are of.

    Raises
    ------
    InputError
        It holds draws of another study, or its study cannot be read.
    """
    path, drawn, wanted = folder / STUDY_FILE, folder / DRAWS_FILE, study.document()
    is_stated = path.exists()
    lines = list(_whole_lines(folder))
    if is_stated and lines and _stated_study(path) != wanted:
        raise InputError(f"{path_text(path)}: holds draws of another study; choose another folder (-o)")
    for number, line in lines:
        origin = {key: line[key] for key in _ORIGIN if key in line}
        if any(origin[key] != wanted[key] for key in origin):
            raise InputError(
                f"{path_text(drawn)}: line {number} holds a draw of {value_text(', noise '.join(map(str, origin.values())))}; "
                "choose another folder (-o)"
            )
        if not is_stated and len(origin) < len(_ORIGIN):
            raise InputError(
                f"{path_text(drawn)}: line {number} does not say of what sensor it is, and {STUDY_FILE} is missing; "
                "choose another folder (-o)"
            )
    write_json(path, wanted)


def _stated_study(path: Path) -> Any:
    try:
        return json.loads(read_settings_text(path))
    except (ValueError, RecursionError) as error:
        raise InputError(
            f"{path_text(path)}: is no JSON ({reason(error)}); remove this file and run the command again"
        ) from None


def read_draws(folder: Path, study: CalibrationStudy) -> dict[int, list[CalibrationDraw]]:
    """Draws of a folder by seed, in order of seeds; those that lack an estimator of the study are left out.

    A recording that could not be initialised has an empty list.

    Raises
    ------
    InputError
        The file cannot be read.
    """
    found = {line["seed"]: [_draw(each) for each in line["draws"]] for _, line in _whole_lines(folder)}
    asked = set(study.estimators)
    return {
        seed: draws
        for seed, draws in sorted(found.items())
        if not draws or asked <= {draw.estimator for draw in draws}
    }


def add_draw(folder: Path, study: CalibrationStudy, seed: int, draws: Sequence[CalibrationDraw]) -> None:
    """Write a draw, by all estimators, as one line after the others.

    Raises
    ------
    OSError
        It cannot be written; what was written before stays.
    """
    wanted = study.document()
    document = {"seed": seed} | {key: wanted[key] for key in _ORIGIN} | {"draws": [asdict(d) for d in draws]}
    with (folder / DRAWS_FILE).open("a+b") as file:
        if file.tell():
            file.seek(-1, 2)
            if file.read() != b"\n":
                file.write(b"\n")  # a line that was cut off stays, and is never read
        file.write(json.dumps(document).encode() + b"\n")


def _whole_lines(folder: Path) -> Iterator[tuple[int, dict[str, Any]]]:
    """Lines that hold a draw, with their numbers from 1."""
    path = folder / DRAWS_FILE
    if not path.exists():
        return
    for number, text in enumerate(read_bytes(path, LARGEST_FILE, may_be_empty=True).split(b"\n"), 1):
        try:
            line = json.loads(text)
        except (ValueError, RecursionError):
            continue
        if _holds_draw(line):
            yield number, line


def _holds_draw(line: Any) -> bool:
    if not isinstance(line, dict) or type(seed := line.get("seed")) is not int or seed < 0:
        return False
    draws = line.get("draws")
    return isinstance(draws, list) and all(_is_draw(each) and each["seed"] == seed for each in draws)


def _is_draw(document: Any) -> bool:
    """Whether it has the entries of a draw, each of its type, and of each quantity all components."""
    names = {each.name for each in fields(CalibrationDraw)}
    if not isinstance(document, dict) or not names - ADDED_LATER <= set(document) <= names:
        return False
    quantities, nees, scores = document["quantities"], document["nees"], document.get("scores", {})
    by_mixture = document.get("mixture_nees", {})
    return (
        isinstance(document["estimator"], str)
        and document["verdict"] in list(Verdict)
        and isinstance(document["determined"], bool)
        and _are_numbers([document["worst"]], 1)
        and isinstance(quantities, dict)
        and all(_are_components(quantities[name], COMPONENT_COUNTS.get(name), 3) for name in quantities)
        and isinstance(scores, dict)
        and set(scores) <= set(quantities)
        and all(_are_components(scores[name], COMPONENT_COUNTS.get(name), 2) for name in scores)
        and all(isinstance(each, dict) for each in (nees, by_mixture))
        and all(_are_numbers(list(each.values()), len(each)) for each in (nees, by_mixture))
    )


def _are_components(value: Any, count: int | None, size: int) -> bool:
    """Whether it has so many components, each of so many numbers."""
    return isinstance(value, list) and len(value) == count and all(_are_numbers(each, size) for each in value)


def _are_numbers(value: Any, count: int) -> bool:
    return (
        isinstance(value, list)
        and len(value) == count
        and all(isinstance(each, float) or (type(each) is int and abs(each) <= 2**53) for each in value)
    )


def _draw(document: dict[str, Any]) -> CalibrationDraw:
    quantities = {
        name: [(error, std, rank) for error, std, rank in components]
        for name, components in document["quantities"].items()
    }
    scores = {
        name: [(crps, log_score) for crps, log_score in components]
        for name, components in document.get("scores", {}).items()
    }
    return CalibrationDraw(**{**document, "quantities": quantities, "scores": scores})
