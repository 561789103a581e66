"""Consider parameters: calibration errors that a run accounts for, of cameras, gyros, poses, clocks and an inspector's trajectory.

A new one is an entry here and its name in `OWN_CALIBRATION`.
"""

from typing import Final

import casadi as ca

from spinfilters.core.attitude_expressions import Expression
from spinfilters.core.camera_trajectory import drifting, later, levered, turning
from spinfilters.io.consider_parameter import ConsiderParameter
from spinfilters.io.stated_values import NumberRange
from spinfilters.models.state_blocks import GYRO_SCALE


def _change_baseline(
    values: Expression, parameters: Expression, error: Expression
) -> tuple[Expression, Expression]:
    return values, ca.vertcat(parameters[:7], parameters[7] * (1 + error), parameters[8:])


BASELINE: Final = ConsiderParameter(
    name="baseline_std",
    words="baseline",
    allowed=NumberRange(0, 0.1, "of the baseline"),
    default=1e-3,
    sensors=("stereo",),
    moved=_change_baseline,
    order=2,
)


CLOCK_SCALE: Final = ConsiderParameter(
    name="clock_scale_std",
    words="scale of the clock",
    allowed=NumberRange(0, 0.1, "of durations"),
    default=1e-4,
    order=5,
)


def _focal_length_moved(
    values: Expression, parameters: Expression, error: Expression
) -> tuple[Expression, Expression]:
    return values, ca.vertcat(parameters[:3], parameters[3:5] * (1 + error), parameters[5:])


FOCAL_LENGTH: Final = ConsiderParameter(
    name="focal_std",
    words="focal length",
    allowed=NumberRange(0, 0.1, "of the focal length"),
    default=1e-3,
    sensors=("stereo", "monocular"),
    moved=_focal_length_moved,
    order=0,
)


def _gyro_scale_error_moved(
    values: Expression, parameters: Expression, error: Expression
) -> tuple[Expression, Expression]:
    return values / (1 + error), parameters


GYRO_SCALE_ERROR: Final = ConsiderParameter(
    name="gyro_scale_std",
    words="scale of the gyro",
    allowed=NumberRange(0, 0.1, "of the rate"),
    default=5e-3,
    sensors=("gyro",),
    moved=_gyro_scale_error_moved,
    block=GYRO_SCALE.name,
    order=3,
    remark="A constant error, which is considered and not estimated. Noise in proportion to the rate is sensors.gyro_scale_std.",
)


INSPECTOR_CLOCK: Final = ConsiderParameter(
    name="inspector_clock_std",
    words="clock of the inspector's poses",
    allowed=NumberRange(0, 10.0, "s"),
    default=0.15,
    sensors=("stereo", "monocular"),
    displaced=later,
    order=8,
)


INSPECTOR_LEVER: Final = ConsiderParameter(
    name="inspector_lever_std",
    words="lever arm of the inspector's camera",
    allowed=NumberRange(0, 10.0, "m"),
    default=2e-2,
    sensors=("stereo", "monocular"),
    size=3,
    displaced=levered,
    order=9,
)


INSPECTOR_POSITION: Final = ConsiderParameter(
    name="inspector_position_std",
    words="positions of the inspector",
    allowed=NumberRange(0, 1.0, "m/min"),
    default=1e-2,
    sensors=("stereo", "monocular"),
    size=3,
    displaced=drifting,
    order=6,
)


INSPECTOR_ROTATION: Final = ConsiderParameter(
    name="inspector_rotation_std",
    words="attitudes of the inspector",
    allowed=NumberRange(0, 1.0, "rad/min"),
    default=2e-2,
    sensors=("stereo", "monocular"),
    size=3,
    displaced=turning,
    order=7,
)


def _length_scale_moved(
    values: Expression, parameters: Expression, error: Expression
) -> tuple[Expression, Expression]:
    return ca.vertcat(values[:3] / (1 + error), values[3:]), parameters


LENGTH_SCALE: Final = ConsiderParameter(
    name="length_scale_std",
    words="lengths of poses",
    allowed=NumberRange(0, 0.1, "of lengths"),
    default=1e-2,
    sensors=("pose",),
    moved=_length_scale_moved,
    order=4,
)
"""Relative error of the unit of length of poses."""


def _principal_point_moved(
    values: Expression, parameters: Expression, error: Expression
) -> tuple[Expression, Expression]:
    return values, ca.vertcat(parameters[:5], parameters[5:7] + error, parameters[7:])


PRINCIPAL_POINT: Final = ConsiderParameter(
    name="center_std",
    words="principal point",
    allowed=NumberRange(0, 1e3, "px"),
    default=0.5,
    sensors=("stereo", "monocular"),
    size=2,
    moved=_principal_point_moved,
    order=1,
)


OWN_CALIBRATION: Final = (
    BASELINE,
    CLOCK_SCALE,
    FOCAL_LENGTH,
    GYRO_SCALE_ERROR,
    INSPECTOR_CLOCK,
    INSPECTOR_LEVER,
    INSPECTOR_POSITION,
    INSPECTOR_ROTATION,
    LENGTH_SCALE,
    PRINCIPAL_POINT,
)
