"""A run as arrays with names and units: an xarray.Dataset, and NetCDF."""

from collections.abc import Sequence
from importlib import import_module
from io import BytesIO
from pathlib import Path
from typing import Any, Final

import numpy as np

from spinfilters.evaluation.estimated_motion import Trajectory
from spinfilters.evaluation.estimator_evaluation import Evaluation
from spinfilters.io.output_files import write_bytes

MOTION: Final[dict[str, tuple[str, str, str]]] = {
    "position": ("axis", "m", "centre of mass in frame i"),
    "q_ig": ("component", "1", "attitude of frame g in frame i, scalar last"),
    "velocity": ("axis", "m/s", "velocity of the centre of mass in frame i"),
    "rate_i": ("axis", "rad/s", "angular rate in axes of frame i"),
    "std_position": ("axis", "m", "standard deviation of the position"),
    "std_attitude": ("axis", "rad", "standard deviation of the attitude about the axes of frame g"),
    "std_velocity": ("axis", "m/s", "standard deviation of the velocity"),
    "std_rate": ("axis", "rad/s", "standard deviation of the rate"),
}
"""Dimension in addition to estimator and time, unit and meaning of each quantity of a trajectory."""


def labelled_arrays(evaluations: Sequence[Evaluation]) -> Any:
    """An xarray.Dataset of estimators: motions over ``estimator`` and ``time``, bodies over ``estimator``.

    Parameters
    ----------
    evaluations : Sequence[Evaluation]
        Of a run. Their epochs are united; NaN stands where an estimator has none, and for a position that is not measured.

    Returns
    -------
    Any
        xarray.Dataset; every variable has ``units`` and ``long_name``.

    Raises
    ------
    ImportError
        xarray is not installed.
    """
    xarray = _xarray()
    times = np.unique(np.concatenate([each.trajectory.time for each in evaluations]))
    variables: dict[str, Any] = {}
    for name, (dimension, unit, meaning) in MOTION.items():
        rows = [_on_times(each.trajectory, name, times) for each in evaluations]
        variables[name] = (("estimator", "time", dimension), np.array(rows), _attributes(unit, meaning))
    bodies = [each.body for each in evaluations]
    nothing = np.full(3, np.nan)
    for name, (dimensions, unit, meaning) in BODY.items():
        values = [getattr(body, name) for body in bodies]
        stacked = np.array([nothing if value is None else value for value in values], dtype=float)
        variables[name] = (("estimator", *dimensions), stacked, _attributes(unit, meaning))
    verdicts = [str(each.history.status.verdict) for each in evaluations]
    variables["status"] = ("estimator", np.array(verdicts), {"long_name": "verdict: ok, degraded or failed"})
    coordinates = {
        "estimator": [each.name for each in evaluations],
        "time": ("time", times, _attributes("s", "time of the epoch")),
        "axis": list("xyz"),
        "component": list("xyzw"),
        "principal": [1, 2, 3],
    }
    return xarray.Dataset(
        variables, coordinates, {"title": "spinfilters run", "frames": "i inertial, g on the body"}
    )


def write_netcdf(path: Path, evaluations: Sequence[Evaluation]) -> None:
    """Write the `labelled_arrays` as NetCDF 3 with 64-bit offsets, atomically.

    Raises
    ------
    ImportError
        xarray is not installed.
    InputError
        The file cannot be written.
    """
    content = labelled_arrays(evaluations).to_netcdf(engine="scipy", format="NETCDF3_64BIT")
    write_bytes(path, BytesIO(content).getvalue())


BODY: Final[dict[str, tuple[tuple[str, ...], str, str]]] = {
    "principal_moments": (("principal",), "1", "principal moments, ascending, the largest is 1"),
    "principal_moments_std": (("principal",), "1", "standard deviations of the principal moments"),
    "principal_axes_g": (("principal", "axis"), "1", "principal axes as rows in frame g"),
    "principal_axes_std": (
        ("principal",),
        "rad",
        "standard deviations of the rotation about the principal axes",
    ),
    "center_of_mass_g": (("axis",), "m", "centre of mass in frame g"),
    "center_of_mass_std": (("axis",), "m", "standard deviations of the centre of mass"),
}
"""Dimensions in addition to estimator, unit and meaning of what is known of the body after the last epoch."""


def _on_times(trajectory: Trajectory, name: str, times: np.ndarray) -> np.ndarray:
    """One quantity at all times of a run: NaN where there is no epoch or no measurement of it."""
    values = getattr(trajectory, name)
    full = np.full((len(times), values.shape[1]), np.nan)
    if trajectory.sees_position or not name.endswith(("position", "velocity")):
        full[np.searchsorted(times, trajectory.time)] = values
    return full


def _attributes(unit: str, meaning: str) -> dict[str, str]:
    return {"units": unit, "long_name": meaning}


def _xarray() -> Any:
    """The module xarray. ImportError: it is not installed."""
    try:
        return import_module("xarray")
    except ImportError:
        raise ImportError(
            "to_xarray and NetCDF need xarray, which is not installed; install it with 'pip install xarray'"
        ) from None
