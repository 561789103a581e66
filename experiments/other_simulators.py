"""True motions of simulators that are not ours, measured by our sensors: MuJoCo, Drake, and a check case of NASA.

MuJoCo (`pip install mujoco`) integrates a free body whose frame is g, with its inertia in g axes, by its fourth-order Runge-Kutta
scheme; Drake (`pip install drake`) the same body by its third-order scheme with error control. The check case is a brick without
damping from ``NESC_data/Atmospheric_checkcases`` of nasa/simupy-flight (commit 70754e6), converted to time_s, wx, wy, wz
(rad/s); it is no part of the project.
"""

from collections.abc import Callable
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from jaxtyping import Float

from spinfilters.core.attitude_conversions import integrate_gyro, matrix_from_quaternion
from spinfilters.core.errors import InputError
from spinfilters.core.mass_distribution import inertia_matrix
from spinfilters.io.dataset import Dataset
from spinfilters.models.process import ProcessNoise
from spinfilters.models.state_layout import FULL_BLOCKS, StateLayout
from spinfilters.simulation.scenario import Motion, first_state, measured
from spinfilters.simulation.scenario_record import Scenario

LONGEST_STEP: Final = 2e-3
"""Of MuJoCo's integrator, s: the angular momentum of a body at 12 rpm stays within 1e-12 in 50 s."""
ACCURACY: Final = 1e-9
"""Of Drake's integrator, relative to a state."""
NOTHING: Final = ProcessNoise(force_psd=0.0, torque_psd=0.0)
BRICK_MOMENTS: Final = (0.00189422, 0.006211019, 0.007194665)
"""About x, y, z, slug ft^2."""
_BODY: Final = """
<mujoco>
  <option timestep="{step}" gravity="0 0 0" integrator="RK4"/>
  <worldbody><body><freejoint/><inertial pos="{centre}" mass="1" fullinertia="{inertia}"/></body></worldbody>
</mujoco>"""


def mujoco_recording(scenario: Scenario) -> Dataset:
    """A scenario's recording whose motion MuJoCo simulates; nothing disturbs it.

    Raises
    ------
    InputError
        MuJoCo is not installed.
    """
    return _recording(scenario, _motion_of_mujoco)


def drake_recording(scenario: Scenario) -> Dataset:
    """A scenario's recording whose motion Drake simulates; nothing disturbs it.

    Raises
    ------
    InputError
        Drake is not installed.
    """
    return _recording(scenario, _motion_of_drake)


class _Motion(NamedTuple):
    """Of the frame g in i at each epoch: origin (m), quaternion, velocity of the origin (m/s, i axes), rate (rad/s, g axes)."""

    origin: Float[np.ndarray, "k 3"]
    attitude: Float[np.ndarray, "k 4"]
    velocity: Float[np.ndarray, "k 3"]
    rate: Float[np.ndarray, "k 3"]


class _Start(NamedTuple):
    """What a simulator begins from: a row of a motion, and the body of mass one with its centre (m) and inertia, g axes.

    The inertia is xx, yy, zz, xy, xz, yz, as both simulators take it.
    """

    origin: Float[np.ndarray, "3"]
    attitude: Float[np.ndarray, "4"]
    velocity: Float[np.ndarray, "3"]
    rate: Float[np.ndarray, "3"]
    centre: Float[np.ndarray, "3"]
    inertia: Float[np.ndarray, "6"]


def _recording(scenario: Scenario, simulated: Callable[[_Start, Scenario], _Motion]) -> Dataset:
    """A scenario's recording of a motion that another program simulates from the scenario's first state."""
    layout, own = StateLayout(FULL_BLOCKS), replace(scenario, noise=NOTHING)
    start = first_state(own, layout)
    t, q, v, w, c, s = (start[layout.mean_slice(name)] for name in ("t", "a", "v", "w", "c", "s"))
    # their velocity is that of the origin of g, ours that of the centre of mass
    origin_velocity = v - matrix_from_quaternion(q) @ np.cross(w, c)
    inertia = inertia_matrix(s)[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
    found = simulated(_Start(t, q, origin_velocity, w, c, inertia), own)
    states = np.tile(start, (own.epochs, 1))
    states[:, layout.mean_slice("t")] = found.origin
    states[:, layout.mean_slice("a")] = found.attitude
    states[:, layout.mean_slice("w")] = found.rate
    turned = [
        matrix_from_quaternion(q) @ np.cross(w, c) for q, w in zip(found.attitude, found.rate, strict=True)
    ]
    states[:, layout.mean_slice("v")] = found.velocity + np.array(turned)
    time = own.interval * np.arange(own.epochs)
    return measured(own, Motion(layout, time, states), np.random.default_rng(own.seed))


def _motion_of_mujoco(start: _Start, own: Scenario) -> _Motion:
    mujoco = _module("mujoco", "MuJoCo", "mujoco")
    steps = int(np.ceil(own.interval / LONGEST_STEP))
    centre, inertia = _words(start.centre), _words(start.inertia)
    document = _BODY.format(step=own.interval / steps, centre=centre, inertia=inertia)
    model = mujoco.MjModel.from_xml_string(document)
    data, q = mujoco.MjData(model), start.attitude
    data.qpos[:] = [*start.origin, q[3], *q[:3]]  # MuJoCo's quaternion has its scalar first
    data.qvel[:] = [*start.velocity, *start.rate]
    rows = []
    for k in range(own.epochs):
        for _ in range(steps if k else 0):
            mujoco.mj_step(model, data)
        rows.append(np.concatenate([data.qpos[:3], np.roll(data.qpos[3:7], -1), data.qvel[:6]]))
    return _Motion(*np.split(np.array(rows), [3, 7, 10], axis=1))


def _motion_of_drake(start: _Start, own: Scenario) -> _Motion:
    plants, trees, vectors, maths, analysis = (
        _module(f"pydrake.{name}", "Drake", "drake")
        for name in ("multibody.plant", "multibody.tree", "multibody.math", "math", "systems.analysis")
    )
    plant = plants.MultibodyPlant(time_step=0.0)
    central = trees.RotationalInertia(*start.inertia)
    inertia = trees.SpatialInertia.MakeFromCentralInertia(1.0, start.centre, central)
    body = plant.AddRigidBody("body", inertia)
    plant.mutable_gravity_field().set_gravity_vector(np.zeros(3))
    plant.Finalize()
    simulator = analysis.Simulator(plant)
    analysis.ResetIntegratorFromFlags(simulator, "runge_kutta3", 0.05)
    simulator.get_mutable_integrator().set_target_accuracy(ACCURACY)
    context, R = simulator.get_mutable_context(), matrix_from_quaternion(start.attitude)
    plant.SetFreeBodyPose(context, body, maths.RigidTransform(maths.RotationMatrix(R), start.origin))
    velocity = vectors.SpatialVelocity(R @ start.rate, start.velocity)
    plant.SetFreeBodySpatialVelocity(context, body, velocity)
    simulator.Initialize()
    rows = []
    for k in range(own.epochs):
        simulator.AdvanceTo(own.interval * k)
        pose = plant.EvalBodyPoseInWorld(context, body)
        speed = plant.EvalBodySpatialVelocityInWorld(context, body)
        R, q = pose.rotation().matrix(), pose.rotation().ToQuaternion()
        row = (
            pose.translation(),
            [q.x(), q.y(), q.z(), q.w()],
            speed.translational(),
            R.T @ speed.rotational(),
        )
        rows.append(np.concatenate(row))
    return _Motion(*np.split(np.array(rows), [3, 7, 10], axis=1))


def brick_recording(file: Path, first: int, epochs: int, gyro_std: float, seed: int) -> Dataset:
    """A gyro's recording of some epochs of the check case.

    Raises
    ------
    InputError
        The file does not have so many epochs, or is no such table.
    """
    try:
        table = np.loadtxt(file, delimiter=",", skiprows=1)
    except ValueError as error:
        raise InputError(
            f"{file}: {error}; a table of time_s, wx, wy, wz behind a line of names is wanted"
        ) from None
    table = table[first : first + epochs]
    if table.shape != (epochs, 4):
        raise InputError(f"{file}: has no {epochs} epochs of time_s, wx, wy, wz from number {first} on")
    time, rates = table[:, 0] - table[0, 0], table[:, 1:]
    x, y, z = BRICK_MOMENTS
    scenario = Scenario(
        kind="gyro",
        principal_moments=(x / z, y / z, 1.0),
        axes_euler_g=(0.0, 0.0, 0.0),
        center_of_mass_g=(0.0, 0.0, 0.0),
        epochs=epochs,
        interval=float(np.median(np.diff(time))),
        gyro_std=gyro_std,
        noise=NOTHING,
        seed=seed,
    )
    layout = StateLayout(FULL_BLOCKS)
    states = np.tile(first_state(scenario, layout), (epochs, 1))
    states[:, layout.mean_slice("w")] = rates
    attitude = layout.mean_slice("a")
    states[:, attitude] = integrate_gyro(time, rates, states[0, attitude])
    return measured(scenario, Motion(layout, time, states), np.random.default_rng(seed))


def _module(name: str, program: str, package: str) -> Any:
    try:
        return import_module(name)
    except ImportError:
        raise InputError(f"{program} is not installed; run 'pip install {package}'") from None


def _words(numbers: Any) -> str:
    return " ".join(repr(float(each)) for each in numbers)
