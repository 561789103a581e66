"""Data sets: read from files, or simulated."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from spinfilters.api.arguments import SEGMENT
from spinfilters.api.blas_threads import on_one_blas_thread
from spinfilters.core.errors import InputError
from spinfilters.io.argument_checks import (
    KIND,
    called,
    checked_arguments,
    is_path,
    one_of,
    optional,
    refuse,
    text,
    three_numbers,
    truth,
)
from spinfilters.io.dataset import Dataset
from spinfilters.io.dataset_reader import IMAGES, has_images
from spinfilters.io.input_file import value_text
from spinfilters.io.memory_tables import WHAT_TO_GIVE, is_table, reading_options
from spinfilters.io.sensor_format import dataset_kinds
from spinfilters.io.stated_values import RATE_UNITS, ReadingOptions
from spinfilters.models.sensor_registry import has_error
from spinfilters.models.state_blocks import GYRO_BIAS as BIAS_BLOCK
from spinfilters.run.bag_recording import unpacked_recording
from spinfilters.run.readers import read_dataset
from spinfilters.run.segment_choice import read_chosen, segment_choice
from spinfilters.simulation.scenario import Progress, Scenario, silent, without_map
from spinfilters.simulation.scenario import simulate as simulate_scenario
from spinfilters.simulation.scenario_record import GYRO_BIAS


@checked_arguments(
    ReadingOptions,
    kind=optional(text(KIND)),
    segment=optional(one_of(int, str, cure='a number, times such as "6.55:7.4", or "auto"')),
)
def load(
    path: Any,
    segment: int | str | None = None,
    *,
    kind: str | None = None,
    units: str | Mapping[str, str] | None = None,
    unit: str | None = None,
    clock: str | None = None,
    rate: float | None = None,
    topic: str | None = None,
    columns: str | None = None,
    rig: str | None = None,
) -> Dataset:
    """Data set of a folder or file, or of a table in memory.

    Whatever ``spinfilters compare`` reads; of stereo images it is their tracks.

    Parameters
    ----------
    path : str, os.PathLike, data frame, mapping or array
        A table in memory, see `Dataset.from_dataframe`; or the path of a folder with ``dataset.toml``, a phone's export or a zip
        of it, a ``.csv`` with columns by name (a clock and three body rates, or poses), a TUM ``.tum`` or ``.txt`` of poses, a
        ROS bag.
    segment : int, str or None
        Number of a marked segment of a phyphox recording or else of a free flight, times such as "6.55:7.4" (s), or "auto" for the
        only free flight; None for the whole.
    kind : str or None
        Of a table in memory whose names do not identify it, such as "gyro".
    units : str, Mapping or None
        What ``unit`` and ``clock`` say in one: "deg/s", or ``{"time": "ms", "rate": "deg/s"}``.
    unit : str or None
        Of body rates or positions whose header states none, such as "deg/s".
    clock : str or None
        Unit of time stamps, such as "ms".
    rate : float or None
        Samples a second, Hz, of a table without a clock.
    topic : str or None
        Of a ROS bag; of images two with a comma, left first. Also a body of a table, or a segment of an Xsens MVN.
    columns : str or None
        Names of the columns of a table without a header, such as "t,x,y,z".
    rig : str or None
        Folder with the calibration of a bag's images, where the bag has no ``camera_info``.

    Returns
    -------
    Dataset
        With its measurements by sensor, and what the recording states of noise and camera.

    Raises
    ------
    InputError
        An unusable file, no such segment, a unit in doubt; the text names file, line or value, and the cure.
    """
    if units is not None:
        if unit is not None or clock is not None:
            raise InputError("units says what unit and clock say; give one of them")
        stated = reading_options(units, rate)
        unit, clock = stated.unit, stated.clock
    options = ReadingOptions(unit, clock, rate, topic, columns, rig)
    if not is_path(path):
        return _in_memory(path, kind, options, segment)
    if kind is not None:
        raise InputError(
            f"kind {value_text(kind)} is for tables in memory; a file states its own: leave it out"
        )
    if segment is not None:
        if not isinstance(segment, str):
            SEGMENT.require("segment", segment)
        return read_chosen(path, segment_choice(segment), options)
    path, options = unpacked_recording(path, options)
    if has_images(path):
        options.require_only((), IMAGES)
        from spinfilters.vision.track_images import track_images

        return track_images(Path(path)).dataset
    return read_dataset(path, options=options)


def _in_memory(table: Any, kind: str | None, options: ReadingOptions, segment: int | str | None) -> Dataset:
    """Data set of a table in memory. InputError: no table; statements and segments that are of files."""
    if not is_table(table):
        refuse("path", table, WHAT_TO_GIVE)
    if segment is not None:
        raise InputError(f"segment {segment} is of a recording's file; cut the table instead")
    options.require_only(("unit", "clock", "rate"), "a table in memory")
    units: dict[str, str] = {} if options.clock is None else {"time": options.clock}
    if options.unit is not None:
        units["rate" if options.unit in RATE_UNITS else "position"] = options.unit
    return Dataset.from_dataframe(table, kind, units=units or None, rate=options.rate)


@checked_arguments(Scenario, known_map=truth, gyro_bias=optional(three_numbers(GYRO_BIAS)), progress=called)
@on_one_blas_thread
def simulate(
    kind: str = Scenario.kind,
    *,
    seed: int = Scenario.seed,
    frames: int = Scenario.epochs,
    interval: float = Scenario.interval,
    rate_rpm: Sequence[float] = Scenario.rate_rpm,
    moments: Sequence[float] = Scenario.principal_moments,
    known_map: bool = False,
    gyro_bias: Sequence[float] | None = None,
    inspector: str = Scenario.inspector,
    inspector_errors: Mapping[str, float] | None = None,
    beside: Mapping[str, float] | None = None,
    progress: Progress = silent,
) -> Dataset:
    """Simulated data set with truth, as ``spinfilters simulate`` writes it; body, camera, noise and disturbances are the thesis'.

    Parameters
    ----------
    kind : str
        "stereo-tracks", "mono-tracks", "pose", "attitude", "gyro", "magnetometer", "lidar-points", "lidar-poses" or that of an
        installed sensor.
    seed : int
        Of everything random.
    frames : int
        Number of epochs, at least 2.
    interval : float
        Between epochs, s.
    rate_rpm : sequence of 3 floats
        Initial rate about the principal axes x, y, z, rpm.
    moments : sequence of 3 floats
        Principal moments about them, any scale.
    known_map : bool
        Whether the data set gives the landmarks' positions; of tracks only.
    gyro_bias : sequence of 3 floats or None
        Constant error of a gyro's rates, g axes, rad/s; of that kind only.
    inspector : str
        "static", or how the camera moves on a known trajectory: "circle" about the body, "sway", or "dead-band" of thrusters that
        fire at the edges of one; of tracks only.
    inspector_errors : Mapping[str, float] or None
        Sizes, by name, of what is wrong with its poses: "late" s, "turning" rad and "drifting" m over the recording, "lever" m from
        the camera, "sparse" s between them, "missing" (any size). Nothing is stated then of how well they are known.
    beside : Mapping[str, float] or None
        Intervals, s, of other kinds of sensors that see the same motion.
    progress : Callable[[int, int], None]
        Called after every epoch of the motion with how many are done, and of how many.

    Returns
    -------
    Dataset
        With truth; without the map of its landmarks unless ``known_map``.

    Raises
    ------
    InputError
        An unknown kind, a number out of its range, moments of no body, more than 100 revolutions between epochs.
    """
    others = tuple((beside or {}).items())
    if gyro_bias is not None:
        _require_gyro((kind, *(name for name, _ in others)))
    scenario = Scenario(
        kind=kind,
        epochs=frames,
        interval=interval,
        rate_rpm=_triple(rate_rpm),
        principal_moments=_triple(moments),
        inspector=inspector,
        inspector_errors=tuple((inspector_errors or {}).items()),
        beside=others,
        gyro_bias=Scenario.gyro_bias if gyro_bias is None else _triple(gyro_bias),
        seed=seed,
    )
    return simulated_dataset(scenario, known_map, progress)


def simulated_dataset(scenario: Scenario, known_map: bool, progress: Progress) -> Dataset:
    """Data set of a scenario, with the map of its landmarks where that is to be known.

    Raises
    ------
    InputError
        More than 100 revolutions between epochs, a map or a bias without a sensor that has one.
    """
    scenario.require_slow()
    seeing = [name for name, form in dataset_kinds().items() if form.has_landmarks]
    if known_map and not any(each in seeing for each in scenario.kinds):
        raise InputError(f"a known map is for the kinds {' and '.join(seeing)}; a {scenario.kind} has no map")
    if any(scenario.gyro_bias):
        _require_gyro(scenario.kinds)
    dataset = simulate_scenario(scenario, progress)
    return dataset if known_map else without_map(dataset)


def _require_gyro(kinds: Sequence[str]) -> None:
    """InputError: a bias without a gyro."""
    if not has_error(kinds, BIAS_BLOCK):
        raise InputError(f"a gyro's bias is for the kind gyro; a {kinds[0]} has no gyro")


def _triple(numbers: Sequence[float]) -> tuple[float, float, float]:
    return numbers[0], numbers[1], numbers[2]
