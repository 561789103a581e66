"""What a run folder holds of a reference: numbers, tables and pictures of every estimator against it.

Nothing about a reference ends a run: what cannot be compared is a sentence in its file.
"""

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final
from zipfile import ZIP_DEFLATED

import numpy as np
from jaxtyping import Float

from spinfilters.core.errors import NUMERICAL_ERRORS, InputError, numerical
from spinfilters.core.linear_algebra import at_times
from spinfilters.evaluation.reference_comparison import ReferenceComparison, compare_with_reference
from spinfilters.filters.history import EstimateHistory
from spinfilters.io.dataset import Dataset
from spinfilters.io.input_file import path_text, reason
from spinfilters.io.output_files import write_json
from spinfilters.io.reference_motion import (
    ReferenceMotion,
    read_reference,
    reference_of_log,
    relative_reference,
)
from spinfilters.io.text_table import write_csv
from spinfilters.run.array_files import DAMAGED, finite_document, read_arrays, unusable, write_arrays
from spinfilters.run.pictures import Pictures, draw_pictures
from spinfilters.run.readers import read_whole
from spinfilters.run.run_folder import REFERENCE_ARRAYS, REFERENCE_FILE, REFERENCE_TABLE, reference_pictures

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SCHEMA: Final = 1
TEXTS: Final = ("", ".tum", ".txt", ".csv", ".tsv", ".dat")
"""Suffixes of files that may be tables of a reference."""
CURE: Final = "run compare again with --resume --reference FILE"
WIDTHS: Final[Mapping[str, int]] = {"attitude": 4, "position": 3, "rate": 3, "velocity": 3}
"""Columns of what a reference may know."""
COLUMNS: Final = (
    "time_s",
    *(f"{kind}_{name}{axis}" for name in ("r", "v") for kind in ("estimate", "reference") for axis in "xyz"),
    *("angle_before_rad", "angle_rad"),
)


def chosen_reference(
    given: str | os.PathLike[str] | Dataset,
    inspector: str | os.PathLike[str] | Dataset | None,
    shares: Sequence[str],
) -> ReferenceMotion:
    """Reference of a recording, or of two: a target's motion as an inspector's body axes see it.

    Raises
    ------
    InputError
        As `read_reference` of a text, and `read_dataset` of any other recording.
    """
    reference = _reference_of(given, shares)
    return reference if inspector is None else relative_reference(reference, _reference_of(inspector, ()))


def _reference_of(given: str | os.PathLike[str] | Dataset, shares: Sequence[str]) -> ReferenceMotion:
    """A data set's motion; of a text leniently, as motion capture loses markers, else by the readers of recordings."""
    shared = {"shares_frame": "frame" in shares, "shares_origin": "origin" in shares}
    if isinstance(given, Dataset):
        name = "the reference" if given.path is None else path_text(given.path)
        return replace(reference_of_log(given.log, name), **shared)
    path = Path(given)
    refused: InputError | None = None
    if path.suffix.lower() in TEXTS and not path.is_dir():
        try:
            return read_reference(path, shares)
        except InputError as error:
            refused = error
    try:
        return replace(reference_of_log(read_whole(path).log, path_text(path)), **shared)
    except InputError:
        if refused is None:
            raise
        raise refused from None


@dataclass(frozen=True)
class ReferenceComparisons:
    """All estimators of a run against one reference.

    Attributes
    ----------
    reference : ReferenceMotion
        As it was read.
    found : mapping of str to ReferenceComparison
        By the names of the estimators.
    refused : mapping of str to str
        Why the others cannot be compared.
    """

    reference: ReferenceMotion
    found: Mapping[str, ReferenceComparison]
    refused: Mapping[str, str]


def compare_histories(
    histories: Sequence[EstimateHistory], reference: ReferenceMotion
) -> ReferenceComparisons:
    """Every estimator against a reference; what cannot be compared is a sentence."""
    found: dict[str, ReferenceComparison] = {}
    refused: dict[str, str] = {}
    for history in histories:
        try:
            with np.errstate(all="ignore"):
                found[history.name] = compare_with_reference(history, reference)
        except InputError as error:
            refused[history.name] = str(error)
        except NUMERICAL_ERRORS as error:
            refused[history.name] = reason(numerical(error))
    return ReferenceComparisons(reference, found, refused)


def write_reference(folder: Path, compared: ReferenceComparisons, with_figures: bool = True) -> list[str]:
    """Write `REFERENCE_FILE`, the reference itself, a table of each estimator, and two pictures if wanted; their names.

    Raises
    ------
    InputError
        A file cannot be written.
    """
    documents = {name: {"refused": why} for name, why in compared.refused.items()}
    documents |= {name: finite_document(found.document) for name, found in compared.found.items()}
    for name, found in compared.found.items():
        _write_table(folder / name / REFERENCE_TABLE, found)
    document = {"schema": SCHEMA, "reference": compared.reference.name, "estimators": documents}
    write_json(folder / REFERENCE_FILE, document)
    _write_motion(folder / REFERENCE_ARRAYS, compared.reference)
    return draw_pictures(folder, reference_figures(compared)) if with_figures else []


def reference_figures(compared: ReferenceComparisons) -> Pictures:
    """Values and differences of every estimator that could be compared."""
    # Matplotlib is slow to import: a run without a reference does not wait for it.
    from spinfilters.plots.reference_figures import reference_differences_figure, reference_values_figure

    found: dict[str, Callable[[], Figure]] = {}
    for name, comparison in compared.found.items():
        values, differences = reference_pictures(name)
        found[values] = partial(reference_values_figure, comparison)
        found[differences] = partial(reference_differences_figure, comparison)
    return found


def kept_reference(folder: Path) -> ReferenceMotion | None:
    """The reference that a run was compared with last; None without one.

    Raises
    ------
    InputError
        Its file is damaged.
    """
    path = folder / REFERENCE_ARRAYS
    if not path.exists():
        return None
    try:
        arrays = read_arrays(path)
        numbers = {name: _rows_of(arrays, name, width) for name, width in WIDTHS.items() if name in arrays}
        time, rows = np.asarray(arrays["time"], dtype=float), {len(each) for each in numbers.values()}
        if (
            time.ndim != 1
            or rows - {len(time)}
            or not (np.isfinite(time).all() and (np.diff(time) > 0).all())
        ):
            raise ValueError("its rows do not belong together")
        return ReferenceMotion(
            str(arrays["name"]),
            time,
            **numbers,
            shares_frame=bool(arrays["shares_frame"]),
            shares_origin=bool(arrays["shares_origin"]),
            left_out=tuple(map(str, arrays["left_out"])),
        )
    except DAMAGED as error:
        raise unusable(path, "reference of a run", error, CURE) from None


def _write_motion(path: Path, reference: ReferenceMotion) -> None:
    numbers = {name: getattr(reference, name) for name in ("time", *WIDTHS)}
    words = {
        "name": np.array(reference.name),
        "shares_frame": np.array(reference.shares_frame),
        "shares_origin": np.array(reference.shares_origin),
        "left_out": np.array(reference.left_out, dtype=str),
    }
    known = {name: values for name, values in numbers.items() if values is not None}
    write_arrays(path, known | words, ZIP_DEFLATED)


def _rows_of(arrays: Mapping[str, np.ndarray], name: str, width: int) -> np.ndarray:
    """Finite rows of so many numbers."""
    values = np.asarray(arrays[name], dtype=float)
    if values.ndim != 2 or values.shape[1] != width or not np.isfinite(values).all():
        raise ValueError(f"{name} is no table of {width} finite columns")
    return values


def reference_lines(document: Mapping[str, Any]) -> list[str]:
    """Lines for the terminal: fit, and the rows of Tables 6.1 and 6.2."""
    lines: list[str] = []
    for name, found in document["estimators"].items():
        if "refused" in found:
            lines.append(f"{name} against {document['reference']}: {found['refused']}")
            continue
        lines.append(f"{name} against {document['reference']}: {'; '.join(found['sentences'])}")
        for row, value in found["statistics"].items():
            scale, unit = _unit(row)
            if value["mean"] is not None:
                lines.append(
                    f"  {row:30s} mean {scale * value['mean']:10.4g} {unit:6s} std {scale * value['std']:10.4g} {unit}"
                )
    return lines


def _unit(row: str) -> tuple[float, str]:
    if "angular" in row:
        return 180 / np.pi, "deg/s"
    if "angle" in row:
        return 180 / np.pi, "deg"
    return (100.0, "cm/s") if "velocity" in row else (100.0, "cm")


def _write_table(path: Path, found: ReferenceComparison) -> None:
    """Places and angles over time on the estimate's clock; NaN where the reference has none."""
    course = found.position if found.position is not None else found.rate_after
    time = course.time
    nothing = np.full((len(time), 3), np.nan)
    columns: list[np.ndarray] = [time]
    for each in (found.position, found.velocity):
        values = [nothing.copy(), nothing.copy()]
        if each is not None:
            values = [_within(time, each.time, block) for block in (each.estimate, each.reference)]
        columns += [column for block in values for column in block.T]
    for attitude in (found.attitude_before, found.attitude_after):
        angle = nothing[:, :1] if attitude is None else _within(time, attitude.time, attitude.angle[:, None])
        columns.append(angle[:, 0])
    write_csv(path, COLUMNS, columns)


def _within(
    time: Float[np.ndarray, " k"], own: Float[np.ndarray, " n"], values: Float[np.ndarray, "n c"]
) -> Float[np.ndarray, "k c"]:
    """Columns at other times, linearly between rows at ascending times; NaN before the first and behind the last of them."""
    is_within = (time >= own[0]) & (time <= own[-1])
    return np.where(is_within[:, None], at_times(time, own, values), np.nan)
