"""Ground truth: trajectory (`truth.csv`) and mass properties (`truth.toml`)."""

import os
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from jaxtyping import Float, Int

from spinfilters.core.attitude_conversions import inverse, multiply, rotate
from spinfilters.core.errors import InputError, RowError, ShapeError
from spinfilters.io.document import numbers
from spinfilters.io.input_file import path_text, read_toml, require_folder, value_text
from spinfilters.io.measurement_log import (
    freeze_arrays,
    normalised,
    require_order,
    require_unit_quaternions,
)
from spinfilters.io.output_files import write_toml
from spinfilters.io.sensor_tables import require_clock
from spinfilters.io.stated_values import LENGTH, RATE, SPEED, NumberRange
from spinfilters.io.text_table import read_csv, write_csv

TRUTH_COLUMNS: Final[tuple[str, ...]] = (
    *("time_s", "rx", "ry", "rz", "qx", "qy", "qz", "qw"),
    *("vx", "vy", "vz", "wx", "wy", "wz"),
)
"""s; centre of mass in i, m; q_ig; its velocity in i, m/s; rate in i axes, rad/s."""
TRUTH_TABLE: Final[str] = "truth.csv"
TRUTH_BODY: Final[str] = "truth.toml"
TRUTH_FILES: Final = (TRUTH_TABLE, TRUTH_BODY)
"""A folder with one of them has a truth."""

_TRAJECTORY_SHAPES = {"center_of_mass": 3, "q_ig": 4, "velocity": 3, "rate_i": 3}
TRAJECTORY_FIELDS: Final[tuple[str, ...]] = tuple(_TRAJECTORY_SHAPES)
"""Arrays of a truth with a row for each stamp, besides its times."""
_BODY_RANGES = {
    "principal_moments": NumberRange(1e-9, 1e18),
    "principal_axes_g": NumberRange(-1.001, 1.001),
    "center_of_mass_g": LENGTH,
    "gyro_bias": RATE,
}
_BODY_SHAPES = {
    "principal_moments": (3,),
    "principal_axes_g": (3, 3),
    "center_of_mass_g": (3,),
    "gyro_bias": (3,),
}
BODY_KEYS: Final[tuple[str, ...]] = tuple(_BODY_SHAPES)
"""Keys of truth.toml."""
_ORTHONORMAL = 1e-6  # entries of axes printed with seven digits
_TRIANGLE = 1e-6  # relative: a flat body, whose moments satisfy A + B = C, must pass with rounding


@dataclass(frozen=True, eq=False)
class Truth:
    """True motion, and mass properties as far as they are known; arrays are copied and read-only.

    Parameters
    ----------
    time : Float[np.ndarray, ' n']
        s, strictly increasing, at least one row.
    center_of_mass : Float[np.ndarray, 'n 3']
        In i, m.
    q_ig : Float[np.ndarray, 'n 4']
        Maps g to i, scalar last, unit.
    velocity : Float[np.ndarray, 'n 3']
        Of the centre of mass in i, m/s.
    rate_i : Float[np.ndarray, 'n 3']
        Rate in i axes, rad/s (not g axes as in the state).
    principal_moments : Float[np.ndarray, '3'] | None
        Any common scale, positive, none above the sum of the others.
    principal_axes_g : Float[np.ndarray, '3 3'] | None
        Rows are the principal axes in g, so that it is R_bg; right-handed.
    center_of_mass_g : Float[np.ndarray, '3'] | None
        In g, m.
    gyro_bias : Float[np.ndarray, '3'] | None
        Constant error of a gyro's rates, g axes, rad/s.
    frame_is_fitted : bool
        Whether g is the one that fits the measurements best, as nothing else defines it.

    Raises
    ------
    InputError
        Not finite, out of order, not a unit quaternion, not a possible body.
    ShapeError
        Arrays of other shapes.
    """

    time: Float[np.ndarray, " n"]
    center_of_mass: Float[np.ndarray, "n 3"]
    q_ig: Float[np.ndarray, "n 4"]
    velocity: Float[np.ndarray, "n 3"]
    rate_i: Float[np.ndarray, "n 3"]
    principal_moments: Float[np.ndarray, "3"] | None = None
    principal_axes_g: Float[np.ndarray, "3 3"] | None = None
    center_of_mass_g: Float[np.ndarray, "3"] | None = None
    gyro_bias: Float[np.ndarray, "3"] | None = None
    frame_is_fitted: bool = False

    def __post_init__(self) -> None:
        freeze_arrays(self, ("time", *_TRAJECTORY_SHAPES, *_BODY_SHAPES))
        _check_trajectory(self)
        _check_body(self)
        object.__setattr__(self, "q_ig", normalised(self.q_ig))
        self.q_ig.setflags(write=False)

    def chosen(self, rows: slice | Int[np.ndarray, " k"]) -> "Truth":
        """The truth at some of its stamps.

        Parameters
        ----------
        rows : slice or (k,) int array
            Ascending indices of stamps.

        Returns
        -------
        Truth
            The same body, at these stamps.
        """
        return replace(self, **{name: getattr(self, name)[rows] for name in ("time", *_TRAJECTORY_SHAPES)})

    @property
    def body(self) -> dict[str, Float[np.ndarray, "..."]]:
        """Constants that are known, by name, as in truth.toml."""
        known = {name: getattr(self, name) for name in _BODY_SHAPES}
        return {name: value for name, value in known.items() if value is not None}


def truth_in_moved_frame(truth: Truth, turn: Float[np.ndarray, "4"], shift: Float[np.ndarray, "3"]) -> Truth:
    """The truth in another frame g.

    Parameters
    ----------
    turn : Float[np.ndarray, '4']
        Maps the new g to that of the truth.
    shift : Float[np.ndarray, '3']
        Origin of the new g in that of the truth, m.
    """
    axes, centre, bias = truth.principal_axes_g, truth.center_of_mass_g, truth.gyro_bias
    back = inverse(turn)
    return replace(
        truth,
        q_ig=multiply(truth.q_ig, np.broadcast_to(turn, truth.q_ig.shape)),
        principal_axes_g=None if axes is None else rotate(back, axes),
        center_of_mass_g=None if centre is None else rotate(back, centre - shift),
        gyro_bias=None if bias is None else rotate(back, bias),
    )


def read_truth(folder: Path) -> Truth:
    """Truth of a folder: `truth.csv`, and `truth.toml` if there is one.

    Raises
    ------
    InputError
        As `read_csv`, `require_clock` and `read_toml`; a truth.toml without truth.csv; an unknown key; what
        `Truth` refuses.
    """
    require_folder(folder)
    path, settings = folder / TRUTH_TABLE, folder / TRUTH_BODY
    table = read_csv(path, TRUTH_COLUMNS)
    require_clock(table)
    for columns, allowed in ((slice(1, 4), LENGTH), (slice(8, 11), SPEED), (slice(11, 14), RATE)):
        table.require(columns, allowed)
    body: dict[str, Any] = _read_body(settings) if os.path.lexists(settings) else {}
    columns = np.split(table.values, [1, 4, 8, 11], axis=1)
    try:
        time, center_of_mass, q_ig, velocity, rate_i = columns
        return Truth(time[:, 0], center_of_mass, q_ig, velocity, rate_i, **body)
    except RowError as error:
        raise table.error(error.row, error.text) from None
    except InputError as error:
        raise InputError(f"{path_text(settings)}: {error}") from None


def write_truth(truth: Truth, folder: Path) -> None:
    """Write `truth.csv`, and `truth.toml` if the body is known; reading gives the same bits. Atomic each."""
    arrays = [getattr(truth, name) for name in _TRAJECTORY_SHAPES]
    columns = [column for array in arrays for column in array.T]
    write_csv(folder / TRUTH_TABLE, TRUTH_COLUMNS, [truth.time, *columns])
    if truth.body:
        write_toml(folder / TRUTH_BODY, {name: value.tolist() for name, value in truth.body.items()})


def _read_body(path: Path) -> dict[str, Any]:
    document = read_toml(path)
    unknown = [key for key in document if key not in _BODY_SHAPES]
    if unknown:
        raise InputError(
            f"{path_text(path)}: key {value_text(unknown[0])} is unknown; use {', '.join(_BODY_SHAPES)}"
        )
    body = {key: numbers(path, key, value, _BODY_SHAPES[key]) for key, value in document.items()}
    for key, values in body.items():
        for number in values.ravel().tolist():
            _BODY_RANGES[key].require(f"{path_text(path)}: {key}: a number", number)
    return body


def _check_trajectory(truth: Truth) -> None:
    rows = truth.time.size
    if truth.time.ndim != 1 or rows == 0:
        raise ShapeError(f"truth time has shape {truth.time.shape}; it is (n,) with at least one row")
    for name, columns in _TRAJECTORY_SHAPES.items():
        array = getattr(truth, name)
        if array.shape != (rows, columns):
            raise ShapeError(f"truth {name} has shape {array.shape}, expected {(rows, columns)}")
        if not np.isfinite(array).all():
            raise InputError(f"truth {name} is not finite; leave out those rows")
    if not np.isfinite(truth.time).all():
        raise InputError("truth time is not finite; leave out those rows")
    require_order("truth", truth.time)
    require_unit_quaternions("truth", truth.q_ig)


def _check_body(truth: Truth) -> None:
    for name, value in truth.body.items():
        if value.shape != _BODY_SHAPES[name]:
            raise ShapeError(f"truth {name} has shape {value.shape}, expected {_BODY_SHAPES[name]}")
        if not np.isfinite(value).all():
            raise InputError(f"truth {name} is {value.tolist()}, not finite; correct it")
    moments, axes = truth.principal_moments, truth.principal_axes_g
    if moments is not None and (
        moments.min() <= 0.0 or 2.0 * moments.max() > moments.sum() * (1.0 + _TRIANGLE)
    ):
        raise InputError(
            f"principal_moments {moments.tolist()} belong to no body: each is positive and at most the sum "
            "of the others; correct them"
        )
    if axes is None:
        return
    if np.abs(axes @ axes.T - np.eye(3)).max() > _ORTHONORMAL or np.linalg.det(axes) < 0.0:
        raise InputError(
            f"principal_axes_g {axes.tolist()} are no right-handed unit axes; normalise, or flip one row"
        )
