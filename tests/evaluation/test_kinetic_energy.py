"""Kinetic energies with their bands."""

import numpy as np
import pytest

from spinfilters.evaluation.estimated_motion import EnergyCourse, quadratic_energy

J = np.array([[2.0, 0.3, 0.0], [0.3, 1.0, 0.1], [0.0, 0.1, 1.5]])


@pytest.mark.parametrize("rate", [np.array([0.2, 1.0, -0.4]), np.zeros(3)], ids=["moving", "still"])
def test_energy_of_gaussian_rates_has_the_mean_and_deviation_of_samples(rate: np.ndarray) -> None:
    P = np.diag([0.01, 0.02, 0.03])
    drawn = np.random.default_rng(3).multivariate_normal(rate, P, 200_000)
    energy = np.einsum("ki,ij,kj->k", drawn, J, drawn) / 2
    course = quadratic_energy(np.zeros(1), rate[None], P[None], J)
    assert course.energy[0] + np.trace(J @ P) == pytest.approx(energy.mean(), abs=5 * energy.std() / 447)
    assert course.std[0] == pytest.approx(energy.std(), rel=0.02)


def test_a_decay_is_found_within_its_deviation() -> None:
    time = np.linspace(0.0, 50.0, 400)
    energy = 3.0 * np.exp(-0.002 * time)
    noisy = energy * (1 + 0.02 * np.random.default_rng(1).normal(size=400))
    change, std = EnergyCourse(time, noisy, 0.02 * energy).change(10.0, 40.0)
    assert abs(change - (np.exp(-0.06) - 1)) < 3 * std
    assert std < 0.01


def test_rows_without_a_deviation_are_too_few_for_a_line() -> None:
    still = EnergyCourse(np.zeros(1), np.ones(1), np.zeros(1))
    with pytest.raises(np.linalg.LinAlgError):
        still.change(0.0, 0.0)
