"""A gyro file of a simulation without noise: its levels are those of rounding, and the run says so."""

from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from scipy.integrate import solve_ivp

from spinfilters.inference.identified_noise import smallest_level
from spinfilters.inference.setup import Setup
from spinfilters.models.body import body_estimate
from spinfilters.run.conditions import conditions_of
from spinfilters.run.preparation import prepare
from spinfilters.run.readers import read_whole
from spinfilters.settings.run_settings import Settings

J = np.array([0.263281, 0.863281, 1.0])


@cache
def prepared() -> Setup:
    """Of 16 s at 10 Hz, twelve digits."""

    def change(_: float, w: np.ndarray) -> np.ndarray:
        return np.cross(J * w, w) / J

    time = 0.1 * np.arange(160)
    rates = solve_ivp(change, (0.0, time[-1]), [0.17, 0.35, 0.52], t_eval=time, rtol=1e-12, atol=1e-14).y.T
    with TemporaryDirectory() as folder:
        path = Path(folder) / "gyro.csv"
        rows = np.column_stack([time, rates])
        np.savetxt(path, rows, delimiter=",", header="time_s,wx,wy,wz", comments="", fmt="%.12g")
        return prepare(read_whole(path), Settings())


def test_its_noise_is_the_smallest_that_is_identified_and_no_default() -> None:
    found = {each.name: each for each in prepared().identified}
    assert found["gyro_noise_std"].value == smallest_level("gyro_noise_std")
    assert found["torque_psd"].value < 1e-10


def test_its_moments_have_deviations_of_that_noise_and_are_right() -> None:
    body = body_estimate(prepared().initial.belief)
    assert body.principal_moments_std[:2].max() < 1e-4
    np.testing.assert_allclose(body.principal_moments, J, atol=4 * body.principal_moments_std.max())


def test_the_run_says_that_no_noise_is_seen_and_what_to_state() -> None:
    (said,) = [line for line in conditions_of(prepared()).sentences if "No noise is seen" in line]
    assert "state sensors.gyro_noise_std" in said
