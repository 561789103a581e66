"""True motions of simulators that are not ours, measured by our sensors: MuJoCo, and a check case of NASA.

MuJoCo (`pip install mujoco`) integrates a free body whose frame is g, with its inertia in g axes, by its fourth-order Runge-Kutta
scheme. The check case is a brick without damping from ``NESC_data/Atmospheric_checkcases`` of nasa/simupy-flight (commit 70754e6),
converted to the columns time_s, wx, wy, wz in rad/s; it is no part of the project.
"""

from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Any, Final

import numpy as np

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
    mujoco = _mujoco()
    layout, own = StateLayout(FULL_BLOCKS), replace(scenario, noise=NOTHING)
    start = first_state(own, layout)
    t, q, v, w, c, s = (start[layout.mean_slice(name)] for name in ("t", "a", "v", "w", "c", "s"))
    J, steps = inertia_matrix(s), int(np.ceil(own.interval / LONGEST_STEP))
    six = (J[0, 0], J[1, 1], J[2, 2], J[0, 1], J[0, 2], J[1, 2])
    document = _BODY.format(step=own.interval / steps, centre=_words(c), inertia=_words(six))
    model = mujoco.MjModel.from_xml_string(document)
    data = mujoco.MjData(model)
    # MuJoCo's quaternion has its scalar first; its velocity is that of the origin of g, ours that of the centre of mass
    data.qpos[:] = [*t, q[3], *q[:3]]
    data.qvel[:] = [*(v - matrix_from_quaternion(q) @ np.cross(w, c)), *w]
    states = np.tile(start, (own.epochs, 1))
    for k in range(own.epochs):
        for _ in range(steps if k else 0):
            mujoco.mj_step(model, data)
        q, w = np.roll(data.qpos[3:7], -1), data.qvel[3:6].copy()
        states[k, layout.mean_slice("t")] = data.qpos[:3]
        states[k, layout.mean_slice("a")] = q
        states[k, layout.mean_slice("v")] = data.qvel[:3] + matrix_from_quaternion(q) @ np.cross(w, c)
        states[k, layout.mean_slice("w")] = w
    time = own.interval * np.arange(own.epochs)
    return measured(own, Motion(layout, time, states), np.random.default_rng(own.seed))


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


def _mujoco() -> Any:
    try:
        return import_module("mujoco")
    except ImportError:
        raise InputError("MuJoCo is not installed; run 'pip install mujoco'") from None


def _words(numbers: Any) -> str:
    return " ".join(repr(float(each)) for each in numbers)
