"""What a run folder holds of a race: several inertias propagated from the last state of its first estimator."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path, PurePath
from types import MappingProxyType
from typing import Final
from zipfile import ZIP_DEFLATED

import numpy as np
from jaxtyping import Float, Int

from spinfilters.core.attitude_conversions import inverse, rotate
from spinfilters.core.errors import InputError
from spinfilters.core.polhode import validate_principal_moments
from spinfilters.evaluation.estimator_evaluation import Evaluation, not_failed
from spinfilters.evaluation.prediction_errors import (
    NamedInertia,
    PropagatedInertia,
    propagate_inertias,
    truth_in_frames_of,
)
from spinfilters.evaluation.reference_comparison import MotionInFrames, ReferenceComparison
from spinfilters.evaluation.trajectory_errors import common_stamps
from spinfilters.io.document import numbers
from spinfilters.io.input_file import path_text, read_toml, value_text
from spinfilters.io.output_files import write_json
from spinfilters.io.text_table import write_csv
from spinfilters.io.truth import Truth
from spinfilters.models.body import body_estimate
from spinfilters.plots.prediction_figures import inertia_race_figure
from spinfilters.run.array_files import DAMAGED, read_arrays, unusable, write_arrays
from spinfilters.run.pictures import Pictures, draw_pictures
from spinfilters.run.predictions import stamps_ahead
from spinfilters.run.run_folder import RACE_ARRAYS, RACE_FILE, RACE_PICTURE, RACE_TABLE

SCHEMA: Final = 1
CURE: Final = "run compare again with --resume --predict SECONDS --race NAMES"
TRUTH: Final = "truth"
TRUE_MOTION: Final = "the true motion"
KEYS: Final = ("principal_moments", "principal_axes_g", "inertia_g")


def require_inertias(names: Sequence[str], estimators: Sequence[str]) -> None:
    """Refuse names that are neither estimators of the run nor ``truth`` nor files of an inertia. Raises InputError."""
    for name in names:
        if name != TRUTH and name not in estimators:
            _read_inertia(name, np.eye(3))


def write_race(
    folder: Path,
    names: Sequence[str],
    evaluations: Sequence[Evaluation],
    seconds: float,
    references: Mapping[str, ReferenceComparison] = MappingProxyType({}),
    with_figures: bool = True,
) -> list[str]:
    """Write race.json, race.csv, race.npz and race.png; returns the names of the pictures.

    All start from the attitude and rate of the first estimator after the last measurement. They are compared with the truth where
    it goes on, else with the attitudes of a reference that does, else with the first of them.

    Raises
    ------
    InputError
        A file of an inertia cannot be used, or one of the run cannot be written.
    """
    good = not_failed(evaluations)
    if not good:
        return []
    first = good[0]
    belief, now = first.history.belief(-1), float(first.history.time[-1])
    layout = belief.layout
    attitude, rate = belief.mean[layout.mean_slice("a")], belief.mean[layout.mean_slice("w")]
    truth = truth_in_frames_of(first)
    inertias = _inertias(names, good, truth)
    if not inertias:  # of estimators that failed
        return []
    time, reference = np.r_[0.0, stamps_ahead(first.history.time, seconds, np.empty(0))], None
    for name, motion in _motions_to_compare_with(truth, references.get(first.name)):
        stamps = stamps_ahead(first.history.time, seconds, motion.time)
        rows = _rows_at(motion, np.r_[now, now + stamps])
        if rows is not None:
            chosen = motion.at(rows)
            time, reference = chosen.time - now, PropagatedInertia(name, chosen.attitude, chosen.rate)
            break
    found = propagate_inertias(inertias, attitude, rate, time)
    reference = found[0] if reference is None else reference
    compared_with = TRUE_MOTION if reference.name == TRUTH and reference is not found[0] else reference.name
    _write(folder, compared_with, time, found, reference, first.name)
    if not with_figures:
        (folder / RACE_PICTURE).unlink(missing_ok=True)  # of an earlier race
        return []
    return draw_pictures(folder, race_figures(folder))


def race_figures(folder: Path) -> Pictures:
    """The picture of a run's race; none where there was no race.

    Raises
    ------
    InputError
        Its arrays are damaged.
    """
    path = folder / RACE_ARRAYS
    if not path.exists():
        return {}
    try:
        arrays = read_arrays(path)
        time, names = np.asarray(arrays["time"], dtype=float), list(map(str, arrays["names"]))
        attitude, rate = (np.asarray(arrays[name], dtype=float) for name in ("attitude", "rate"))
        alike = attitude.shape == (len(names), len(time), 4) and rate.shape == (len(names), len(time), 3)
        if len(names) < 2 or not (alike and all(np.isfinite(each).all() for each in (time, attitude, rate))):
            raise ValueError("its rows do not belong together")
    except DAMAGED as error:
        raise unusable(path, "race of a run", error, CURE) from None
    *found, reference = map(PropagatedInertia, names, attitude, rate)
    return {RACE_PICTURE: lambda: inertia_race_figure(time, found, reference)}


def _inertias(names: Sequence[str], good: Sequence[Evaluation], truth: Truth | None) -> list[NamedInertia]:
    """The inertias of the names; of a file without axes about the principal axes of the first estimator.

    An estimator's is that of its last state, to which attitude and rate belong, not the mean of a sampled posterior.
    """
    bodies = {each.name: body_estimate(each.history.belief(-1)) for each in good}
    axes = bodies[good[0].name].principal_axes_g
    found = []
    for name in names:
        if name == TRUTH:
            if truth is None or truth.principal_moments is None or truth.principal_axes_g is None:
                raise InputError(
                    "--race truth needs moments and axes of the truth; give principal_moments and principal_axes_g in truth.toml"
                )
            found.append(NamedInertia(name, truth.principal_moments, truth.principal_axes_g))
        elif name in bodies:
            found.append(NamedInertia(name, bodies[name].principal_moments, bodies[name].principal_axes_g))
        elif Path(name).exists():
            found.append(_read_inertia(name, axes))
    return found


def _read_inertia(name: str, axes: Float[np.ndarray, "3 3"]) -> NamedInertia:
    """The inertia of a TOML file with `KEYS`; moments without axes are in ascending order about the given ones."""
    path = Path(name)
    if not path.is_file():
        raise InputError(
            f"--race {value_text(name)} is no estimator of the run and no file; give estimators, truth or TOML files with "
            f"{', '.join(KEYS)}"
        )
    document = read_toml(path)
    unknown = [key for key in document if key not in KEYS]
    if unknown or ("inertia_g" in document) == ("principal_moments" in document):
        raise InputError(
            f"{path_text(path)}: give principal_moments (and principal_axes_g), or inertia_g, three rows in axes g"
        )
    if "inertia_g" in document:
        J = numbers(path, "inertia_g", document["inertia_g"], (3, 3))
        if not np.allclose(J, J.T, rtol=1e-6, atol=1e-9 * np.abs(J).max()):
            raise InputError(f"{path_text(path)}: inertia_g is not symmetric; correct it")
        moments, vectors = np.linalg.eigh((J + J.T) / 2)
        axes = vectors.T * np.sign(np.linalg.det(vectors))
    else:
        moments = numbers(path, "principal_moments", document["principal_moments"], (3,))
        if "principal_axes_g" in document:
            axes = numbers(path, "principal_axes_g", document["principal_axes_g"], (3, 3))
            if not np.allclose(axes @ axes.T, np.eye(3), atol=1e-4) or np.linalg.det(axes) < 0:
                raise InputError(
                    f"{path_text(path)}: principal_axes_g are not right-handed unit axes; give them as rows"
                )
        else:
            moments = np.sort(moments)
    try:
        return NamedInertia(path.stem, validate_principal_moments(moments), axes)
    except InputError as error:
        raise InputError(f"{path_text(path)}: {error}") from None


def _motions_to_compare_with(
    truth: Truth | None, compared: ReferenceComparison | None
) -> Iterator[tuple[str, MotionInFrames]]:
    """The truth, then the reference, each with its name, in the frames of the first estimator."""
    if truth is not None:
        yield TRUTH, MotionInFrames(truth.time, truth.q_ig, rotate(inverse(truth.q_ig), truth.rate_i))
    found = None if compared is None else compared.motion_in_estimate_frames()
    if compared is not None and found is not None:
        yield PurePath(compared.reference.name).name, found


def _rows_at(motion: MotionInFrames, time: Float[np.ndarray, " k"]) -> Int[np.ndarray, " m"] | None:
    """Rows of a motion at the times, s; None where it has fewer than two of them."""
    try:
        _, rows = common_stamps(time, motion.time)
    except InputError:
        return None
    return rows if len(rows) >= 2 else None


def _write(
    folder: Path,
    compared_with: str,
    time: Float[np.ndarray, " k"],
    found: Sequence[PropagatedInertia],
    reference: PropagatedInertia,
    state: str,
) -> None:
    names, columns, document = ["ahead_s"], [time], {}
    for each in found:
        angle, rate = each.angle_from(reference.attitude), each.rate_from(reference.rate)
        names += [f"{each.name}_angle_rad", f"{each.name}_rate_rad_s"]
        columns += [angle, rate]
        document[each.name] = {
            "angle_end_rad": float(angle[-1]),
            "angle_largest_rad": float(angle.max()),
            "rate_end_rad_s": float(rate[-1]),
            "rate_largest_rad_s": float(rate.max()),
        }
    write_csv(folder / RACE_TABLE, names, columns)
    every = (*found, reference)
    write_arrays(
        folder / RACE_ARRAYS,
        {
            "time": time,
            "names": np.array([each.name for each in every]),
            "attitude": np.stack([each.attitude for each in every]),
            "rate": np.stack([each.rate for each in every]),
        },
        ZIP_DEFLATED,
    )
    write_json(
        folder / RACE_FILE,
        {
            "schema": SCHEMA,
            "state": state,
            "compared_with": compared_with,
            "seconds": float(time[-1]),
            "inertias": document,
        },
    )
