"""Data sets that are simulated."""

from collections.abc import Mapping, Sequence

from spinfilters.api.blas_threads import on_one_blas_thread
from spinfilters.core.errors import InputError
from spinfilters.io.argument_checks import called, checked_arguments, optional, three_numbers, truth
from spinfilters.io.dataset import Dataset
from spinfilters.io.disturbances import DENSITIES
from spinfilters.io.sensor_format import dataset_kinds
from spinfilters.models.sensor_registry import has_error
from spinfilters.models.state_blocks import GYRO_BIAS as BIAS_BLOCK
from spinfilters.simulation.scenario import Progress, Scenario, silent, without_map
from spinfilters.simulation.scenario import simulate as simulate_scenario
from spinfilters.simulation.scenario_record import GYRO_BIAS


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
    noise: Mapping[str, float] | None = None,
    inspector: str = Scenario.inspector,
    inspector_errors: Mapping[str, float] | None = None,
    beside: Mapping[str, float] | None = None,
    progress: Progress = silent,
) -> Dataset:
    """Simulated data set with truth, as ``spinfilters simulate`` writes it; body, camera and default noise are the thesis'.

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
    noise : Mapping[str, float] or None
        True noise levels by the names of their settings: standard deviations of the sensors that are simulated, such as
        ``{"gyro_noise_std": 0.01}``, and densities of disturbances, ``force_psd`` (m/s^2)^2/Hz and ``torque_psd`` (rad/s^2)^2/Hz.
        Others have their defaults. The data set states all of them.
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
        sensor_noise=tuple((noise or {}).items()),
        seed=seed,
    )
    return simulated_dataset(scenario, known_map, progress)


def simulated_dataset(scenario: Scenario, known_map: bool, progress: Progress) -> Dataset:
    """Data set of a scenario, with the map of its landmarks where that is to be known.

    Raises
    ------
    InputError
        More than 100 revolutions between epochs, a map, a bias or a noise level without a sensor that has one.
    """
    scenario.require_slow()
    _require_levels(scenario)
    seeing = [name for name, form in dataset_kinds().items() if form.has_landmarks]
    if known_map and not any(each in seeing for each in scenario.kinds):
        raise InputError(f"a known map is for the kinds {' and '.join(seeing)}; a {scenario.kind} has no map")
    if any(scenario.gyro_bias):
        _require_gyro(scenario.kinds)
    dataset = simulate_scenario(scenario, progress)
    return dataset if known_map else without_map(dataset)


def _require_levels(scenario: Scenario) -> None:
    """InputError: a noise level of a sensor that is not simulated."""
    known = [option.name for kind in scenario.kinds for option in dataset_kinds()[kind].noise]
    for name, _ in scenario.sensor_noise:
        if name not in known:
            levels = ", ".join([*known, *DENSITIES])
            raise InputError(f"noise {name} is of no sensor of this recording; give one of {levels}")


def _require_gyro(kinds: Sequence[str]) -> None:
    """InputError: a bias without a gyro."""
    if not has_error(kinds, BIAS_BLOCK):
        raise InputError(f"a gyro's bias is for the kind gyro; a {kinds[0]} has no gyro")


def _triple(numbers: Sequence[float]) -> tuple[float, float, float]:
    return numbers[0], numbers[1], numbers[2]
