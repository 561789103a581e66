"""A real gyro, integrated, against a real optical attitude: the test that pins every convention at once.

BROAD trial 07 (Laidig et al. 2021, CC BY 4.0): a hand turns an IMU at up to 25 rad/s; `opt_quat` maps the
sensor frame to ENU. Two constants are estimated, neither of which knows a quaternion convention:

- the gyro bias, the mean rate while the sensor lies still before the motion;
- the clock offset of the gyro against the optics, from speeds alone (angle per time of the optics, norm of
  the gyro), on the first third of the motion: 4.2 ms, or 6 degrees at each end of a window at 25 rad/s.

No misalignment and no scale factor is estimated. The worst error of any turn within 10 s is then 2.52
degrees; it is 11.8 without the clock offset, 4.8 without the bias, 12.1 without both.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import pytest
from jaxtyping import Float
from scipy.spatial.transform import Rotation, Slerp

from spinfilters.core import attitude_conversions as attitude

FILE: Final = Path(__file__).parents[3] / "shared/data/broad_imu_optical/07_undisturbed_fast_rotation_B.hdf5"
WINDOW: Final = 10.0
BAR: Final = np.deg2rad(3.0)


@dataclass(frozen=True)
class Record:
    """Evenly sampled time in s, gyro in rad/s, q_enu_sensor (NaN where optics are lost), and if it moves."""

    time: Float[np.ndarray, " n"]
    rate: Float[np.ndarray, "n 3"]
    optical: Float[np.ndarray, "n 4"]
    moves: Float[np.ndarray, " n"]

    @property
    def bias(self) -> Float[np.ndarray, "3"]:
        return self.rate[: np.argmax(self.moves)].mean(axis=0)

    @property
    def seen(self) -> np.ndarray:
        """Samples with an optical attitude: one run without gaps."""
        found = np.flatnonzero(~np.isnan(self.optical).any(axis=1))
        assert np.all(np.diff(found) == 1)
        return found


@pytest.fixture(scope="module")
def record() -> Record:
    if not FILE.exists():
        pytest.skip(f"{FILE} is not there: the real data are not part of the repository")
    h5py = pytest.importorskip("h5py")
    with h5py.File(FILE) as file:
        rate, scalar_first, moves = (file[name][:] for name in ("imu_gyr", "opt_quat", "movement"))
        time = np.arange(len(rate)) / file.attrs["sampling_rate"]
    return Record(time, rate, np.roll(scalar_first, -1, axis=1), moves)


def clock_offset(record: Record) -> float:
    """Seconds by which gyro stamps are late: fits its speeds to the optical ones in a third of the motion."""
    motion = np.flatnonzero(record.moves)
    part = slice(motion[0], motion[0] + len(motion) // 3)
    step = record.time[1]
    optical = attitude.angle_between(record.optical[part][:-1], record.optical[part][1:]) / step
    middle, speed = record.time[part][:-1] + step / 2, np.linalg.norm(record.rate - record.bias, axis=1)
    offset = 0.0
    for _ in range(5):  # Gauss-Newton on one unknown
        gyro = np.interp(middle + offset, record.time, speed)
        slope = np.interp(middle + offset, record.time, np.gradient(speed, step))
        offset += float(slope @ (optical - gyro) / (slope @ slope))
    return offset


def misfit(record: Record, integrated: np.ndarray, offset: float) -> np.ndarray:
    """D = q_optical (x) q_gyro^-1 at every optical stamp: constant when the gyro reproduces the optics."""
    gyro = Slerp(record.time - offset, Rotation.from_quat(integrated))
    optical, time = record.optical[record.seen], record.time[record.seen]
    return attitude.multiply(optical, attitude.inverse(gyro(time).as_quat()))


def worst_error(record: Record, D: np.ndarray, every: int = 1) -> float:
    """Largest error in rad of any turn within 10 s: every start, every end; or of turns that last so many samples more.

    The turns from s to e differ by the angle of (o_s^-1 o_e)^-1 (g_s^-1 g_e): that between D_s and D_e.
    """
    shifts = range(1, round(WINDOW / record.time[1]) + 1, every)
    least = min(float(np.abs(np.einsum("ki,ki->k", D[:-shift], D[shift:])).min()) for shift in shifts)
    return 2 * float(np.arccos(min(least, 1.0)))


def integrated_error(record: Record, bias: np.ndarray, offset: float, every: int = 1) -> float:
    integrated = attitude.integrate_gyro(record.time, record.rate - bias, np.array([0.0, 0.0, 0.0, 1.0]))
    return worst_error(record, misfit(record, integrated, offset), every)


@pytest.fixture(scope="module")
def right_error(record: Record) -> float:
    """With bias and clock offset, of every turn."""
    return integrated_error(record, record.bias, clock_offset(record))


SOME = 16
"""Of the turns, one in so many: a single one with a large error is enough."""


def test_the_integrated_gyro_reproduces_the_optical_attitude_over_any_ten_seconds(
    record: Record, right_error: float
) -> None:
    assert 3.5e-3 < clock_offset(record) < 5e-3
    assert right_error < BAR


def test_the_still_bias_is_needed(record: Record, right_error: float) -> None:
    without = integrated_error(record, np.zeros(3), clock_offset(record), SOME)
    assert without > 1.2 * right_error


def test_an_unsynchronised_clock_costs_speed_times_offset(record: Record) -> None:
    error = integrated_error(record, record.bias, 0.0)
    fastest = np.max(np.linalg.norm(record.rate, axis=1))
    assert BAR < error < 2 * fastest * clock_offset(record) + BAR


def test_at_rest_the_two_agree_to_a_fraction_of_a_degree(record: Record) -> None:
    still = np.flatnonzero(record.moves)[-1] + round(1 / record.time[1])  # a second to be laid down
    integrated = attitude.integrate_gyro(
        record.time, record.rate - record.bias, np.array([0.0, 0.0, 0.0, 1.0])
    )
    D = misfit(record, integrated, 0.0)[still - record.seen[0] :]
    assert worst_error(record, D) < np.deg2rad(0.5)


def test_conjugate_optical_quaternions_are_wrong_by_far(record: Record) -> None:
    conjugate = Record(record.time, record.rate, record.optical * [-1, -1, -1, 1], record.moves)
    assert integrated_error(conjugate, record.bias, clock_offset(record), SOME) > np.deg2rad(90)


def test_rates_multiplied_on_the_inertial_side_are_wrong_by_far(record: Record) -> None:
    start = np.array([0.0, 0.0, 0.0, 1.0])
    inertial_side = attitude.inverse(attitude.integrate_gyro(record.time, record.bias - record.rate, start))
    assert worst_error(record, misfit(record, inertial_side, clock_offset(record)), SOME) > np.deg2rad(90)


def test_scalar_first_quaternions_are_wrong_by_far(record: Record) -> None:
    scalar_first = Record(record.time, record.rate, np.roll(record.optical, 1, axis=1), record.moves)
    assert integrated_error(scalar_first, record.bias, clock_offset(record), SOME) > np.deg2rad(90)
