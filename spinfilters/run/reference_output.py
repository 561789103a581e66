"""What a run folder holds of a reference: numbers, tables and pictures of every estimator against it.

Nothing about a reference ends a run: what cannot be compared is a sentence in its file.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from spinfilters.core.errors import NUMERICAL_ERRORS, InputError, numerical
from spinfilters.core.linear_algebra import at_times
from spinfilters.evaluation.reference_comparison import ReferenceComparison, compare_with_reference
from spinfilters.filters.history import EstimateHistory
from spinfilters.io.input_file import reason
from spinfilters.io.output_files import write_json
from spinfilters.io.reference_motion import (
    ReferenceMotion,
    read_reference,
    relative_reference,
)
from spinfilters.io.text_table import write_csv
from spinfilters.run.array_files import finite_document
from spinfilters.run.run_folder import REFERENCE_FILE, REFERENCE_TABLE, reference_pictures

SCHEMA: Final = 1
COLUMNS: Final = (
    "time_s",
    *(f"{kind}_{name}{axis}" for name in ("r", "v") for kind in ("estimate", "reference") for axis in "xyz"),
    *("angle_before_rad", "angle_rad"),
)


def chosen_reference(path: str, inspector: str | None, shares: Sequence[str]) -> ReferenceMotion:
    """Reference of a file, or of two: a target's motion as an inspector's body axes see it. InputError: as `read_reference`."""
    reference = read_reference(Path(path), shares)
    if inspector is None:
        return reference
    return relative_reference(reference, read_reference(Path(inspector)))


@dataclass(frozen=True)
class ReferenceComparisons:
    """All estimators of a run against one reference.

    Attributes
    ----------
    reference : str
        Its name.
    found : mapping of str to ReferenceComparison
        By the names of the estimators.
    refused : mapping of str to str
        Why the others cannot be compared.
    """

    reference: str
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
    return ReferenceComparisons(reference.name, found, refused)


def write_reference(folder: Path, compared: ReferenceComparisons, with_figures: bool = True) -> list[str]:
    """Write `REFERENCE_FILE`, a table of each estimator, and two pictures if wanted; returns the names of the pictures.

    Raises
    ------
    InputError
        A file cannot be written.
    """
    documents = {name: {"refused": why} for name, why in compared.refused.items()}
    documents |= {name: finite_document(found.document) for name, found in compared.found.items()}
    drawn: list[str] = []
    for name, found in compared.found.items():
        _write_table(folder / name / REFERENCE_TABLE, found)
        if with_figures:
            drawn += _draw(folder, name, found)
    document = {"schema": SCHEMA, "reference": compared.reference, "estimators": documents}
    write_json(folder / REFERENCE_FILE, document)
    return drawn


def _draw(folder: Path, estimator: str, found: ReferenceComparison) -> tuple[str, str]:
    """Both pictures of an estimator's comparison; their names."""
    # Matplotlib is slow to import: a run without a reference does not wait for it.
    from spinfilters.plots.reference_figures import reference_differences_figure, reference_values_figure
    from spinfilters.plots.style import draw_figure

    values, differences = reference_pictures(estimator)
    draw_figure(lambda: reference_values_figure(found), folder / values)
    draw_figure(lambda: reference_differences_figure(found), folder / differences)
    return values, differences


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
            values = [at_times(time, each.time, block) for block in (each.estimate, each.reference)]
        columns += [column for block in values for column in block.T]
    for attitude in (found.attitude_before, found.attitude_after):
        angle = np.full(len(time), np.nan)
        if attitude is not None:
            angle = np.interp(time, attitude.time, attitude.angle)
        columns.append(angle)
    write_csv(path, COLUMNS, columns)
