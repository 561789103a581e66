"""Simulated recordings whose stated noise and model are true.

Motions, lengths, noise and stamps that try estimators.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from spinfilters.core.attitude_conversions import matrix_from_quaternion, quaternion_from_euler321
from spinfilters.core.conventions import RPM
from spinfilters.core.mass_distribution import from_inertia
from spinfilters.io.consider_parameter import exact_calibration
from spinfilters.io.dataset import Dataset, DatasetOptions
from spinfilters.io.measurement_log import MeasurementLog, MeasurementStream
from spinfilters.models.process import ProcessNoise, TorqueFreeProcess
from spinfilters.models.state_layout import FULL_BLOCKS, StateLayout
from spinfilters.simulation.scenario import RICH_RPM, THESIS_RPM, simulate_motion

FREE = 1e-12
"""Densities of a motion that hardly anything disturbs, (rad/s^2)^2/Hz and (m/s^2)^2/Hz."""
LAYOUT = StateLayout((*FULL_BLOCKS, "d"))
AXES_EULER_G, CENTRE, PLACE = (0.5, -0.3, 0.2), (0.02, -0.015, 0.01), (0.0, 0.0, 0.6)
SPHERES = (1.0322, 1.0, 0.8596)
POSITION_PER_ROTATION = 0.5
"""Standard deviation of a pose's position over that of its rotation, m/rad."""


@dataclass(frozen=True)
class RecordingCase:
    """One kind of recording.

    Attributes
    ----------
    kind: "gyro" or "pose".   moments: principal ones, any scale.   rate_rpm: at first, about the principal axes.
    noise_std: rad/s of a gyro, rad of a pose's rotation.   psd: of torque and force, true and stated.
    jitter: of the time stamps, uniform, in intervals.   dropped: share of the samples that are lost.   drag: 1/rad.
    """

    name: str
    kind: str = "gyro"
    moments: tuple[float, float, float] = SPHERES
    rate_rpm: tuple[float, float, float] = RICH_RPM
    epochs: int = 200
    interval: float = 0.5
    noise_std: float = 0.01
    psd: float = 1e-6
    jitter: float = 0.0
    dropped: float = 0.0
    drag: float = 0.0


@dataclass(frozen=True)
class Recording:
    """A data set, and the true states (n, m) of `LAYOUT` at its n time stamps."""

    dataset: Dataset
    states: Float[np.ndarray, "n m"]


CASES = (
    RecordingCase("gyro rich"),
    RecordingCase("gyro thesis", rate_rpm=THESIS_RPM),
    RecordingCase("gyro slow", rate_rpm=(0.4, 0.9, 0.3), noise_std=0.002, psd=1e-8),
    RecordingCase("gyro fast", rate_rpm=(80.0, 180.0, 60.0), interval=0.01, epochs=1000),
    RecordingCase("gyro flip", rate_rpm=(0.02, 10.0, 0.02), psd=1e-10, epochs=400),
    RecordingCase("gyro near-axisymmetric", moments=(1.0, 0.995, 0.6)),
    RecordingCase("gyro near-spherical", moments=(1.0, 0.99, 0.98)),
    RecordingCase("gyro plate", moments=(1.0, 0.6, 0.402)),
    RecordingCase("gyro rod", moments=(1.0, 0.99, 0.02)),
    RecordingCase("gyro near major axis", rate_rpm=(9.0, 0.6, 0.4)),
    RecordingCase("gyro hard steady, major", rate_rpm=(9.0, 0.0, 0.0), psd=1e-8),
    RecordingCase("gyro hard steady, minor", rate_rpm=(0.0, 0.0, 9.0), psd=1e-8),
    RecordingCase("gyro hard steady, middle", rate_rpm=(0.0, 9.0, 0.0), psd=FREE),
    RecordingCase("gyro hard sphere", moments=(1.0, 1.0, 1.0)),
    RecordingCase("gyro hard near-sphere", moments=(1.0, 0.999, 0.998)),
    RecordingCase("gyro hard plate", moments=(1.0, 0.501, 0.5)),
    RecordingCase("gyro hard needle", moments=(1.0, 0.999, 0.01)),
    RecordingCase("gyro 20 samples", epochs=20),
    RecordingCase("gyro 50 samples", epochs=50),
    RecordingCase("gyro 100 samples", epochs=100),
    RecordingCase("gyro thesis 50 samples", rate_rpm=THESIS_RPM, epochs=50),
    RecordingCase("gyro 100 Hz", rate_rpm=THESIS_RPM, interval=0.02, epochs=1000, noise_std=0.002),
    RecordingCase("gyro free, long", epochs=3000, psd=FREE),
    RecordingCase("gyro free, thesis, long", rate_rpm=THESIS_RPM, interval=0.1, epochs=3000, psd=FREE),
    RecordingCase("gyro noise 1e-6", noise_std=1e-6),
    RecordingCase("gyro noise 1e-6, free", noise_std=1e-6, psd=FREE),
    RecordingCase("gyro noise 0.3", noise_std=0.3, epochs=1000, psd=1e-8),
    RecordingCase("gyro drag", drag=0.005),
    RecordingCase("gyro irregular", jitter=0.45),
    RecordingCase("gyro dropped", dropped=0.5, epochs=400),
    RecordingCase("pose rich", kind="pose"),
    RecordingCase("pose thesis", kind="pose", rate_rpm=THESIS_RPM),
    RecordingCase("pose slow", kind="pose", rate_rpm=(0.4, 0.9, 0.3), psd=1e-8),
    RecordingCase("pose flip", kind="pose", rate_rpm=(0.02, 10.0, 0.02), psd=1e-10),
    RecordingCase("pose near-axisymmetric", kind="pose", moments=(1.0, 0.995, 0.6)),
    RecordingCase("pose near-spherical", kind="pose", moments=(1.0, 0.99, 0.98)),
    RecordingCase("pose plate", kind="pose", moments=(1.0, 0.6, 0.402)),
    RecordingCase("pose hard steady, major", kind="pose", rate_rpm=(9.0, 0.0, 0.0), psd=1e-8),
    RecordingCase("pose hard steady, minor", kind="pose", rate_rpm=(0.0, 0.0, 9.0), psd=1e-8),
    RecordingCase("pose hard steady, middle", kind="pose", rate_rpm=(0.0, 9.0, 0.0), psd=FREE),
    RecordingCase("pose hard sphere", kind="pose", moments=(1.0, 1.0, 1.0)),
    RecordingCase("pose hard near-sphere", kind="pose", moments=(1.0, 0.999, 0.998)),
    RecordingCase("pose hard plate", kind="pose", moments=(1.0, 0.501, 0.5)),
    RecordingCase("pose hard needle", kind="pose", moments=(1.0, 0.999, 0.01)),
    RecordingCase("pose 20 epochs", kind="pose", epochs=20),
    RecordingCase("pose 50 epochs", kind="pose", epochs=50),
    RecordingCase("pose thesis 100 epochs", kind="pose", rate_rpm=THESIS_RPM, epochs=100),
    RecordingCase("pose free, long", kind="pose", epochs=2000, psd=FREE),
    RecordingCase("pose noise 1e-6", kind="pose", noise_std=1e-6),
    RecordingCase("pose noise 0.3", kind="pose", noise_std=0.3, epochs=400, psd=1e-8),
    RecordingCase("pose drag", kind="pose", drag=0.005),
    RecordingCase("pose irregular", kind="pose", jitter=0.45),
    RecordingCase("pose dropped", kind="pose", dropped=0.5, epochs=400),
)


def recordings(case: RecordingCase, seeds: int) -> list[Recording]:
    """So many recordings of a case; the draws depend on the case and their number."""
    generator = np.random.default_rng([seeds, *case.name.encode()])
    time = case.interval * np.arange(case.epochs)
    time[1:] += case.jitter * case.interval * generator.uniform(-1, 1, case.epochs - 1)
    process = TorqueFreeProcess(LAYOUT, ProcessNoise(case.psd, case.psd))
    states = simulate_motion(process, np.tile(_first_state(case), (seeds, 1)), time, generator)
    return [_recording(case, time, states[:, k], generator) for k in range(seeds)]


def principal_axes() -> Float[np.ndarray, "3 3"]:
    """R_gb: columns are the principal axes, in the order of `RecordingCase.moments`, in g."""
    return matrix_from_quaternion(quaternion_from_euler321(np.array(AXES_EULER_G)))


def _first_state(case: RecordingCase) -> Float[np.ndarray, " m"]:
    R_gb, x = principal_axes(), LAYOUT.origin()
    blocks = {
        "t": np.array(PLACE) - CENTRE,
        "w": R_gb @ np.array(case.rate_rpm) * RPM,
        "c": np.array(CENTRE),
        "s": from_inertia(R_gb @ np.diag(case.moments) @ R_gb.T),
        "d": case.drag,
    }
    for block, value in blocks.items():
        x[LAYOUT.mean_slice(block)] = value
    return x


NOISE_OPTIONS = {
    "gyro": {"gyro_noise_std": 1.0},
    "pose": {"pose_position_std": POSITION_PER_ROTATION, "pose_rotation_std": 1.0},
}
"""Stated noise of a kind per its `RecordingCase.noise_std`."""


def _recording(
    case: RecordingCase, time: np.ndarray, states: Float[np.ndarray, "n m"], generator: np.random.Generator
) -> Recording:
    measure = {"gyro": _gyro, "pose": _poses}[case.kind]
    options = {name: scale * case.noise_std for name, scale in NOISE_OPTIONS[case.kind].items()}
    kept = generator.random(len(time)) >= case.dropped
    kept[0] = True
    values = measure(case, states, generator)[kept]
    exact = DatasetOptions(calibration=exact_calibration((case.kind,)))
    stated = replace(exact, force_psd=case.psd, torque_psd=case.psd, **options)
    log = MeasurementLog((MeasurementStream(case.kind, time[kept], values),))
    return Recording(Dataset(kind=case.kind, log=log, description=case.name, options=stated), states[kept])


def _gyro(
    case: RecordingCase, states: np.ndarray, generator: np.random.Generator
) -> Float[np.ndarray, "n 3"]:
    rates = states[:, LAYOUT.mean_slice("w")]
    return rates + case.noise_std * generator.standard_normal(rates.shape)


def _poses(
    case: RecordingCase, states: np.ndarray, generator: np.random.Generator
) -> Float[np.ndarray, "n 7"]:
    small = StateLayout(("t", "a"))
    exact = states[
        :, [*range(*LAYOUT.mean_slice("t").indices(99)), *range(*LAYOUT.mean_slice("a").indices(99))]
    ]
    std = case.noise_std * np.repeat([POSITION_PER_ROTATION, 1.0], 3)
    return small.retract(exact, std * generator.standard_normal((len(exact), 6)))
