"""Names that known loggers give to columns, in the words by which headings are parsed."""

import re
from collections.abc import Sequence
from typing import Final

_FRAMES = re.compile(r"^([wapq]|omega)_[A-Z]{1,3}(?:_[A-Z])?_([xyzw])\b(.*)$")
"""Quantities with their frames, as EuRoC and Basilisk write them: w_RS_S_x, p_RS_R_x, q_RS_w, omega_BN_B_x."""
_SPELLED: Final = (
    (re.compile(r"^Shimmer_[0-9A-Fa-f]{4}_(.+)_CAL\b(.*)$"), r"\1\2"),
    (re.compile(r"^(\w+)\.ElapsedSecs$"), "time (s)"),  # GMAT
    (re.compile(r"^\w+\.AngularVelocity([XYZ])$"), r"gyro_\1 (deg/s)"),  # GMAT, whose rates are in degrees
    (re.compile(r"^([XYZ]) Gyro \[x[0-9A-Fa-f]{4}\]$"), r"omega_\1"),  # MicroStrain, rad/s
    (re.compile(r"^([XYZ]) Accel \[x[0-9A-Fa-f]{4}\]$"), r"acc_\1 (g)"),
    (re.compile(r"^GPS TOW$"), "time (s)"),
    (re.compile(r"^([xyz])-axis\b(.*)$"), r"\1\2"),  # MetaWear
)
"""Names of single columns, and what they say here."""
_BIAS = re.compile(r"^b_[wa]_[A-Z]{1,3}")
"""Biases that EuRoC states with its poses: b_w_RS_S_x; they are no rates of the body."""
_AXES: Final[tuple[tuple[tuple[str, str, str], str], ...]] = (
    (("p", "q", "r"), "gyro"),
    (("roll_rate", "pitch_rate", "yaw_rate"), "gyro"),
    (("rollrate", "pitchrate", "yawrate"), "gyro"),
    (("rate_roll", "rate_pitch", "rate_yaw"), "gyro"),
    (("rates.roll", "rates.pitch", "rates.yaw"), "gyro"),
    (("rollspeed", "pitchspeed", "yawspeed"), "omega"),  # MAVLink, rad/s
    (("gyro_rad[0]", "gyro_rad[1]", "gyro_rad[2]"), "omega"),  # PX4, rad/s
    (("ang_vel_x", "ang_vel_y", "ang_vel_z"), "omega"),
    (("vel_ang_x", "vel_ang_y", "vel_ang_z"), "omega"),
    (("xyz[0]", "xyz[1]", "xyz[2]"), ""),
)
_VICON: Final = {**{f"r{axis}": f"q{axis}" for axis in "xyzw"}, **{f"t{axis}": f"p{axis}" for axis in "xyz"}}
"""Quaternion and position of an object, as Vicon calls them."""
"""Names about x, y, z, and the stem that they have here; omega is in rad/s by convention, gyro in no unit."""
_ARDUPILOT: Final = ("GyrX", "GyrY", "GyrZ")
"""In rad/s where the clock is TimeUS."""
_PX4_QUATERNION: Final = ("q[0]", "q[1]", "q[2]", "q[3]")
"""Scalar first where it stands with the attitude's reset counter or the sample's time stamp."""


def understood_names(names: Sequence[str]) -> list[str]:
    """The names of columns, in the words by which their headings are understood; those of other loggers as they are."""
    if (
        "__time" in names
    ):  # PlotJuggler's clock; its other names are paths of topics, and stamps within their messages
        names = ["" if "/stamp" in name else name.lstrip("/").replace("/", ".") for name in names]
    found = [_without_frames(name) for name in names]
    bare = {_plain(name): k for k, name in enumerate(found)}
    if set(_VICON) <= set(bare):
        for name, meaning in _VICON.items():
            found[bare[name]] = meaning + found[bare[name]][len(name) :]
    for trio, stem in _AXES:
        if all(name in bare for name in trio):
            for name, axis in zip(trio, "xyz", strict=True):
                unit = found[bare[name]][len(name) :]
                found[bare[name]] = f"{stem}_{axis}{unit}" if stem else f"{axis}{unit}"
    if "TimeUS" in names and set(_ARDUPILOT) <= set(names):
        for name, axis in zip(_ARDUPILOT, "xyz", strict=True):
            found[list(names).index(name)] = f"omega_{axis}"
    is_px4 = "timestamp_sample" in names or "delta_q_reset[0]" in names
    if is_px4 and set(_PX4_QUATERNION) <= set(names):
        for name, axis in zip(_PX4_QUATERNION, "wxyz", strict=True):
            found[list(names).index(name)] = f"q{axis}"
    if "timestamp_sample" in names:  # of the sensor; the other is that of publication
        found = ["" if name == "timestamp" else name for name in found]
        found = [f"omega_{name}" if name in ("x", "y", "z") else name for name in found]
    if "field.header.stamp" in names:  # of the measurement; the other is that of the recording
        found = ["" if name.strip("%") == "time" else name for name in found]
    if any("angular_velocity" in name for name in names) and any("linear_acc" in name for name in names):
        # an Imu message, whose orientation, if it is one, was made from its rates
        found = ["" if "orientation" in name else name for name in found]
    return found


def _without_frames(name: str) -> str:
    for pattern, meaning in _SPELLED:
        if pattern.match(name.strip()):
            return pattern.sub(meaning, name.strip())
    if _BIAS.match(name.strip()):
        return ""
    matched = _FRAMES.match(name.strip())
    return name if matched is None else f"{matched[1]}_{matched[2]}{matched[3].replace('[]', '')}"


def _plain(name: str) -> str:
    """A name without its bracketed unit, in small letters."""
    return re.sub(r"\s*[(\[](?![0-9]+\])[^()\[\]]*[)\]]\s*$", "", name.strip()).lower()
