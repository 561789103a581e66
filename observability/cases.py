"""A question to the analyser: which sensor sees which motion, and what is known to act."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache, cached_property
from typing import Final

import numpy as np

from observability import sensors
from observability.bounds.cramer_rao import PRIOR_STD, Bound, cramer_rao_bound
from observability.bounds.flight import Flight, Watch, free_flight
from observability.certificate import Certificate, certify
from observability.charts.chart import Chart
from observability.charts.filter_state import FilterChart
from observability.charts.principal import MOMENTS, RATIOS, PrincipalChart
from observability.charts.tensor import TensorChart
from observability.motions import TEN, Motion, landmarks, point_of
from observability.rational import Rationals, as_floats, rationals
from observability.system import Input, Sensor, System
from spinfilters.errors import InputError
from spinfilters.models.measurement import MeasurementModel
from spinfilters.models.process import ProcessNoise, TorqueFreeProcess
from spinfilters.state.layout import FULL_BLOCKS, ROTATION_BLOCKS, StateLayout

SENSORS: Final = ("stereo", "monocular", "pose", "attitude", "gyro")
ROTATION_SENSORS: Final = ("attitude", "gyro")
"""Sensors that see no place: it is no unknown for them."""
CHARTS: Final = ("principal", "tensor", "filter")
ACTING: Final[tuple[Rationals, ...]] = tuple(
    rationals(each) for each in ((0.1, 0.03, -0.02), (-0.05, 0.02, 0.04), (0.02, -0.06, 0.01))
)
"""Taylor coefficients of known inputs, one after the other: something that varies, in N m or m/s^2."""


@dataclass(frozen=True)
class Case:
    """One question.

    Attributes
    ----------
    sensor: of `SENSORS`.   landmarks: how many a camera sees.   known_map: whether they are known.
    chart: of `CHARTS`.   motion: of the body.   inputs: what acts and is known; with a torque the inertia has a scale.
    """

    sensor: str = "stereo"
    landmarks: int = 4
    known_map: bool = False
    chart: str = "principal"
    motion: Motion = TEN[0]
    inputs: Sequence[Input] = field(default_factory=tuple)

    def __post_init__(self) -> None:
        for name, known in (("sensor", SENSORS), ("chart", CHARTS)):
            if getattr(self, name) not in known:
                raise InputError(f"{name} {getattr(self, name)!r} is unknown; use one of {', '.join(known)}")
        if self.landmarks < 1:
            raise InputError(f"{self.landmarks} landmarks; give at least 1")
        if self._torque and self.chart == "filter":
            raise InputError(
                "a known torque tells the scale of the inertia, which the filters' state does not hold; use another chart"
            )

    @cached_property
    def system(self) -> System:
        """What the analyser looks at."""
        return System(self._chart, [self._sensor], tuple(self.inputs))

    @property
    def point(self) -> Rationals:
        """The motion in the chart."""
        return point_of(self._chart, self.motion)

    def certificate(self) -> Certificate:
        """Of this case."""
        acting = [list(ACTING[: len(self.inputs)])] if self.inputs else []
        return certify(self.system, self.point, acting)

    def flight(self, frames: int, interval: float, noise: ProcessNoise | None = None) -> Flight:
        """The motion over frames, in the filters' state."""
        layout = self._layout
        start = as_floats(point_of(FilterChart(layout), self.motion))
        return free_flight(_process(layout, noise or ProcessNoise()), start, frames, interval)

    def bound(self, flight: Flight) -> Bound:
        """Cramer-Rao bound of the sensor, which sees everything in every frame; of a gyro the first attitude is a definition."""
        items = np.stack([as_floats(item) for item in self._sensor.parameters])
        model = _model(type(self._sensor.model), flight.process.layout)
        seen = np.ones((len(flight.time), len(items)), dtype=bool)
        prior = PRIOR_STD if self.sensor != "attitude" else {**PRIOR_STD, "a": 1.0}
        return cramer_rao_bound(flight, [Watch(model, items, self._sensor.unknown, seen)], prior)

    @cached_property
    def _chart(self) -> Chart:
        attitude, place = self.sensor != "gyro", self.sensor not in ROTATION_SENSORS
        if self.chart == "tensor":
            return TensorChart(attitude, place)
        if self.chart == "filter":
            return FilterChart(self._layout)
        return PrincipalChart(MOMENTS if self._torque else RATIOS, attitude, place)

    @property
    def _layout(self) -> StateLayout:
        return StateLayout(ROTATION_BLOCKS if self.sensor in ROTATION_SENSORS else FULL_BLOCKS)

    @property
    def _torque(self) -> bool:
        return any("torque" in each for each in self.inputs)

    @cached_property
    def _sensor(self) -> Sensor:
        if self.sensor in ("stereo", "monocular"):
            make = {"stereo": sensors.stereo, "monocular": sensors.monocular}[self.sensor]
            return make(landmarks(self.landmarks), self.known_map)
        return {"pose": sensors.pose, "attitude": sensors.attitude, "gyro": sensors.gyro}[self.sensor]()


@cache
def _process(layout: StateLayout, noise: ProcessNoise) -> TorqueFreeProcess:
    """One for all cases: its compiled functions are worth keeping."""
    return TorqueFreeProcess(layout, noise)


@cache
def _model(kind: type[MeasurementModel], layout: StateLayout) -> MeasurementModel:
    """One for all cases, as `_process`."""
    return kind(layout)
