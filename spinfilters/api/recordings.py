"""Data sets: read from files, or simulated."""

import os
from collections.abc import Mapping, Sequence
from pathlib import Path

from spinfilters.api.argument_ranges import FRAMES, GYRO_BIAS, MOMENT, SEED, SEGMENT, require_motion
from spinfilters.api.argument_ranges import INTERVAL as INTERVALS
from spinfilters.api.argument_ranges import RATE_RPM as RATES
from spinfilters.api.blas_threads import on_one_blas_thread
from spinfilters.core.errors import InputError
from spinfilters.io.argument_checks import (
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
from spinfilters.io.argument_checks import path as path_of
from spinfilters.io.dataset import Dataset
from spinfilters.io.dataset_reader import IMAGES, has_images
from spinfilters.io.sensor_format import dataset_kinds
from spinfilters.io.stated_values import SAMPLING_RATE, ReadingOptions
from spinfilters.models.sensor_registry import has_error
from spinfilters.models.state_blocks import GYRO_BIAS as BIAS_BLOCK
from spinfilters.run.readers import read_dataset
from spinfilters.run.segment_choice import read_chosen, segment_choice
from spinfilters.simulation.bundled_example import EPOCHS, INTERVAL, PRINCIPAL_MOMENTS, RATE_RPM
from spinfilters.simulation.inspector import STATIC
from spinfilters.simulation.scenario import Progress, Scenario, silent, without_map
from spinfilters.simulation.scenario import simulate as simulate_scenario

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
        options.require_only((), IMAGES)
        from spinfilters.vision.track_images import track_images

        return track_images(Path(path)).dataset
    return read_dataset(path, options=options)


@checked_arguments(
    kind=text('the name of a kind of data set, such as "gyro"'),
    seed=number(SEED),
    frames=number(FRAMES),
    interval=number(INTERVALS),
    rate_rpm=three_numbers(RATES),
    moments=three_numbers(MOMENT),
    known_map=truth,
    gyro_bias=optional(three_numbers(GYRO_BIAS)),
    inspector=text('"static", "circle", "sway" or "dead-band"'),
    inspector_errors=optional(numbers_by_name('sizes by name, such as {"late": 0.1}')),
    beside=optional(numbers_by_name('intervals in s by kind, such as {"gyro": 0.1}')),
    progress=called,
)
@on_one_blas_thread
def simulate(
    kind: str = "stereo-tracks",
    *,
    seed: int = 0,
    frames: int = EPOCHS,
    interval: float = INTERVAL,
    rate_rpm: Sequence[float] = RATE_RPM,
    moments: Sequence[float] = PRINCIPAL_MOMENTS,
    known_map: bool = False,
    gyro_bias: Sequence[float] | None = None,
    inspector: str = STATIC,
    inspector_errors: Mapping[str, float] | None = None,
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
    inspector: "static", or how the camera moves on a known trajectory: "circle" about the body, "sway", or "dead-band" of thrusters
        that fire at the edges of one; of tracks only.
    inspector_errors: sizes, by name, of what is wrong with its poses: "late" s, "turning" rad and "drifting" m over the recording,
        "lever" m from the camera, "sparse" s between them, "missing" (any size). Nothing is stated then of how well they are known.
    beside: intervals, s, of other kinds of sensors that see the same motion.
    progress: called after every epoch of the motion with how many are done, and of how many.

    Raises
    ------
    InputError: an unknown kind, a number out of its range, moments of no body, more than 100 revolutions between epochs.
    """
    rate, inertia, others = tuple(rate_rpm), tuple(moments), dict(beside or {})
    _require_slow(frames, interval, rate, inertia)
    _require_map(known_map, (kind, *others))
    SEED.require("seed", seed)
    scenario = Scenario(
        kind=kind,
        epochs=frames,
        interval=interval,
        rate_rpm=(rate[0], rate[1], rate[2]),
        principal_moments=(inertia[0], inertia[1], inertia[2]),
        inspector=inspector,
        inspector_errors=tuple((inspector_errors or {}).items()),
        beside=tuple(others.items()),
        gyro_bias=Scenario.gyro_bias if gyro_bias is None else _checked_bias(gyro_bias, (kind, *others)),
        seed=seed,
    )
    dataset = simulate_scenario(scenario, progress)
    return dataset if known_map else without_map(dataset)


def _require_map(known_map: bool, kinds: Sequence[str]) -> None:
    """InputError: a known map without a sensor that sees landmarks."""
    seeing = [name for name, form in dataset_kinds().items() if form.has_landmarks]
    if known_map and not any(each in seeing for each in kinds):
        raise InputError(f"a known map is for the kinds {' and '.join(seeing)}; a {kinds[0]} has no map")


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
