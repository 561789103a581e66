"""The parameters of a simulated recording, each once: default, range, help, and its key in a study file.

Python, the command line, campaigns and the analyser take them from here. Nothing heavy is imported, so that help is quick.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Annotated, Any, Final

from spinfilters.core.errors import InputError
from spinfilters.io.input_file import value_text
from spinfilters.io.stated_values import LENGTH, RATE, SPEED, Argument, NumberRange, StudyKey

if TYPE_CHECKING:
    import numpy as np
    from jaxtyping import Float

    from spinfilters.models.feature_tracks import FrontEnd, Recognition
    from spinfilters.models.process import ProcessNoise

SEED: Final = NumberRange(0, 10**18, whole=True)
FRAMES: Final = NumberRange(1, 100_000, whole=True)
INTERVAL: Final = NumberRange(1e-6, 1e5, "s")
RATE_RPM: Final = NumberRange(-1e6, 1e6, "rpm")
MOMENT: Final = NumberRange(1e-6, 1e6)
"""Of inertia, in any unit."""
GYRO_BIAS: Final = NumberRange(-100, 100, "rad/s")
STD: Final = NumberRange(1e-12, 1e6)
SIZE: Final = NumberRange(1e-3, 1e6, "m")
FARTHEST_TURN: Final = 100
"""Revolutions between epochs, at most: beyond, rounding decides where the body points."""
SHORTEST_INTERVAL: Final = 1e-6
"""Of a sensor in addition to another, s."""
IMAGE_KIND: Final = "stereo-images"
"""Kind of a recording that is rendered instead of simulated as measurements."""
RICH_RPM: Final = (4.0, 9.0, 3.0)
"""Initial rate about the principal axes of a motion in which everything is well observable."""
RECOGNITION: Final = (0.45, 1.4)
"""Shapes of the Beta distribution of how often a landmark's appearance is known again."""
_DECIMALS, _ROUNDING = 9, 1e-9  # of the epochs of several sensors, s

Rates = tuple[Annotated[float, RATE_RPM], Annotated[float, RATE_RPM], Annotated[float, RATE_RPM]]
Moments = tuple[Annotated[float, MOMENT], Annotated[float, MOMENT], Annotated[float, MOMENT]]
Place = tuple[Annotated[float, LENGTH], Annotated[float, LENGTH], Annotated[float, LENGTH]]
Velocity = tuple[Annotated[float, SPEED], Annotated[float, SPEED], Annotated[float, SPEED]]
Bias = tuple[Annotated[float, RATE], Annotated[float, RATE], Annotated[float, RATE]]


def _recognition() -> "Recognition":
    from spinfilters.models.feature_tracks import SomeAppearances

    return SomeAppearances(*RECOGNITION)


def _thesis_noise() -> "ProcessNoise":
    from spinfilters.models.process import THESIS_NOISE

    return THESIS_NOISE


@dataclass(frozen=True)
class Scenario:
    """Scenario of a simulation, by default the bundled example: the thesis' own problem (Tweddle 2013, chapter 6).

    A SPHERES-like body at 10 rpm about its intermediate axis: about 2447 landmarks with 24,723 observations in 115 epochs, 215 in
    each, at least two of each landmark; percentiles 10, 50, 90 and 99 of the observations of a landmark: 2, 8, 22 and 36. A
    landmark stays for one to five epochs of a revolution and comes back after seven to ten. Of 48 motions the first is taken that
    the disturbing force does not carry out of view. `simplified` is easier: all landmarks are recognised, less force.

    Attributes
    ----------
    kind : str
        Of data set, such as "stereo-tracks" or "gyro" (`spinfilters.io.sensor_format.dataset_kinds`), or "stereo-images".
    principal_moments : tuple[float, float, float]
        About the principal axes x, y, z, any scale (Tweddle 2013, section 6.5.2).
    rate_rpm : tuple[float, float, float]
        Initial rate about the principal axes, rpm. The default is nearly about the intermediate axis, with one flip in a minute,
        so that the attitude about the spin axis, the rates and the inertia are weakly observable; `RICH_RPM` is the opposite.
    epochs : int
        Number of epochs.
    interval : float
        Between them, s.
    range_m : float
        Distance of the centre of mass along the camera's axis, m.
    velocity : tuple[float, float, float]
        Of the centre of mass, m/s, frame i.
    center_of_mass_g : tuple[float, float, float]
        In frame g, m.
    axes_euler_g : tuple[float, float, float]
        Yaw, pitch and roll of the principal axes in g, rad.
    landmarks : int
        On the surface of a ball of ``radius_m``, seen when they face the camera.
    radius_m : float
        Of the body, m.
    detection, facing_cosine, recognition, fewest_observations : float, float, Recognition, int
        Of the simulated front end (`spinfilters.models.feature_tracks.FrontEnd`).
    pixel_std, position_std, rotation_std, gyro_std : float
        Standard deviations of the sensors' white noise: px, m, rad, rad/s.
    sensor_noise : tuple[tuple[str, float], ...]
        Option and true value of noise options (`spinfilters.io.sensor_format.noise_options`) that differ from these. Densities of
        disturbances (`spinfilters.io.disturbances.DENSITIES`) may be among them, and go into ``noise``.
    gyro_bias : tuple[float, float, float]
        Constant error of the gyro's rates, g axes, rad/s.
    noise : ProcessNoise
        Disturbances of the motion; the thesis' are `spinfilters.models.process.THESIS_NOISE`.
    candidates : int
        Motions that are drawn where a sensor sees landmarks; the first that keeps the whole body in view is taken, or the first
        of all if none does.
    inspector : str
        How the camera moves (`spinfilters.simulation.inspector.INSPECTORS`).
    inspector_errors : tuple[tuple[str, float], ...]
        Name and size of each error of the inspector's known poses (`spinfilters.simulation.inspector.INSPECTOR_ERRORS`).
    beside : tuple[tuple[str, float], ...]
        Kind and interval, s, of other sensors on the same motion; at most one sensor sees landmarks.
    seed : int
        Of everything random.

    Raises
    ------
    InputError
        An unknown kind or inspector, numbers that are no motion, a body that does not lie in front of the camera.
    """

    kind: Annotated[
        str,
        StudyKey("sensor"),
        Argument(
            "stereo-tracks (or stereo), mono-tracks (or monocular), pose, attitude, gyro, magnetometer, lidar-points, lidar-poses, "
            "or stereo-images, which are rendered",
            cure='the name of a kind of data set, such as "gyro"',
        ),
    ] = "stereo-tracks"
    principal_moments: Annotated[
        Moments,
        StudyKey("body"),
        Argument("principal moments about x, y, z, of any scale", name="moments", metavar=("JX", "JY", "JZ")),
    ] = (1.0322, 1.0, 0.8596)
    rate_rpm: Annotated[
        Rates,
        StudyKey("motion"),
        Argument("about the principal axes x, y, z in the order of --moments", metavar=("X", "Y", "Z")),
    ] = (0.5, 10.0, 0.5)
    epochs: Annotated[
        int,
        FRAMES,
        StudyKey("motion", allowed=NumberRange(5, 100_000, whole=True)),
        Argument("number of epochs", name="frames"),
    ] = 115
    interval: Annotated[
        float, INTERVAL, StudyKey("motion", "interval_s", INTERVAL), Argument("seconds between epochs")
    ] = 0.5
    range_m: Annotated[float, StudyKey("motion", allowed=SIZE)] = 0.6
    velocity: Annotated[Velocity, StudyKey("motion", "velocity_m_s")] = (0.002, 0.001, -0.001)
    center_of_mass_g: Annotated[Place, StudyKey("body", "center_of_mass_m")] = (0.02, -0.015, 0.01)
    axes_euler_g: Annotated[Place, StudyKey("body", "axes_euler_rad")] = (0.5, -0.3, 0.2)
    landmarks: Annotated[int, StudyKey("body", allowed=NumberRange(4, 100_000, whole=True))] = 4250
    radius_m: Annotated[float, StudyKey("body", allowed=SIZE)] = 0.12
    detection: Annotated[float, StudyKey("sensor", allowed=NumberRange(1e-6, 1.0))] = 0.88
    facing_cosine: Annotated[float, StudyKey("sensor", allowed=NumberRange(-1.0, 0.999))] = 0.4
    recognition: "Recognition" = field(default_factory=_recognition)
    fewest_observations: Annotated[int, StudyKey("sensor", allowed=NumberRange(0, 100_000, whole=True))] = 2
    pixel_std: Annotated[float, StudyKey("noise", allowed=STD)] = 1.0
    position_std: Annotated[float, StudyKey("noise", "position_std_m", STD)] = 0.005
    rotation_std: Annotated[float, StudyKey("noise", "rotation_std_rad", STD)] = 0.01
    gyro_std: Annotated[float, StudyKey("noise", "gyro_std_rad_s", STD)] = 0.002
    sensor_noise: Annotated[
        tuple[tuple[str, float], ...],
        Argument(
            "a noise level by the name of its setting: standard deviation of a sensor, such as gyro_noise_std 0.01, or density of "
            "a disturbance, such as torque_psd 1e-7; may be repeated",
            name="noise",
            flag="--noise",
            metavar=("NAME", "LEVEL"),
            cure="its level as a number, such as 0.01",
        ),
    ] = ()
    gyro_bias: Annotated[
        Bias,
        GYRO_BIAS,
        StudyKey("noise", "gyro_bias_rad_s"),
        Argument(
            "constant error of the gyro's rates, axes g, rad/s (with --kind gyro)", metavar=("BX", "BY", "BZ")
        ),
    ] = (0.0, 0.0, 0.0)
    noise: "ProcessNoise" = field(default_factory=_thesis_noise)
    candidates: Annotated[int, StudyKey("motion", "attempts", NumberRange(1, 10_000, whole=True))] = 48
    inspector: Annotated[
        str,
        Argument(
            "motion of the camera, written to inspector.tum: circle (about the body), sway, or dead-band (held in place by pulses "
            "of thrusters)",
            metavar="static|circle|sway|dead-band",
            cure='"static", "circle", "sway" or "dead-band"',
        ),
    ] = "static"
    inspector_errors: Annotated[
        tuple[tuple[str, float], ...],
        Argument(
            "error of inspector.tum: late S, turning RAD or drifting M over the recording, lever M, sparse S, missing; "
            "may be repeated",
            flag="--inspector-error",
            metavar=("NAME", "SIZE"),
            cure="its size as a number, such as 0.1",
            bare=0.0,
        ),
    ] = ()
    beside: Annotated[
        tuple[tuple[str, float], ...],
        Argument(
            "another sensor for the same motion, with its interval, such as gyro 0.01; may be repeated",
            metavar=("KIND", "SECONDS"),
            cure="its interval in s, such as 0.01",
        ),
    ] = ()
    seed: Annotated[int, SEED, Argument("seed of all random numbers")] = 0

    def __post_init__(self) -> None:
        from spinfilters.io.sensor_format import SensorNoise, kind_called

        object.__setattr__(self, "kind", kind_called(self.kind))
        object.__setattr__(self, "beside", tuple((kind_called(kind), step) for kind, step in self.beside))
        self._require_kinds()
        self._move_densities()
        if self.epochs < 2 or not self.interval > 0:
            raise InputError(
                f"a scenario of {self.epochs} epochs at {self.interval} s; give at least 2 epochs and a positive interval"
            )
        if self.landmarks < 4 or self.candidates < 1:
            raise InputError(
                f"landmarks {self.landmarks} must be at least 4 and candidates {self.candidates} at least 1"
            )
        _ = self.front_end, SensorNoise(dict(self.sensor_noise))  # refuses what no sensor has
        self._require_inspector()
        if not self.range_m > self.radius_m > 0:
            raise InputError(
                f"the body of radius {self.radius_m} m must lie in front of the camera, range_m is {self.range_m} m"
            )

    def _move_densities(self) -> None:
        """Densities that are given with the levels of sensors, to those of the disturbances."""
        from spinfilters.io.disturbances import DENSITIES

        own = {name: level for name, level in self.sensor_noise if name in DENSITIES}
        if own:
            rest = tuple((name, level) for name, level in self.sensor_noise if name not in own)
            object.__setattr__(self, "noise", replace(self.noise, **own))
            object.__setattr__(self, "sensor_noise", rest)

    def _require_kinds(self) -> None:
        """InputError: an unknown kind, one twice, an interval that is not positive, two sensors of landmarks."""
        from math import isfinite

        from spinfilters.io.sensor_format import dataset_kinds

        forms, kinds = dataset_kinds(), self.kinds
        for kind in kinds:
            if kind not in forms and kind != IMAGE_KIND:
                raise InputError(
                    f"kind {value_text(kind)} is unknown; use one of {', '.join([*forms, IMAGE_KIND])}"
                )
        if IMAGE_KIND in kinds and len(kinds) > 1:
            raise InputError(f"{IMAGE_KIND} are rendered alone; leave out other sensors")
        if len(set(kinds)) < len(kinds):
            raise InputError(f"a scenario of {', '.join(kinds)} holds a kind twice; name each once")
        for kind, step in self.beside:
            if not (isfinite(step) and step >= SHORTEST_INTERVAL):
                raise InputError(
                    f"{kind} every {step} s; give an interval of {SHORTEST_INTERVAL:g} s or more"
                )
        seeing = [kind for kind in kinds if kind in forms and forms[kind].has_landmarks]
        if len(seeing) > 1:
            raise InputError(f"{' and '.join(seeing)} both need a camera of their own; simulate one of them")

    def _require_inspector(self) -> None:
        """InputError: an unknown inspector, one without a camera, errors of an inspector at rest or beyond any use."""
        from spinfilters.simulation.inspector import INSPECTORS, STATIC, require_inspector_errors

        if self.inspector not in INSPECTORS:
            raise InputError(f"inspector {self.inspector!r} is unknown; use one of {', '.join(INSPECTORS)}")
        if self.inspector != STATIC and not self.sees_landmarks:
            raise InputError(f"an inspector carries a camera, and a {self.kind} has none; leave it {STATIC}")
        require_inspector_errors(dict(self.inspector_errors))
        if self.inspector_errors and self.inspector == STATIC:
            others = ", ".join(name for name in INSPECTORS if name != STATIC)
            raise InputError(f"errors are of the poses of an inspector that moves; choose one: {others}")

    @classmethod
    def simplified(cls, **changes: Any) -> "Scenario":
        """The example with all landmarks recognised and little force, or with some of the fields changed besides.

        Its 925 landmarks show about 215 an epoch, as the example's; its disturbing force is a twenty-fifth in density.
        """
        from spinfilters.models.feature_tracks import EveryAppearance
        from spinfilters.models.process import ProcessNoise

        easy = cls(
            landmarks=925,
            radius_m=0.11,
            detection=0.9,
            facing_cosine=0.35,
            recognition=EveryAppearance(),
            fewest_observations=0,
            noise=ProcessNoise(),
            candidates=1,
        )
        return replace(easy, **changes)

    @classmethod
    def rich(cls, seed: int = 0) -> "Scenario":
        """The simplified body and camera in a motion that makes everything observable."""
        return cls.simplified(rate_rpm=RICH_RPM, seed=seed)

    @classmethod
    def common_workload(cls, rate_rpm: tuple[float, float, float] = rate_rpm, seed: int = 0) -> "Scenario":
        """The bundled example at another rate: what a scenario is by default."""
        return cls(rate_rpm=rate_rpm, seed=seed)

    @property
    def kinds(self) -> tuple[str, ...]:
        """Kinds of all sensors."""
        return self.kind, *(kind for kind, _ in self.beside)

    @property
    def sees_landmarks(self) -> bool:
        """Whether one of its sensors sees landmarks, or images of them."""
        from spinfilters.io.sensor_format import dataset_kinds

        return any(kind == IMAGE_KIND or dataset_kinds()[kind].has_landmarks for kind in self.kinds)

    @property
    def times(self) -> "Mapping[str, Float[np.ndarray, ' n']]":
        """Epochs of every kind, s; those of several fall together to the bit."""
        import numpy as np

        own = self.interval * np.arange(self.epochs)
        if not self.beside:
            return {self.kind: own}
        counts = {kind: int(own[-1] / step + _ROUNDING) + 1 for kind, step in self.beside}
        more = {kind: step * np.arange(counts[kind]) for kind, step in self.beside}
        return {kind: np.round(time, _DECIMALS) for kind, time in {self.kind: own, **more}.items()}

    def level(self, option: str) -> float:
        """True value of a noise option: its own, that of the level it shares with others, or its default.

        Raises
        ------
        InputError
            An option that no sensor has.
        """
        from spinfilters.io.sensor_format import noise_options

        own = dict(self.sensor_noise)
        if option in own:
            return own[option]
        known = noise_options()
        if option not in known:
            raise InputError(f"sensor noise {option} is unknown; use {', '.join(known)}")
        chosen = known[option]
        if chosen.scene_level:
            return float(getattr(self, chosen.scene_level))
        return chosen.default if chosen.simulated is None else chosen.simulated

    @property
    def front_end(self) -> "FrontEnd":
        """The simulated front end."""
        from spinfilters.models.feature_tracks import FrontEnd

        return FrontEnd(
            self.level("pixel_std"),
            self.detection,
            self.facing_cosine,
            self.recognition,
            self.fewest_observations,
        )

    def require_slow(self) -> None:
        """InputError: more than `FARTHEST_TURN` revolutions between epochs."""
        turns = max(map(abs, self.rate_rpm)) * self.interval / 60
        if turns > FARTHEST_TURN:
            raise InputError(
                f"a rate of {' '.join(map(str, self.rate_rpm))} rpm at an interval of {self.interval} s is {turns:.3g} "
                f"revolutions between epochs; give less than {FARTHEST_TURN}"
            )


THESIS_RPM: Final = Scenario.rate_rpm
"""Initial rate about the principal axes of the thesis' experiment."""
