"""Case of the analyser: sensors, motion and known inputs."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from typing import Final

import numpy as np
from jaxtyping import Float

from observability.body_model import InputSeries, body_rank
from observability.canonical_motions import CANONICAL_MOTIONS as MOTIONS
from observability.canonical_motions import CanonicalMotion, landmarks, point_of, principal_axes
from observability.certificate import STEADY_ORDERS, Certificate, certify
from observability.coordinates import MOMENTS, RATIOS, Chart, FilterChart, PrincipalChart, TensorChart
from observability.cramer_rao import (
    LANDMARK_STD,
    PRIOR_STD,
    Bound,
    Deviations,
    cramer_rao_bound,
    later_covariances,
)
from observability.exact_numbers import Rationals, as_floats, rationals
from observability.explanation import tangent_symmetries
from observability.reference_trajectory import (
    DrivenMotion,
    InputSizes,
    KnownInput,
    RecordedInput,
    ReferenceTrajectory,
    SensorSchedule,
    driven_reference,
    free_reference,
)
from observability.symmetry import AXES, rotation_of_g
from observability.system import Input, System, SystemSensor, analysed, watching
from spinfilters.core.attitude_conversions import matrix_from_quaternion
from spinfilters.core.errors import InputError
from spinfilters.core.mass_distribution import inertia_matrix
from spinfilters.core.working_time import built_property
from spinfilters.io.sensor_format import sensor_called
from spinfilters.models.process import THESIS_NOISE, ProcessNoise, TorqueFreeProcess
from spinfilters.models.sensor import model_over
from spinfilters.models.state_blocks import GYRO_BIAS
from spinfilters.models.state_layout import FULL_BLOCKS, ROTATION_BLOCKS, StateLayout

CHARTS: Final = ("principal", "tensor", "filter")
UNKNOWNS: Final = ("ratios", "moments")
"""What the principal chart holds of the inertia: two ratios, or three moments with their scale."""
ACTING: Final[tuple[Rationals, ...]] = tuple(
    rationals(each) for each in ((0.1, 0.03, -0.02), (-0.05, 0.02, 0.04), (0.02, -0.06, 0.01))
)
"""Taylor coefficients of known inputs, one after the other: something that varies, in N m or m/s^2."""
NOTHING: Final = rationals((0.0, 0.0))
"""Taylor coefficients after the first of an input that does not vary."""
WIDE_POSE_STD: Final = {"t": 1.0, "a": 1.0}
"""Prior of the first pose of g where it is no definition, m and rad."""
LONGEST_DRIFT: Final = 0.25
"""Way in m that the body drifts in a flight: in a long one its velocity is less, so that it stays in view."""
NEAREST_LANDMARK: Final = 0.05
"""Depth in m that a manoeuvre must leave every landmark."""


@dataclass(frozen=True)
class Levels:
    """Noise, disturbances and priors that a bound is computed with.

    Attributes
    ----------
    noise : Mapping[str, float]
        Standard deviations of the sensors by noise option, such as pixel_std; the analyser's own where none is given.
    process : ProcessNoise
        Densities of the disturbances; by default those of the bundled example.
    prior_std : Mapping[str, float]
        Standard deviations of the first state by block, in place of those of `PRIOR_STD` and `WIDE_POSE_STD`.
    landmark_std : float
        Of the prior of an unknown landmark's coordinates, m.
    gyro_bias_std : float
        Of the prior of a gyro's bias, rad/s; 0 for no bias.
    """

    noise: Mapping[str, float] = field(default_factory=dict)
    process: ProcessNoise = THESIS_NOISE
    prior_std: Mapping[str, float] = field(default_factory=dict)
    landmark_std: float = LANDMARK_STD
    gyro_bias_std: float = 0.0


@dataclass(frozen=True)
class Case:
    """One case of the analyser.

    Attributes
    ----------
    sensors : tuple[str, ...]
        Of `analysed_sensors`.
    landmarks : int
        How many each camera or lidar sees.
    known_map : bool
        Whether they are known.
    chart : str
        Of `CHARTS`.
    unknowns : str
        Of `UNKNOWNS`, in the principal chart; a torque asks for moments.
    motion : CanonicalMotion
        Of the body.
    inputs : Sequence[Input]
        What acts and is known; with a torque the inertia has a scale.
    sizes : InputSizes
        Of the inputs.
    levels : Levels
        Of noise, disturbances and priors in the bound.
    recorded : Sequence[RecordedInput]
        The inputs over time, in their order, where a table gives them; without any they are cosines of those sizes.
    """

    sensors: tuple[str, ...] = ("stereo-tracks",)
    landmarks: int = 4
    known_map: bool = False
    chart: str = "principal"
    unknowns: str = "ratios"
    motion: CanonicalMotion = MOTIONS[0]
    inputs: Sequence[Input] = field(default_factory=tuple)
    sizes: InputSizes = field(default_factory=InputSizes)
    levels: Levels = field(default_factory=Levels)
    recorded: Sequence[RecordedInput] = field(default_factory=tuple)

    def __post_init__(self) -> None:
        object.__setattr__(self, "sensors", tuple(sensor_called(each) for each in self.sensors))
        for each in self.sensors:
            _ = analysed(each)  # refuses what cannot be
        for name, value, known in (("chart", self.chart, CHARTS), ("unknowns", self.unknowns, UNKNOWNS)):
            if value not in known:
                raise InputError(f"{name} {value!r} is unknown; use one of {', '.join(known)}")
        if len(set(self.sensors)) != len(self.sensors) or not self.sensors:
            raise InputError(f"sensors {', '.join(self.sensors) or 'none'}; give each once, and at least one")
        if self.landmarks < 1:
            raise InputError(f"{self.landmarks} landmarks; give at least 1")
        if self.has_torque and self.chart == "filter":
            raise InputError(
                "a known torque determines the scale of the inertia, which the filters' state does not hold; use another chart"
            )
        if self.has_bias and (
            self.chart != "filter" or not any(analysed(each).bias for each in self.sensors)
        ):
            raise InputError(
                "a gyro's bias is an unknown of the filters' state with a gyro; use --chart filter and the sensor gyro, or leave "
                "out gyro_bias_std"
            )
        if self.unknowns == "moments" and self.chart != "principal":
            raise InputError(
                f"the three moments are unknowns of the chart principal, not of {self.chart}; leave out --unknowns or --chart"
            )

    @property
    def has_torque(self) -> bool:
        """Whether a torque is known."""
        return any(each.is_torque for each in self.inputs)

    @property
    def has_bias(self) -> bool:
        """Whether a gyro's bias is one of the unknowns."""
        return self.levels.gyro_bias_std > 0

    @property
    def has_place(self) -> bool:
        """Whether place, velocity and centre of mass are unknowns."""
        return self._needs("t")

    @property
    def has_attitude(self) -> bool:
        """Whether the attitude is an unknown: a gyro alone does not see it."""
        return self._needs("a")

    @property
    def holds_attitude(self) -> bool:
        """Whether the chart holds the attitude: the filters' state always does."""
        return self.has_attitude or self.chart == "filter"

    @property
    def maps(self) -> bool:
        """Whether landmarks are unknowns."""
        return self.sees_points and not self.known_map

    @property
    def sees_points(self) -> bool:
        """Whether a sensor sees landmarks."""
        return any(analysed(each).sees_points for each in self.sensors)

    @property
    def holds_scale(self) -> bool:
        """Whether the scale of the inertia is an unknown."""
        return self.has_torque or self.chart == "tensor" or self.unknowns == "moments"

    @property
    def place_is_defined(self) -> bool:
        """Whether g's first place is a definition: no map, no pose."""
        return self.has_place and not self._sees_known_points and not self._measures_block("t")

    @built_property
    def free_rotations(self) -> tuple[int, ...]:
        """Principal axes about which the attitude of g is free: no output notices a rotation of g about them.

        A torque, a rate or a field that is known in g leaves at most a rotation about itself. Where no sensor sees the attitude,
        that of the first epoch is a definition as a whole.
        """
        if not self.has_attitude:
            return (0, 1, 2)
        system = self.filter_system
        point = point_of(system.chart, self.motion)
        exact = body_rank(system, point, STEADY_ORDERS, self.experiments)
        unseen = {each.name for each in tangent_symmetries(system, point, exact).symmetries}
        return tuple(axis for axis in range(3) if rotation_of_g(AXES[axis]) in unseen)

    @property
    def defined(self) -> tuple[int, ...]:
        """Components of the first pose of g that are fixed by definition."""
        every = range(self.layout.error_dim)
        place = every[self.layout.slice("t")] if self.place_is_defined else ()
        attitude = every[self.layout.slice("a")]
        return (*place, *(attitude[axis] for axis in self.free_rotations))

    @built_property
    def system(self) -> System:
        """System that the analyser examines."""
        return self._system(self._chart)

    @built_property
    def filter_system(self) -> System:
        """The system in the filters' state, with the inertia's scale under torques."""
        return self._system(FilterChart(self.layout, self.has_torque))

    @property
    def point(self) -> Rationals:
        """The motion in the chart."""
        return point_of(self._chart, self.motion)

    @property
    def experiments(self) -> Sequence[InputSeries]:
        """Taylor series of the known inputs."""
        if not self.inputs:
            return []
        constant = [each.is_constant for each in self.recorded] or [False] * len(self.inputs)
        series = [ACTING[k % len(ACTING)] for k in range(len(self.inputs))]
        return [[(row[0], *NOTHING) if still else row for row, still in zip(series, constant, strict=True)]]

    @property
    def layout(self) -> StateLayout:
        """Layout of the filters' state."""
        layout = StateLayout(FULL_BLOCKS if self.has_place else ROTATION_BLOCKS)
        return layout.joined(GYRO_BIAS) if self.has_bias else layout

    def certificate(self) -> Certificate:
        """Certificate of this case."""
        return certify(self.system, self.point, self.experiments)

    def reference(
        self, frames: int, interval: float, noise: ProcessNoise | None = None
    ) -> ReferenceTrajectory:
        """The motion over frames, s apart, in the filters' state.

        Raises
        ------
        InputError
            No frames, or a manoeuvre that leaves a camera without the body.
        """
        process = _process(self.layout, noise or self.levels.process)
        start = self._start(frames, interval)
        if not self.inputs or frames < 1:
            return free_reference(process, start, frames, interval)
        driven = DrivenMotion(process, self.acting, self._inertia_scale(start))
        reference = driven_reference(process, start, interval * np.arange(frames), driven)
        self._check_view(reference)
        return reference

    @property
    def acting(self) -> list[KnownInput | RecordedInput]:
        """The known inputs as functions of time; each further cosine is faster, so that they differ."""
        if self.recorded:
            return list(self.recorded)
        found: list[KnownInput | RecordedInput] = []
        for index, each in enumerate(self.inputs):
            size = self.sizes.torque if each.is_torque else self.sizes.manoeuvre
            found.append(KnownInput(each, size, self.sizes.period / (1 + index / 2)))
        return found

    def bound(self, reference: ReferenceTrajectory) -> Bound:
        """Cramer-Rao bound of the sensors, which see everything in every frame."""
        schedules = self._schedules(reference)
        return cramer_rao_bound(reference, schedules, self.prior_std, self.levels.landmark_std, self.defined)

    def later_covariances(
        self, reference: ReferenceTrajectory, frames: Sequence[int], prior: Float[np.ndarray, " n"]
    ) -> Iterator[tuple[Float[np.ndarray, "e e"], Float[np.ndarray, "e e"]]]:
        """The same at some frames of a long flight (`observability.cramer_rao.later_covariances`)."""
        return later_covariances(reference, self._schedules(reference), frames, prior, self.defined)

    def _schedules(self, reference: ReferenceTrajectory) -> list[SensorSchedule]:
        schedules = []
        for sensor in self._sensors:
            items = np.stack([as_floats(item) for item in sensor.parameters])
            model = model_over(type(sensor.model), reference.process.layout)
            seen = np.ones((len(reference.time), len(items)), dtype=bool)
            schedules.append(SensorSchedule(model, items, sensor.unknown, seen))
        return schedules

    @property
    def prior_std(self) -> Deviations:
        """Prior standard deviations of every block in the first epoch."""
        wide = {**PRIOR_STD, **WIDE_POSE_STD, **self.levels.prior_std, "b": self.levels.gyro_bias_std}
        place = PRIOR_STD["t"] if self.place_is_defined else wide["t"]
        attitude = np.full(3, wide["a"])
        attitude[list(self.free_rotations)] = PRIOR_STD["a"]
        return {**wide, "t": place, "a": attitude}

    @property
    def _sees_known_points(self) -> bool:
        return self.known_map and self.sees_points

    def _needs(self, block: str) -> bool:
        """Whether a sensor depends on a block of the filters' state."""
        return any(block in analysed(each).model.needs for each in self.sensors)

    def _measures_block(self, block: str) -> bool:
        """Whether a sensor measures a block in axes that are known."""
        return any(block in analysed(each).tells for each in self.sensors)

    def _system(self, chart: Chart) -> System:
        return System(chart, self._sensors, tuple(self.inputs), principal_axes(chart))

    @built_property
    def _chart(self) -> Chart:
        if self.chart == "tensor":
            return TensorChart(self.has_attitude, self.has_place)
        if self.chart == "filter":
            return FilterChart(self.layout)
        return PrincipalChart(MOMENTS if self.holds_scale else RATIOS, self.has_attitude, self.has_place)

    @built_property
    def _sensors(self) -> list[SystemSensor]:
        seeing = [each for each in self.sensors if analysed(each).sees_points]
        others = [each for each in self.sensors if each not in seeing]
        seen = [landmarks(self.landmarks, seed) for seed in range(len(seeing))]
        levels = self.levels.noise
        found = [watching(*each, self.known_map, levels) for each in zip(seeing, seen, strict=True)]
        return found + [watching(each, noise=levels, layout=self.layout) for each in others]

    def _start(self, frames: int, interval: float) -> Float[np.ndarray, " m"]:
        start = as_floats(point_of(FilterChart(self.layout), self.motion))
        if self.has_place:
            where = self.layout.mean_slice("v")
            way = float(np.linalg.norm(start[where])) * frames * interval
            start[where] *= min(1.0, LONGEST_DRIFT / way) if way > 0 else 1.0
        return start

    def _inertia_scale(self, start: Float[np.ndarray, " m"]) -> float:
        return float(self.motion.moments[0]) / float(inertia_matrix(start[self.layout.mean_slice("s")])[0, 0])

    def _check_view(self, reference: ReferenceTrajectory) -> None:
        """Landmarks that a camera would pass have no image."""
        if not self.has_place:
            return
        R = matrix_from_quaternion(reference.states[:, self.layout.mean_slice("a")])
        depth = reference.states[:, self.layout.mean_slice("t")][:, 2]
        for sensor in self._sensors:
            if analysed(sensor.model.name).has_image:
                points = np.stack([as_floats(item)[:3] for item in sensor.parameters])
                if np.min(depth[:, np.newaxis] + R[:, 2] @ points.T) < NEAREST_LANDMARK:
                    raise InputError(
                        f"a manoeuvre of {self.sizes.manoeuvre:g} m/s^2 and a period of {self.sizes.period:g} s carries the "
                        "camera past the body; give a smaller --manoeuvre-size or a shorter --input-period"
                    )


@cache
def _process(layout: StateLayout, noise: ProcessNoise) -> TorqueFreeProcess:
    """Process shared by all cases: its compiled functions are worth keeping."""
    return TorqueFreeProcess(layout, noise)
