"""Names that known loggers give to columns, in the words by which headings are parsed."""

import os
import re
import unicodedata
from collections.abc import Sequence
from typing import Final

_FRAMES = re.compile(r"^([wapq]|omega)_[A-Z]{1,3}(?:_([A-Z]))?_([xyzw])\b(.*)$")
"""Quantities with their frames, as EuRoC and Basilisk write them: w_RS_S_x, p_RS_R_x, q_RS_w, omega_BN_B_x."""
_INERTIAL: Final = "NRWI"
"""Frames of reference of both, in whose axes a rate is no body rate."""
_SPELLED: Final = (
    (re.compile(r"^Shimmer_[0-9A-Fa-f]{4}_(.+)_CAL\b(.*)$"), r"\1\2"),
    (re.compile(r"^(\w+)\.ElapsedSecs$"), "time (s)"),  # GMAT
    (re.compile(r"^\w+\.AngularVelocity([XYZ])$"), r"gyro_\1 (deg/s)"),  # GMAT, whose rates are in degrees
    (re.compile(r"^([XYZ]) Gyro \[x[0-9A-Fa-f]{4}\]$"), r"omega_\1"),  # MicroStrain, rad/s
    (re.compile(r"^([XYZ]) Accel \[x[0-9A-Fa-f]{4}\]$"), r"acc_\1 (g)"),
    (re.compile(r"^GPS TOW$"), "time (s)"),
    (re.compile(r"^([xyz])-axis\b(.*)$"), r"\1\2"),  # MetaWear
    (re.compile(r"^\w+\.(?:UTC|TAI|TT|A1|TDB)Gregorian$"), "time"),  # GMAT
    (re.compile(r"^\w+\.(?:UTC|TAI|TT|A1|TDB)ModJulian$"), "time (days)"),
    (re.compile(r"^(?:Time[ _(]*)?(?:M?JD|J(?:ulian)?[ _]?Date)\)?$", re.IGNORECASE), "time (days)"),
    (re.compile(r"^sigma_BN_?[\[(]?([0-3xyz])[\])]?$"), r"mrp_\1"),  # Basilisk
    (re.compile(r"^(?:.*\.)?ArrayGyro\.([xyz])$"), r"gyro_\1 (deg/s)"),  # Movesense
    (re.compile(r"^(?:.*\.)?ArrayAcc\.([xyz])$"), r"acc_\1 (m/s^2)"),
    (re.compile(r"^cts$"), "time (ms)"),  # GoPro
    (re.compile(r"^(?:.*:)?scaledGyro([XYZ])$"), r"omega_\1"),  # MicroStrain's SensorConnect, rad/s
    (re.compile(r"^(?:.*:)?scaledAccel([XYZ])$"), r"acc_\1 (g)"),
    (re.compile(r"^(?:Uncal)?Gyro([XYZ])RadPerSec$"), r"gyro_\1 (rad/s)"),  # GnssLogger
    (re.compile(r"^(?:Uncal)?Accel([XYZ])Mps2$"), r"acc_\1 (m/s^2)"),
    (re.compile(r"^SampleTimeFine$"), "time (xsensticks)"),
    (re.compile(r"^(?:.*\.)?pqr\[([012])\]$"), r"omega[\1]"),  # Inertial Sense, rad/s
    (re.compile(r"^(?:.*\.)?w_a\[([123])\]$"), r"omega(\1)"),  # bodies of Modelica, in their own axes
    (re.compile(r"^ω([123])\b(.*)$"), r"omega(\1)\2"),  # RocketPy
    (re.compile(r"^(?:.*\.)?ang_vel_this\[([012])\](.*)$"), r"omega[\1]\2"),  # JEOD, in axes of the body
    (re.compile(r"^([XYZ])_value$"), r"\1"),  # Sensor Kinetics
    (re.compile(r"^Angular Velocity ?- ?([xyz]) \(rad/s\) Run #\d+$", re.IGNORECASE), r"omega_\1"),  # PASCO
    (re.compile(r"^Time \(s\) Run #\d+$"), "time (s)"),
    (re.compile(r"^Time \(UTCG\)$"), "time"),  # reports of STK
    (re.compile(r"^Time \(EpSec\)$"), "time (s)"),
    (re.compile(r"^field\.vector\.([xyz])$"), r"\1"),  # Vector3Stamped of rostopic echo -p
    (re.compile(r"^sys\.exec\.out\.time\b(.*)$"), r"time\1"),  # Trick
    (re.compile(r"^[\w.\[\]]+\.(\w+\[[012]\] \{[^{}]*\})$"), r"\1"),
    (re.compile(r"^(?:.*:)?([XYZ])-axis (gyro|acceleration)(?: \d+)?\b(.*)$"), r"\2_\1\3"),  # Vernier
    (re.compile(r"^_*real,_*time$"), "time (s)"),  # X-Plane
    (
        re.compile(r"^_*(.*\w),_*((?:m?rad|m?deg)/s|m?dps|[mun]?s|[mc]?m|g|m/s\^?2)$"),
        r"\1 (\2)",
    ),  # a unit after a comma
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
    (("position[0]", "position[1]", "position[2]"), "position"),
)
_VICON: Final = {**{f"r{axis}": f"q{axis}" for axis in "xyzw"}, **{f"t{axis}": f"p{axis}" for axis in "xyz"}}
"""Quaternion and position of an object, as Vicon calls them."""
"""Names about x, y, z, and the stem that they have here; omega is in rad/s by convention, gyro in no unit."""
_ARDUPILOT: Final = ("GyrX", "GyrY", "GyrZ")
"""In rad/s where the clock is TimeUS."""
_ARDUPILOT_QUATERNION: Final = ("Q1", "Q2", "Q3", "Q4")
"""Scalar first where the clock is TimeUS."""
_TOPIC: Final = re.compile(
    r"^.*?\.(?=(?:pose\.){0,2}(?:position|orientation)\.|angular_velocity\.|linear_acceleration\.)"
)
"""Path of a topic in front of the fields of its messages."""
_OTHER: Final = re.compile(r"bias|cov|std|setpoint|desired|cmd|command|goal|target_|ref")
"""Within the path of a topic of what is not measured."""
_FROM_ONE: Final = re.compile(r"(.*?)(?::\d+)?(?:\(([1-4])\)|(?<=[A-Za-z]{4})_([1-4])(?=$|\s*[(\[]))(.*)")
"""A component counted from 1, as MATLAB does: omega(1), omega:1(1) of the Simulation Data Inspector, and omega_1 of its
tables; w_1 may be a wheel."""
_RATES_FROM_ONE: Final = re.compile(r"(omega|ang(?:ular)?_?vel(?:ocity)?)([1-3])(\s*[(\[].*)?", re.IGNORECASE)
_EULER_PARAMETERS: Final = ("e0", "e1", "e2", "e3")
"""Of which the first is the scalar."""
_MRP_COUNTED: Final = (("mrp_0", "mrp_1", "mrp_2"), ("mrp_1", "mrp_2", "mrp_3"))
"""Components x, y, z of modified Rodrigues parameters that are counted from 0, and from 1."""
GOPRO_ORDER: Final = "zxy"
"""Order of the components of GoPro cameras, ORIO of their format, where they state no other."""
_GOPRO: Final = re.compile(r"(.*?)\s*(?:\(([xyz]),([xyz]),([xyz])\))?\s*(\[[^\[\]]*\])", re.IGNORECASE)
"""Name of a vector whose other two components are called 1 and 2, with their order and unit."""
_CRAZYFLIE: Final = ("stabilizer.", "stateEstimate.", "kalman.", "pm.vbat", "baro.asl")
"""Groups of the log of a Crazyflie, whose gyro is in deg/s."""
_MAVLINK: Final = ("xgyro", "ygyro", "zgyro")
_GMAT_CLOCK: Final = re.compile(r"\w+\.(?:ElapsedSecs|\w+Gregorian|\w+ModJulian)$")
_MATRIX: Final = re.compile(
    r"(?:r|rot|rotation|rotmat|mat|matrix|t|tf|transform|pose)_?\[?([0-3])\]?[\[_,]*([0-3])\]?"
)
"""An element of a rotation matrix, with its row and column counted from 0 or 1; of body to inertial, as an R and not a DCM is."""
_SHAPES: Final = ((3, 3), (3, 4), (4, 4))
_CALENDAR: Final = ("year", "month", "day")
_PX4_QUATERNION: Final = ("q[0]", "q[1]", "q[2]", "q[3]")
"""Scalar first where it stands with the attitude's reset counter or the sample's time stamp."""

_ORDERED: Final = re.compile(r"(.*?)[_. ]?(wxyz|xyzw)[\[_.(]?([0-3])[\])]?")
"""A component of a quaternion whose name spells the order of its components: quat_wxyz[0]."""
_ENVELOPE: Final = ("log_time", "publish_time")
"""Times that MCAP keeps beside each message."""
_PART: Final = re.compile(r"['\"]([^'\"]*)['\"]")
_TUPLE: Final = re.compile(rf"\({_PART.pattern}(?:, ?{_PART.pattern})*,?\)")
"""A name of several levels as Python prints it: ('gyro', 'x')."""


def understood_names(names: Sequence[str]) -> list[str]:
    """The names of columns, in the words by which their headings are understood; those of other loggers as they are."""
    if (
        "__time" in names
    ):  # PlotJuggler's clock; its other names are paths of topics, and stamps within their messages
        names = ["" if "/stamp" in name else name.lstrip("/").replace("/", ".") for name in names]
        names = [name if _OTHER.search(name) else _TOPIC.sub("", name) for name in names]
    elif len(names) > 1 and all(name.startswith("/") for name in names):  # paths of one topic
        common = os.path.commonpath(names)
        names = [name[len(common) :].lstrip("/").replace("/", ".") for name in names]
    elif names and all(map(_TUPLE.fullmatch, names)):
        names = ["_".join(filter(None, _PART.findall(name))) for name in names]
    if set(_ENVELOPE) <= set(names):  # the stamp within a message is that of the measurement
        own = any(".stamp." in name for name in names)
        left_out = _ENVELOPE if own else _ENVELOPE[:1]
        names = ["" if name in left_out else re.sub(r"^(?:data|message|msg)\.", "", name) for name in names]
    names = [_plainly_spelled(name) for name in _of_gopro(names)]
    found = _with_mrp([_without_frames(name) for name in names])
    bare = {_plain(name): k for k, name in enumerate(found)}
    if set(_VICON) <= set(bare):
        for name, meaning in _VICON.items():
            found[bare[name]] = meaning + found[bare[name]][len(name) :]
    if set("wxyz") <= set(bare):  # not rates about x, y and z
        for axis in "wxyz":
            found[bare[axis]] = f"q{axis}"
    if set(_EULER_PARAMETERS) <= set(bare):
        for name, axis in zip(_EULER_PARAMETERS, "wxyz", strict=True):
            found[bare[name]] = f"q{axis}"
    if {"q0", "qx", "qy", "qz"} <= set(bare) and "qw" not in bare:  # the others show that it is the scalar
        found[bare["q0"]] = "qw"
    if set(_CALENDAR) <= set(bare):  # parts of a date, none of which is a clock alone
        parts = (*_CALENDAR, "hour", "minute", "second")
        found = ["" if _plain(name) in parts else name for name in found]
    for trio, stem in _AXES:
        if all(name in bare for name in trio):
            for name, axis in zip(trio, "xyz", strict=True):
                unit = found[bare[name]][len(name) :]
                found[bare[name]] = f"{stem}_{axis}{unit}" if stem else f"{axis}{unit}"
    if "TimeUS" in names and set(_ARDUPILOT) <= set(names):
        for name, axis in zip(_ARDUPILOT, "xyz", strict=True):
            found[list(names).index(name)] = f"omega_{axis}"
    if "TimeUS" in names and set(_ARDUPILOT_QUATERNION) <= set(names):
        for name, axis in zip(_ARDUPILOT_QUATERNION, "wxyz", strict=True):
            found[list(names).index(name)] = f"q{axis}"
    is_px4 = "timestamp_sample" in names or "delta_q_reset[0]" in names
    if is_px4 and set(_PX4_QUATERNION) <= set(names):
        for name, axis in zip(_PX4_QUATERNION, "wxyz", strict=True):
            found[list(names).index(name)] = f"q{axis}"
    if "timestamp_sample" in names:  # of the sensor; the other is that of publication
        found = ["" if name == "timestamp" else name for name in found]
        if "q[0]" not in names:
            found = [f"omega_{name}" if name in ("x", "y", "z") else name for name in found]
    found = _with_matrix(_counted_from_one(_of_devices(names, found)))
    if "field.header.stamp" in names:  # of the measurement; the other is that of the recording
        found = ["" if name.strip("%") == "time" else name for name in found]
    if any("angular_velocity" in name for name in names) and any("linear_acc" in name for name in names):
        # an Imu message, whose orientation, if it is one, was made from its rates
        found = ["" if "orientation" in name else name for name in found]
    return found


def _of_devices(names: Sequence[str], found: list[str]) -> list[str]:
    """Names whose meaning and unit only the others in the header show."""
    if "motionRotationRateX(rad/s)" in names:  # of a phone, which makes it and the quaternion from the gyro's
        found = ["" if name.startswith(("gyroRotation", "motionQuaternion")) else name for name in found]
    if "PacketCounter" in names:  # Xsens, scalar first
        scalar_first = {f"Quat_q{k}": f"q{axis}" for k, axis in enumerate("wxyz")}
        found = [scalar_first.get(name, name) for name in found]
    if {"Face", "State"} <= set(names):  # NDI, mm
        found = [f"{name} (mm)" if name in ("Tx", "Ty", "Tz") else name for name in found]
    if set(_MAVLINK) <= set(
        names
    ):  # of HIGHRES_IMU and HIL_SENSOR in rad/s, of SCALED_IMU in mrad/s; of RAW_IMU in counts
        unit = "rad/s" if "abs_pressure" in names else "mrad/s" if "time_boot_ms" in names else ""
        found = [f"{name} ({unit})" if unit and name in _MAVLINK else name for name in found]
    if any(
        name.startswith("centreOfRotation") for name in names
    ):  # OpenFOAM, whose omega is in the global axes
        found = ["" if name.startswith("omega") else name for name in found]
    if "current_time_step" in names:  # Isaac Sim, scalar first
        scalar_first = {f"orientation[{k}]": f"q{axis}" for k, axis in enumerate("wxyz")}
        found = [scalar_first.get(name.rpartition(".")[2], name) for name in found]
    if {"xquat[0]", "xpos_x"} <= set(names):  # MuJoCo's pose of a body, scalar first
        meanings = {f"xquat[{k}]": f"q{axis}" for k, axis in enumerate("wxyz")}
        meanings |= {f"xpos_{axis}": f"p{axis}" for axis in "xyz"}
        found = [meanings.get(name, name) for name in found]
    if any(name.startswith(_CRAZYFLIE) for name in names):
        found = [f"{name} (deg/s)" if name in ("gyro.x", "gyro.y", "gyro.z") else name for name in found]
    if any(_GMAT_CLOCK.match(name) for name in names):  # vector first
        found = [re.sub(r"^\w+\.Q([1-4])$", lambda index: "q" + "xyzw"[int(index[1]) - 1], n) for n in found]
    return found


def _plainly_spelled(name: str) -> str:
    """A name in plain letters and digits, without that of the time of which it is a function: omega_1 of an omega with a low 1."""
    plain = name if name.isascii() else name.replace("ω", "omega").replace("Ω", "omega")
    if plain.endswith("(t)"):
        plain = unicodedata.normalize("NFKC", plain).removesuffix("(t)")
    elif any(digit in plain for digit in "₁₂₃"):
        plain = unicodedata.normalize("NFKC", plain)
    if (ordered := _ORDERED.fullmatch(plain.strip())) is not None:
        return f"{ordered[1] or 'q'}_{ordered[2][int(ordered[3])]}"
    numbered = _RATES_FROM_ONE.fullmatch(plain.strip())
    return f"{numbered[1]}_{numbered[2]}{numbered[3] or ''}" if numbered is not None else plain


def _of_gopro(names: Sequence[str]) -> Sequence[str]:
    """Names of which a vector that is followed by 1 and 2, as in tables of GoPro cameras, is called by its axes."""
    found = list(names)
    for k in range(len(names) - 2):
        matched = _GOPRO.fullmatch(names[k].strip())
        if matched is not None and [name.strip() for name in names[k + 1 : k + 3]] == ["1", "2"]:
            order = [matched[each] or axis for each, axis in zip((2, 3, 4), GOPRO_ORDER, strict=True)]
            found[k : k + 3] = [f"{matched[1]}_{axis.lower()} {matched[5]}" for axis in order]
    return found


def _counted_from_one(names: Sequence[str]) -> list[str]:
    """Names of which the three components of a vector that are counted from 1 are called x, y and z; four are of any order."""
    found = list(names)
    matched = [(k, parts) for k, name in enumerate(names) if (parts := _FROM_ONE.fullmatch(name.strip()))]
    for stem in dict.fromkeys(parts[1] for _, parts in matched):
        own = [(k, parts) for k, parts in matched if parts[1] == stem]
        if [parts[2] or parts[3] for _, parts in own] == ["1", "2", "3"]:
            for (k, parts), axis in zip(own, "xyz", strict=True):
                found[k] = f"{stem}_{axis}{parts[4]}"
    return found


def _with_mrp(names: list[str]) -> list[str]:
    """Names of which the counted components of modified Rodrigues parameters, if there are just three, are called x, y and z."""
    numbered = {name for name in names if re.fullmatch(r"mrp_[0-3]", name)}
    for trio in _MRP_COUNTED:
        if numbered == set(trio):
            axes = {name: f"mrp_{axis}" for name, axis in zip(trio, "xyz", strict=True)}
            return [axes.get(name, name) for name in names]
    return names


def _with_matrix(names: list[str]) -> list[str]:
    """Names of which the elements of a rotation matrix, if there are all of one, are called matrix_xy by row and column."""
    found = list(names)
    places: dict[tuple[int, int], int] = {}
    for k, name in enumerate(names):
        if matched := _MATRIX.fullmatch(name.strip().lower()):
            places[int(matched[1]), int(matched[2])] = k
    columns = [f"Rot[{k}]" for k in range(9)]
    if "Residual" in names and all(
        names.count(name) == 1 for name in columns
    ):  # Qualisys, column by column, mm
        first = names.index("Rot[0]")
        places = {(k % 3, k // 3): first + k for k in range(9)}
        for name, axis in zip(range(first - 7, first - 4), "xyz", strict=True):
            if name >= 0:
                found[name] = f"p{axis} (mm)"
    base = min((min(place) for place in places), default=0)
    held = {(row - base, column - base): k for (row, column), k in places.items()}
    if set(held) in [{(r, c) for r in range(rows) for c in range(columns)} for rows, columns in _SHAPES]:
        for (row, column), k in held.items():  # the fourth row of [R t] is 0 0 0 1
            found[k] = f"p{'xyz'[row]}" if column == 3 and row < 3 else ""
            found[k] = f"matrix_{'xyz'[row]}{'xyz'[column]}" if max(row, column) < 3 else found[k]
    return found


def _without_frames(name: str) -> str:
    for pattern, meaning in _SPELLED:
        if pattern.match(name.strip()):
            return pattern.sub(meaning, name.strip())
    if _BIAS.match(name.strip()):
        return ""
    matched = _FRAMES.match(name.strip())
    if matched is None:
        return name
    if matched[1] in ("w", "omega") and (matched[2] or " ") in _INERTIAL:
        return ""
    return f"{matched[1]}_{matched[3]}{matched[4].replace('[]', '')}"


def _plain(name: str) -> str:
    """A name without its bracketed unit, in small letters."""
    return re.sub(r"\s*[(\[](?![0-9]+\])[^()\[\]]*[)\]]\s*$", "", name.strip()).lower()
