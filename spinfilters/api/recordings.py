"""Data sets: read from files, or simulated."""

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from spinfilters.api.argument_ranges import (
    DEFAULT_MOMENTS,
    DEFAULT_RATE_RPM,
    FRAMES,
    GYRO_BIAS,
    INTERVAL,
    MOMENT,
    RATE_RPM,
    SEED,
    SEGMENT,
    require_motion,
)
from spinfilters.api.blas_threads import on_one_blas_thread
from spinfilters.data.argument_checks import (
    A_RECORDING,
    called,
    checked_arguments,
    number,
    numbers_by_name,
    one_of,
    optional,
    text,
    three_numbers,
    truth,
)
from spinfilters.data.argument_checks import path as path_of
from spinfilters.data.dataset import Dataset
from spinfilters.data.dataset_reader import has_images, read_dataset
from spinfilters.data.sensor_format import dataset_kinds
from spinfilters.data.stated_values import SAMPLING_RATE, ReadingOptions
from spinfilters.errors import InputError
from spinfilters.pipeline.segment_choice import read_chosen, segment_choice
from spinfilters.sensors.sensor import has_error
from spinfilters.simulation.inspector import STATIC
from spinfilters.simulation.motion import Progress, silent
from spinfilters.simulation.scenario import Scenario, without_map
from spinfilters.simulation.scenario import simulate as simulate_scenario
from spinfilters.state.blocks.gyro_bias import GYRO_BIAS as BIAS_BLOCK

MOST_TURNS = 100
"""Revolutions between epochs, at most: beyond, rounding decides where the body points."""


@checked_arguments(
    path=path_of(A_RECORDING),
    segment=optional(one_of(int, str, cure='a number, times such as "6.55:7.4", or "auto"')),
    unit=optional(text('the unit of body rates, such as "deg/s"')),
    clock=optional(text('the unit of time stamps, such as "ms"')),
    rate=optional(number(SAMPLING_RATE)),
    topic=optional(text("the name of a topic")),
)
def load(
    path: str | os.PathLike[str],
    segment: int | str | None = None,
    *,
    unit: str | None = None,
    clock: str | None = None,
    rate: float | None = None,
    topic: str | None = None,
) -> Dataset:
    """Data set of a folder or file.

    Whatever ``spinfilters compare`` reads; of stereo images it is their tracks.

    Parameters
    ----------
    path: a folder with ``dataset.toml``, a phone's export or a zip of it, a ``.csv`` with columns by name (a clock and three body
        rates, or poses), a TUM ``.tum`` or ``.txt`` of poses, a ROS bag.
    segment: number of a marked segment of a phyphox recording or else of a free flight, times such as "6.55:7.4" (s), or "auto" for
        the only free flight; None for the whole.
    unit: of body rates whose header states none, such as "deg/s".   clock: of time stamps, such as "ms".
    rate: samples a second, Hz, of a table without a clock.   topic: of a ROS bag.

    Raises
    ------
    InputError: an unusable file, no such segment, a unit in doubt; the text names file, line or value, and the cure.
    """
    options = ReadingOptions(unit, clock, rate, topic)
    if segment is not None:
        if not isinstance(segment, str):
            SEGMENT.require("segment", segment)
        return read_chosen(path, segment_choice(segment), options)
    if has_images(path):
        from spinfilters.vision.track_images import track_images

        return track_images(Path(path)).dataset
    return read_dataset(path, options=options)


@checked_arguments(
    kind=text('the name of a kind of data set, such as "gyro"'),
    seed=number(SEED),
    frames=number(FRAMES),
    interval=number(INTERVAL),
    rate_rpm=three_numbers(RATE_RPM),
    moments=three_numbers(MOMENT),
    known_map=truth,
    gyro_bias=optional(three_numbers(GYRO_BIAS)),
    inspector=text('"static" or "circle"'),
    beside=optional(numbers_by_name('intervals in s by kind, such as {"gyro": 0.1}')),
    progress=called,
)
@on_one_blas_thread
def simulate(
    kind: str = "stereo-tracks",
    *,
    seed: int = 0,
    frames: int = 115,
    interval: float = 0.5,
    rate_rpm: Sequence[float] = DEFAULT_RATE_RPM,
    moments: Sequence[float] = DEFAULT_MOMENTS,
    known_map: bool = False,
    gyro_bias: Sequence[float] | None = None,
    inspector: str = STATIC,
    beside: Mapping[str, float] | None = None,
    progress: Progress = silent,
) -> Dataset:
    """Simulated data set with truth, as ``spinfilters simulate`` writes it.

    Body, camera, noise and disturbances are the thesis'.

    Parameters
    ----------
    kind: "stereo-tracks", "mono-tracks", "pose", "attitude", "gyro", "lidar-points", "lidar-poses" or that of an installed sensor.
    seed: of everything random.
    frames: number of epochs, at least 2.   interval: between them, s.
    rate_rpm: (3,) initial rate about the principal axes x, y, z, rpm.   moments: (3,) principal moments about them, any scale.
    known_map: whether the data set tells the landmarks' positions; of tracks only.
    gyro_bias: (3,) constant error of a gyro's rates, g axes, rad/s; of that kind only.
    inspector: "static", or "circle" of a camera that flies about the body on a known trajectory; of tracks only.
    beside: intervals, s, of other kinds of sensors that see the same motion.
    progress: called after every epoch of the motion with how many are done, and of how many.

    Raises
    ------
    InputError: an unknown kind, a number out of its range, moments of no body, more than 100 revolutions between epochs.
    """
    rate, inertia, others = tuple(rate_rpm), tuple(moments), dict(beside or {})
    _require_slow(frames, interval, rate, inertia)
    thesis = _thesis(rate, seed)
    scenario = replace(
        thesis,
        kind=kind,
        epochs=frames,
        interval=interval,
        principal_moments=inertia,
        candidates=thesis.candidates if _sees_landmarks((kind, *others), known_map) else 1,
        inspector=inspector,
        beside=tuple(others.items()),
        gyro_bias=thesis.gyro_bias if gyro_bias is None else _checked_bias(gyro_bias, (kind, *others)),
    )
    dataset = simulate_scenario(scenario, progress)
    return dataset if known_map else without_map(dataset)


def _thesis(rate_rpm: tuple[float, ...], seed: int) -> Scenario:
    """The thesis' scenario at another rate. InputError: a seed out of its range."""
    SEED.require("seed", seed)
    return Scenario.common_workload((rate_rpm[0], rate_rpm[1], rate_rpm[2]), seed)


def _sees_landmarks(kinds: Sequence[str], known_map: bool) -> bool:
    """Whether a sensor of these kinds does. InputError: a known map without one."""
    seeing = [name for name, form in dataset_kinds().items() if form.has_landmarks]
    found = any(each in seeing for each in kinds)
    if known_map and not found:
        raise InputError(f"a known map is for the kinds {' and '.join(seeing)}; a {kinds[0]} has no map")
    return found


def _require_slow(
    frames: int, interval: float, rate_rpm: tuple[float, ...], moments: tuple[float, ...]
) -> None:
    """Require a motion of at most `MOST_TURNS` revolutions between epochs. InputError: more; as `require_motion`."""
    require_motion(frames, interval, rate_rpm, moments)
    turns = max(map(abs, rate_rpm)) * interval / 60
    if turns > MOST_TURNS:
        raise InputError(
            f"a rate of {' '.join(map(str, rate_rpm))} rpm at an interval of {interval} s is {turns:.3g} revolutions between "
            f"epochs; give less than {MOST_TURNS}"
        )


def _checked_bias(bias: Sequence[float], kinds: Sequence[str]) -> tuple[float, float, float]:
    """Bias of a gyro among these kinds, rad/s. InputError: no gyro."""
    if not has_error(kinds, BIAS_BLOCK):
        raise InputError(f"a gyro's bias is for the kind gyro; a {kinds[0]} has no gyro")
    return bias[0], bias[1], bias[2]
