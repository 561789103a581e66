"""Values that no reader lets through, handed to all compiled code: not finite, huge, tiny, none, one, and odd numbers of rows.

    .ci/sanitize -- .venv/bin/python -m tests.hostile.kernels [--parts filters,smoother,...]

Without the sanitizers it says only whether anything ends in an exception other than a status or a refusal. Epochs are changed
behind the readers, which refuse most of this, so that kernels get it as an estimator with a defect would hand it to them.
"""

import argparse
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Final

import numpy as np

from spinfilters.core.errors import NUMERICAL_ERRORS, InputError
from spinfilters.embedded.embedded_estimator import EmbeddedFilter
from spinfilters.embedded.embedded_options import EmbedOptions
from spinfilters.filters.ekf import MultiplicativeEkf
from spinfilters.filters.estimator import Estimator, Measurement, SensorTimeline
from spinfilters.filters.filter import MultiplicativeFilter
from spinfilters.filters.shared_modes import LandmarkOptions
from spinfilters.filters.timeline import LogTimeline, run
from spinfilters.filters.ukf import MultiplicativeUkf
from spinfilters.inference.initial_estimate import SmoothingOptions, smooth_first_epochs
from spinfilters.inference.setup import Setup
from spinfilters.lidar.mesh import TriangleMesh
from spinfilters.models.feature_tracks import Surface, facing, recognised
from spinfilters.models.process import TorqueFreeProcess
from spinfilters.models.state_layout import Gaussian
from spinfilters.run.preparation import prepare
from spinfilters.settings.run_settings import Settings
from spinfilters.simulation.lidar_scanner import ray_tracer
from spinfilters.simulation.scenario import RICH_RPM, Scenario, simulate, without_map
from spinfilters.smoother.problem import InitialGuess

REFUSALS: Final = (InputError, *NUMERICAL_ERRORS)
EPOCHS: Final = 12
FIRST_CHANGED: Final = 6
"""Epochs before it are right, so that filters have a map."""
Case = tuple[str, Callable[[], object]]
"""What it is called, and what runs it."""
NUMBERS: Final = {
    "nan": np.nan,
    "inf": np.inf,
    "-inf": -np.inf,
    "1e308": 1e308,
    "-1e308": -1e308,
    "1e19": 1e19,
    "5e-324": 5e-324,
    "0": 0.0,
}
ROWS: Final = {"none": 0, "1": 1, "2": 2, "3": 3, "7": 7, "9": 9, "17": 17}
IDS: Final = {"negative": -(2**62), "huge": 2**62, "as one": 0}


def setups() -> Iterator[tuple[str, Setup]]:
    """A recording of each sensor, and one of tracks without a map."""
    for kind in ("gyro", "pose", "attitude", "stereo-tracks", "mono-tracks"):
        scenario = Scenario.simplified(
            kind=kind, rate_rpm=RICH_RPM, epochs=EPOCHS, landmarks=40, interval=0.2, seed=1
        )
        settings = Settings(estimators=("mekf",))
        settings = replace(settings, initialisation=replace(settings.initialisation, epochs=5, share=0.5))
        recording = simulate(scenario)
        yield kind, prepare(recording, settings)
        if kind == "stereo-tracks":
            yield f"{kind} without a map", prepare(without_map(recording), settings)


def changed_timelines(timeline: LogTimeline) -> Iterator[tuple[str, LogTimeline]]:
    """The timeline with numbers, rows and ids of its later epochs changed."""
    for field in ("values", "parameters"):
        for name, number in NUMBERS.items():
            for where, place in (("all", np.s_[:]), ("one", np.s_[:1])):
                parts = [_with_number(part, field, number, place) for part in timeline.sensors]
                yield f"{field}, {where} {name}", replace(timeline, sensors=tuple(parts))
    for name, count in ROWS.items():
        yield f"rows {name}", replace(timeline, sensors=tuple(_with_rows(p, count) for p in timeline.sensors))
    for name, number in IDS.items():
        if any(part.every.ids is not None for part in timeline.sensors):
            yield (
                f"ids {name}",
                replace(timeline, sensors=tuple(_with_ids(p, number) for p in timeline.sensors)),
            )


def _with_number(part: SensorTimeline, field: str, number: float, place: slice) -> SensorTimeline:
    array = getattr(part.every, field).copy()
    for first, end in zip(part.first[FIRST_CHANGED:], part.end[FIRST_CHANGED:], strict=True):
        array[first:end][place] = number
    return replace(part, every=replace(part.every, **{field: array}))


def _with_rows(part: SensorTimeline, count: int) -> SensorTimeline:
    """So many rows of each later epoch, its own again and again where it has fewer."""
    every, rows, first, end = part.every, [], [], []
    for k, (begin, behind) in enumerate(zip(part.first.tolist(), part.end.tolist(), strict=True)):
        own = np.arange(begin, behind)
        first.append(len(rows))
        rows += np.resize(own, count).tolist() if k >= FIRST_CHANGED and len(own) else own.tolist()
        end.append(len(rows))
    ids = None if every.ids is None else every.ids[rows]
    chosen = Measurement(every.model, every.values[rows], every.parameters[rows], ids)
    return SensorTimeline(chosen, np.array(first), np.array(end))


def _with_ids(part: SensorTimeline, number: int) -> SensorTimeline:
    if part.every.ids is None:
        return part
    ids = part.every.ids.copy()
    ids[part.first[FIRST_CHANGED] :] = number + (
        np.arange(len(ids[part.first[FIRST_CHANGED] :])) if number else 0
    )
    return replace(part, every=replace(part.every, ids=ids))


def beliefs(belief: Gaussian) -> Iterator[tuple[str, Gaussian]]:
    """A belief with numbers that no estimate has."""
    for name, number in NUMBERS.items():
        mean, factor = belief.mean.copy(), belief.factor.copy()
        mean[0], factor[-1, -1] = number, number
        yield f"mean {name}", replace(belief, mean=mean)
        yield f"factor {name}", replace(belief, factor=factor)


def filter_cases() -> Iterator[Case]:
    """Both filters through changed epochs, and from changed beliefs."""
    for kind, setup in setups():
        for filter_class in (MultiplicativeEkf, MultiplicativeUkf):
            for precision in ("float64", "float32") if setup.initial.has_landmarks else ("float64",):
                title = f"{kind}, {filter_class.name}, {precision}"
                yield from _of_filter(title, filter_class, LandmarkOptions(precision=precision), setup)


def _of_filter(
    title: str, filter_class: type[MultiplicativeFilter], landmarks: LandmarkOptions, setup: Setup
) -> Iterator[Case]:
    timeline, count = setup.timeline, len(setup.initial.mean)
    assert isinstance(timeline, LogTimeline)

    def case(changed: LogTimeline, belief: Gaussian | None = None) -> Callable[[], object]:
        def passed() -> object:
            estimator = filter_class(setup.process, landmarks=landmarks)  # pyright: ignore[reportAbstractUsage]
            estimator.start(belief or setup.belief)
            _take_in_one_by_one(estimator, setup.end_of_initialisation, changed[count:])
            estimator.start(belief or setup.belief)
            return run(estimator, setup.end_of_initialisation, changed[count:])

        return passed

    for name, changed in changed_timelines(timeline):
        yield f"{title}: {name}", case(changed)
    if isinstance(setup.belief, Gaussian):
        for name, belief in beliefs(setup.belief):
            yield f"{title}: {name}", case(timeline, belief)


def _take_in_one_by_one(estimator: Estimator, time: float, epochs: LogTimeline) -> None:
    with suppress(*REFUSALS):
        for epoch in epochs:
            estimator.predict(epoch.time - time)
            for measurement in epoch.measurements:
                estimator.update(measurement)
            time = epoch.time


def smoother_cases() -> Iterator[Case]:
    """The smoother's loops on changed epochs, and from changed guesses."""
    for kind, setup in setups():
        start, timeline = setup.initial, setup.timeline
        assert isinstance(timeline, LogTimeline)
        mean = np.concatenate([start.mean, np.tile(start.mean[-1], (len(timeline) - len(start.mean), 1))])

        def case(
            changed: LogTimeline, trajectory: np.ndarray, points: np.ndarray, setup: Setup = setup
        ) -> Callable[[], object]:
            guess = InitialGuess(trajectory, setup.initial.ids, points)
            prior, process = setup.initial.prior, setup.process
            return lambda: smooth_first_epochs(process, changed, guess, prior, SmoothingOptions(iterations=4))

        for name, changed in changed_timelines(timeline):
            yield f"{kind}, smoother: {name}", case(changed, mean, start.points)
        for name, number in NUMBERS.items():
            guessed, points = mean.copy(), start.points.copy()
            guessed[3], points[:1] = number, number
            yield f"{kind}, smoother: guess {name}", case(timeline, guessed, start.points)
            if len(points):
                yield f"{kind}, smoother: points {name}", case(timeline, mean, points)
        for count in (2, 3):
            yield f"{kind}, smoother: {count} epochs", case(timeline[:count], mean[:count], start.points)


def embedded_cases() -> Iterator[Case]:
    """The C filter of each sensor in both precisions."""
    for kind, setup in setups():
        sensor = {"stereo-tracks": "stereo", "stereo-tracks without a map": "stereo"}.get(kind, kind)
        if sensor not in ("stereo", "gyro", "pose"):
            continue
        for real in ("double", "float"):
            for slots in (400, 5) if sensor == "stereo" else (400,):
                options = EmbedOptions(sensor, slots, real, 4)  # pyright: ignore[reportArgumentType]
                process = TorqueFreeProcess(options.layout, setup.process.noise)
                if process.layout == setup.process.layout:
                    yield from _of_embedded(f"{kind}, C {real}, {slots} landmarks", process, options, setup)


def _of_embedded(
    title: str, process: TorqueFreeProcess, options: EmbedOptions, setup: Setup
) -> Iterator[Case]:
    timeline, count = setup.timeline, len(setup.initial.mean)
    assert isinstance(timeline, LogTimeline)

    def case(changed: LogTimeline, factor: float = 1.0) -> Callable[[], object]:
        def passed() -> object:
            estimator = EmbeddedFilter(process, options)
            estimator.start(setup.belief)
            for dt in (0.0, factor * 1e-3):
                estimator.predict(dt)
            _take_in_one_by_one(estimator, setup.end_of_initialisation, changed[count:])
            return estimator.belief

        return passed

    for name, changed in changed_timelines(timeline):
        yield f"{title}: {name}", case(changed)
    for name, number in NUMBERS.items():
        yield f"{title}: time step {name}", case(timeline, number)


def visibility_cases() -> Iterator[Case]:
    """Which landmarks face a camera and are recognised, of no, one and many epochs and landmarks."""
    generator = np.random.default_rng(0)
    for epochs in (0, 1, 3):
        for count in (0, 1, 7, 8, 9, 63, 65):
            points, drawn = generator.standard_normal((count, 3)), generator.random((epochs, count))
            turned, places = np.tile(np.eye(3), (epochs, 1, 1)), generator.standard_normal((epochs, 3))
            visible = drawn < 0.5
            yield (
                f"visibility: {epochs} epochs, {count} landmarks",
                lambda p=points, t=turned, o=places: facing(0.2, Surface(p, p), t, o),
            )
            yield (
                f"recognised: {epochs} epochs, {count} landmarks",
                lambda v=visible, d=drawn, c=count: recognised(v, d, np.full(c, 0.5)),
            )
    for name, number in NUMBERS.items():
        points, turned = np.full((9, 3), number), np.full((2, 3, 3), number)
        yield (
            f"visibility: {name}",
            lambda p=points, t=turned, x=number: facing(x, Surface(p, p), t, np.full((2, 3), x)),
        )


def tracer_cases() -> Iterator[Case]:
    """Rays on meshes that are flat, of one triangle, of many alike, far and huge."""
    corner = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    shapes = {
        "one triangle": np.array([[0, 1, 2]]),
        "a point": np.array([[0, 0, 0]]),
        "a hundred alike": np.tile([[0, 1, 2]], (100, 1)),
        "a tetrahedron": np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]),
    }
    for title, triangles in shapes.items():
        for scale in (1.0, 1e-300, 1e150, 1e300):
            for rays in (0, 1, 5, 4097):
                for name, number in {"right": 1.0, **NUMBERS}.items():
                    if rays > 5 and name not in ("right", "nan"):
                        continue
                    yield (
                        f"rays: {title} times {scale:g}, {rays} of {name}",
                        lambda t=triangles, s=scale, r=rays, x=number: ray_tracer(
                            TriangleMesh(s * corner, t)
                        ).hits(np.full((r, 3), x), np.full((r, 3), -x)),
                    )


PARTS: Final = {
    "filters": filter_cases,
    "smoother": smoother_cases,
    "embedded": embedded_cases,
    "visibility": visibility_cases,
    "rays": tracer_cases,
}


def failures(parts: Sequence[str]) -> list[str]:
    """Run all cases of these parts, and say which ended in an exception that is no refusal."""
    found, count = [], 0
    with np.errstate(all="ignore"):
        for part in parts:
            for name, case in PARTS[part]():
                count += 1
                try:
                    case()
                except REFUSALS:
                    continue
                except Exception as error:
                    found.append(f"{name}: {error!r}")
    print(f"{count} inputs of {', '.join(parts)}: {len(found)} ended in other exceptions")
    return found


def main() -> int:
    """Print what failed."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--parts", default=",".join(PARTS))
    found = failures(parser.parse_args().parts.split(","))
    print("\n".join(found))
    return bool(found)


if __name__ == "__main__":
    sys.exit(main())
