"""Lidar poses at 1 Hz beside stereo tracks at 2 Hz and a gyro at 100 Hz, 60 s of one motion: together, and each alone.

python -m experiments.lidar_fusion [--seed 0] [--estimator mekf]
"""

import argparse
from time import perf_counter

import numpy as np

from spinfilters.attitude.conversions import quaternion_from_matrix
from spinfilters.data.dataset import Dataset
from spinfilters.data.dataset_options import DatasetOptions
from spinfilters.data.measurement_log import MeasurementLog
from spinfilters.data.sensor_format import sensor_format
from spinfilters.data.track_files import KnownMap
from spinfilters.data.truth import Truth
from spinfilters.evaluation.consistency import true_states
from spinfilters.models.process import ProcessNoise, TorqueFreeProcess
from spinfilters.pipeline.estimation import compare_estimators
from spinfilters.pipeline.setup import prepare
from spinfilters.sensors.feature_tracks import ball
from spinfilters.sensors.registry import sensor_of
from spinfilters.sensors.scene import Scene
from spinfilters.settings.run_settings import Settings
from spinfilters.simulation.motion import Motion, simulate_motion
from spinfilters.simulation.scenario import RICH_RPM, Scenario
from spinfilters.simulation.scenario import simulate as simulate_scenario
from spinfilters.state.layout import FULL_BLOCKS, StateLayout

STEP, SECONDS = 0.01, 60.0
COMPARED = (40.0, 60.0)
"""Seconds over which errors are compared: every filter has then settled."""
EVERY = {"lidar-poses": 100, "stereo": 50, "gyro": 1}
"""Steps between the measurements of a sensor."""


def main() -> None:
    """Print a line for every choice of sensors."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--estimator", default="mekf")
    options = parser.parse_args()
    whole = recording(options.seed)
    for sensors in (tuple(EVERY), *((name,) for name in EVERY)):
        estimate(whole, sensors, options.estimator)


def recording(seed: int) -> Dataset:
    """All three sensors on one motion with the default disturbances, 100 landmarks, their map known."""
    scenario, generator = (
        Scenario(kind="lidar-poses", rate_rpm=RICH_RPM, landmarks=100, seed=seed),
        np.random.default_rng(seed),
    )
    pattern = simulate_scenario(Scenario(kind="lidar-poses", rate_rpm=RICH_RPM, epochs=2, seed=seed))
    first, layout = pattern.truth, StateLayout(FULL_BLOCKS)
    assert first is not None
    disturbances = ProcessNoise()  # so weak a force that the body stays in view
    process, time = TorqueFreeProcess(layout, disturbances), STEP * np.arange(round(SECONDS / STEP))
    states = simulate_motion(process, initial_state(first, layout), time, generator)
    surface, streams, noise, rig, rows = (
        ball(scenario.landmarks, scenario.radius_m, generator),
        [],
        {},
        None,
        None,
    )
    for name, every in EVERY.items():
        motion = Motion(layout, time[::every], states[::every])
        scene = Scene(motion, motion, surface, scenario.front_end, scenario, generator)
        made = sensor_of(name).simulate(scene)
        streams.append(made.stream)
        noise |= made.noise
        rig, rows = made.rig or rig, rows if made.landmarks is None else made.landmarks
    motion = Motion(layout, time, states)
    assert rows is not None
    return Dataset(
        kind="lidar-poses",
        log=MeasurementLog(tuple(streams)),
        description=f"lidar, stereo and gyro, seed {seed}",
        truth=truth_at(motion, first),
        rig=rig,
        known_map=KnownMap(np.arange(len(rows)), surface.points[rows]),
        options=DatasetOptions(noise, disturbances.force_psd, disturbances.torque_psd),
    )


def initial_state(truth: Truth, layout: StateLayout) -> np.ndarray:
    """The first state of a simulated data set."""
    return true_states(truth, layout)[0]


def truth_at(motion: Motion, body: Truth) -> Truth:
    """The true motion with the mass properties of another truth."""
    R = motion.rotations
    return Truth(
        time=motion.time,
        center_of_mass=motion.block("t") + R @ body.center_of_mass_g,
        q_ig=quaternion_from_matrix(R),
        velocity=motion.block("v"),
        rate_i=np.einsum("kij,kj->ki", R, motion.block("w")),
        principal_moments=body.principal_moments,
        principal_axes_g=body.principal_axes_g,
        center_of_mass_g=body.center_of_mass_g,
    )


def estimate(whole: Dataset, sensors: tuple[str, ...], estimator: str) -> None:
    """One run with some of the sensors."""
    log = MeasurementLog(tuple(whole.log.stream(name) for name in sensors))
    kind = sensor_format(sensors[0]).kind
    dataset = Dataset(
        kind=kind,
        log=log,
        description=whole.description,
        truth=whole.truth,
        rig=whole.rig,
        known_map=whole.known_map if "stereo" in sensors else None,
        options=whole.options,
    )
    epochs = len(log.times)
    first = {"frames": max(36, epochs // 4)}
    settings, begin = Settings(estimators=(estimator,), initialisation=first), perf_counter()  # pyright: ignore[reportArgumentType]
    (found,) = compare_estimators(prepare(dataset, settings), settings, lambda *_: None).evaluations
    seconds = perf_counter() - begin
    errors = None if found.errors is None else found.errors.within(*COMPARED)
    nees = None if found.nees is None else found.nees.within(*COMPARED)
    words = (
        "no errors"
        if errors is None
        else ", ".join(f"{k} {v:.5f}" for k, v in vars(errors.rms).items() if v is not None)
    )
    told = "" if nees is None else f", NEES per dof {nees.mean:.2f}"
    print(
        f"{' + '.join(sensors)}: {seconds:.1f} s, {found.history.status.verdict}, RMS (SI) {words}{told}",
        flush=True,
    )


if __name__ == "__main__":
    main()
