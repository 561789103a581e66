"""The table of all errors that the models may have: what each is, its columns, how large it may be and what to do about it.

One more is a function in `error_columns` and an entry here.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from types import MappingProxyType
from typing import Final

import numpy as np
from jaxtyping import Float

from spinfilters.core.camera_trajectory import later, turning
from spinfilters.io.consider_parameter import ConsiderParameter
from spinfilters.models.calibration import (
    BASELINE,
    CLOCK_SCALE,
    FOCAL_LENGTH,
    GYRO_SCALE_ERROR,
    INSPECTOR_CLOCK,
    INSPECTOR_LEVER,
    INSPECTOR_ROTATION,
    PRINCIPAL_POINT,
)
from spinfilters.models.state_blocks import (
    ACCELERATION,
    DRAG,
    GYRO_BIAS,
    GYRO_SCALE,
    ROTOR,
    TORQUE,
    StateBlock,
)
from spinfilters.verdict.model_errors import error_columns as columns_of
from spinfilters.verdict.model_errors.linear_rows import Columns
from spinfilters.verdict.model_errors.smoothed_motion import SmoothedMotion

ErrorColumns = Callable[[SmoothedMotion], Columns | None]
"""Whitened right-hand sides per unit of an error, a column per component; None where it does not apply."""


def is_always_possible(size: Float[np.ndarray, " m"], motion: SmoothedMotion) -> bool:
    """Every size is one that a recording can have."""
    return True


@dataclass(frozen=True)
class Alternative:
    """An error that the models may have.

    Attributes
    ----------
    name : str
        Name of the error.
    phrase : str
        The error in a sentence, with its article.
    unit : str
        Unit of its size.
    columns : callable
        Its right-hand sides about a motion (`ErrorColumns`).
    cure : str
        What to do about it.
    moving_cure : str
        The same where poses of a moving camera are given; empty where that makes no difference.
    plausible : float
        Standard deviation of what its size is before anything is measured; infinite where nothing is known.
    only_positive : bool
        Whether its one size is of one sign: what brakes does not drive.
    by_epoch : bool
        Whether it is drawn anew at every epoch; if not, it is the same in all.
    trials : int
        Places in a recording among which it was sought where it is likeliest.
    is_possible : callable
        Whether a recording can have an error of this size at all.
    block : StateBlock or None
        Of a state that holds it, None where none does.
    held_by : Mapping[str, Mapping[str, bool or float]]
        Settings that put it there, by table and key.
    parameter : ConsiderParameter or None
        Of the calibration, where this is an error of one that estimates consider; else None.
    is_of_poses : bool
        Whether it is one of the poses given of a moving camera.
    considered : ConsiderParameter or None
        Of the calibration, whose stated deviation says how large such an error may be; ``parameter`` where there is one.
    """

    name: str
    phrase: str
    unit: str
    columns: ErrorColumns
    cure: str
    moving_cure: str = ""
    plausible: float = float("inf")
    only_positive: bool = False
    by_epoch: bool = False
    trials: int = 1
    is_possible: Callable[[Float[np.ndarray, " m"], SmoothedMotion], bool] = is_always_possible
    block: StateBlock | None = None
    held_by: Mapping[str, Mapping[str, bool | float]] = field(default_factory=dict)
    parameter: ConsiderParameter | None = None
    is_of_poses: bool = False
    considered: ConsiderParameter | None = None

    @property
    def deviation(self) -> str:
        """Name of the setting of ``[calibration]`` that states how large it may be; empty where none does."""
        own = self.considered or self.parameter
        return "" if own is None else own.name

    def cure_before(self, has_inspector: bool) -> str:
        """Return the cure: `moving_cure` where poses of a moving camera are given and it has one, else `cure`."""
        return self.moving_cure if has_inspector and self.moving_cure else self.cure

    def is_held(self, motion: SmoothedMotion) -> bool:
        """Whether the state has it already."""
        return self.block is not None and motion.rows.problem.layout.has(self.block)


CONSTANT_ACCELERATION: Final = Alternative(
    "acceleration",
    "a constant acceleration",
    "m/s^2",
    columns_of.constant_acceleration,
    "set process.gravity = true",
    block=ACCELERATION,
    held_by={"process": {"gravity": True}},
)
CONTACT_AT_BEGIN: Final = Alternative(
    "contact-at-begin",
    "contact in the first epochs",
    "rad/s^2 and m/s^2",
    columns_of.contact_at_begin,
    "begin the recording later (--segment)",
)
CONTACT_AT_END: Final = Alternative(
    "contact-at-end",
    "contact in the last epochs",
    "rad/s^2 and m/s^2",
    columns_of.contact_at_end,
    "end the recording earlier (--segment)",
)
FLYWHEEL: Final = Alternative(
    "rotor",
    "a flywheel turning inside",
    "rad/s",
    columns_of.flywheel,
    "set process.rotor = true, or stop the flywheel while recording",
    plausible=1.0,
    block=ROTOR,
    held_by={"process": {"rotor": True}},
)
HINGE: Final = Alternative(
    "hinge",
    "parts that move inside (a hinge, an elbow)",
    "of the moments",
    columns_of.hinge,
    "lock the joint: a body that is not rigid has no constant moments",
    plausible=0.3,
)
CLOCK_DRIFT: Final = Alternative(
    "clock-drift",
    "a drift of the clock's rate",
    "s over the recording",
    columns_of.clock_drift,
    "check the clock, and the unit of the time stamps",
    is_possible=columns_of.runs_forward,
    considered=CLOCK_SCALE,
)
INSPECTOR_MISSING: Final = Alternative(
    "inspector-missing",
    "a camera that moves",
    "rad and m",
    columns_of.inspector_missing,
    "give the camera's known poses (inspector.tum), or fix the camera",
    plausible=2.0,
)

STAMP: Final = "stamp measurements where they are made, not where they arrive"
CALIBRATE: Final = "calibrate the cameras again (spinfilters calibrate)"

ALTERNATIVES: Final[tuple[Alternative, ...]] = (
    CONSTANT_ACCELERATION,
    Alternative(
        "air-resistance",
        "air that brakes the path",
        "1/m",
        columns_of.air_resistance,
        "take a slower or shorter throw, or state a larger process.force_psd",
        plausible=1.0,
        only_positive=True,
    ),
    Alternative(
        "camera-shake",
        "a shift common to each image (camera shake)",
        "px",
        columns_of.camera_shake,
        "fix the camera, or give its motion (inspector.tum)",
        "give poses of the camera that are known to what a pixel is (inspector.tum), or state a larger pixel_std",
        plausible=10.0,
        by_epoch=True,
    ),
    Alternative(
        "focal-length",
        "an error of the focal length",
        "of it",
        partial(columns_of.of_calibration, parameter=FOCAL_LENGTH),
        CALIBRATE,
        plausible=0.05,
        parameter=FOCAL_LENGTH,
    ),
    Alternative(
        "principal-point",
        "an error of the principal point",
        "px",
        partial(columns_of.of_calibration, parameter=PRINCIPAL_POINT),
        CALIBRATE,
        plausible=20.0,
        parameter=PRINCIPAL_POINT,
    ),
    Alternative(
        "distortion",
        "distortion of the lens that the calibration lacks",
        "of the radius cubed",
        columns_of.distortion,
        "calibrate the cameras with distortion, and rectify the tracks",
        plausible=0.3,
    ),
    Alternative(
        "baseline",
        "an error of the baseline",
        "of it",
        partial(columns_of.of_baseline, parameter=BASELINE),
        "calibrate the pair again (spinfilters calibrate)",
        plausible=0.05,
        parameter=BASELINE,
    ),
    Alternative(
        "right-camera-turned",
        "a turned right camera",
        "rad",
        columns_of.right_camera_turned,
        "calibrate the pair again and rectify (spinfilters calibrate)",
        plausible=0.03,
    ),
    Alternative(
        "right-camera-late",
        "a right camera that triggers late",
        "s",
        columns_of.right_camera_late,
        "trigger both cameras together",
        plausible=0.03,
    ),
    Alternative(
        "clock-jitter",
        "jitter of the time stamps",
        "s",
        columns_of.clock_jitter,
        STAMP,
        f"{STAMP}, and give poses of the camera that are known to what a pixel is (inspector.tum)",
        plausible=0.1,
        by_epoch=True,
        is_possible=columns_of.keeps_order,
    ),
    CLOCK_DRIFT,
    Alternative(
        "sensor-delay",
        "a time offset between the sensors",
        "s",
        columns_of.sensor_delay,
        "shift the time stamps of one of them",
        plausible=0.2,
    ),
    CONTACT_AT_BEGIN,
    CONTACT_AT_END,
    Alternative(
        "drag",
        "drag of the rotation",
        "1/rad",
        columns_of.drag,
        'set process.drag = "auto"',
        plausible=0.05,
        only_positive=True,
        block=DRAG,
        held_by={"process": {"drag": True}},
    ),
    Alternative(
        "gyro-bias",
        "a bias of the gyro",
        "rad/s",
        columns_of.gyro_bias,
        "set initialisation.gyro_bias_std",
        plausible=0.1,
        block=GYRO_BIAS,
        held_by={"initialisation": {"gyro_bias_std": 0.05}},
    ),
    Alternative(
        "gyro-drift",
        "a bias of the gyro that drifts",
        "rad/s",
        columns_of.gyro_drift,
        "let the gyro warm up, or take a shorter recording (--segment)",
        plausible=0.05,
    ),
    Alternative(
        "gyro-scale",
        "an error of the gyro's scale",
        "of the rate",
        columns_of.gyro_scale,
        "set initialisation.gyro_scale_error_std, and check its unit (rad/s)",
        plausible=0.1,
        block=GYRO_SCALE,
        held_by={"initialisation": {"gyro_scale_error_std": GYRO_SCALE.prior_std}},
        parameter=GYRO_SCALE_ERROR,
    ),
    Alternative(
        "gyro-misalignment",
        "misaligned axes of the gyro",
        "rad",
        columns_of.gyro_misalignment,
        "calibrate the gyro's axes and their scales",
        plausible=0.1,
    ),
    Alternative(
        "gyro-low-pass",
        "a low-pass filter within the gyro",
        "s^2",
        columns_of.gyro_low_pass,
        "set the gyro's bandwidth well above the wobble",
        plausible=0.1,
    ),
    HINGE,
    Alternative(
        "inspector-delay",
        # Of a uniform circle about a resting body a turned frame i, which nothing shows.
        "poses of the inspector that are late",
        "s",
        partial(columns_of.of_inspector, displacement=later),
        "give inspector.tum on the clock of the images, or state calibration.inspector_clock_std",
        plausible=0.5,
        is_of_poses=True,
        considered=INSPECTOR_CLOCK,
    ),
    Alternative(
        "inspector-drift",
        # An even drift of its places is a velocity of the body, which nothing shows.
        "attitudes of the inspector that drift",
        "rad/min",
        partial(columns_of.of_inspector, displacement=turning),
        "correct inspector.tum, or state calibration.inspector_rotation_std",
        plausible=0.2,
        is_of_poses=True,
        considered=INSPECTOR_ROTATION,
    ),
    Alternative(
        "inspector-lever",
        # As of the spacecraft's navigation. Of a camera that does not turn it is a shift of frame i, which nothing shows.
        "poses of another point of the inspector than its camera",
        "m",
        columns_of.of_lever,
        "give the poses of cam0 itself (inspector.tum), or state calibration.inspector_lever_std",
        plausible=0.3,
        is_of_poses=True,
        considered=INSPECTOR_LEVER,
    ),
    INSPECTOR_MISSING,
    Alternative(
        "energy-loss",
        "a loss of energy within the body",
        "1/rad",
        columns_of.energy_loss,
        "something sloshes or flexes inside: take a shorter recording, or state a larger process.torque_psd",
        plausible=0.3,
        only_positive=True,
    ),
    Alternative(
        "position-delay",
        "positions that are later than their attitudes",
        "s",
        columns_of.position_delay,
        "give positions and attitudes of one instant",
        plausible=0.2,
    ),
    Alternative(
        "point-drift",
        "a tracked point that moves in the body",
        "m",
        columns_of.point_drift,
        "the tracked point or the centre of mass moves in the body: fix it, or take a shorter recording",
        plausible=0.1,
    ),
    FLYWHEEL,
    Alternative(
        "torque",
        "a constant body torque",
        "rad/s^2",
        columns_of.constant_torque,
        "set process.body_torque = true",
        block=TORQUE,
        held_by={"process": {"body_torque": True}},
    ),
)
"""In the order in which they are tried."""
_BY_NAME: Final = MappingProxyType({each.name: each for each in ALTERNATIVES})


def table() -> Mapping[str, Alternative]:
    """All alternatives by name."""
    return _BY_NAME
