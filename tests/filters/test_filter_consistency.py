"""The filters' covariance is honest on the known-map example, and stops being so when the noise is wrong."""

from collections.abc import Callable

import numpy as np
import pytest

from spinfilters.evaluation.consistency import chi_square_band
from spinfilters.filters.ekf import MultiplicativeEkf
from spinfilters.filters.estimator import Estimator, ProcessModel
from spinfilters.filters.ukf import MultiplicativeUkf
from spinfilters.models.process import ProcessNoise, TorqueFreeProcess
from tests.filters.filter_samples import FULL, PROCESS, embedded, nees, run_on, stereo_timeline

SEEDS, FEW_SEEDS, DOF = 20, 6, FULL.error_dim
Build = Callable[[ProcessModel], Estimator]


@pytest.mark.parametrize("build", [MultiplicativeEkf, MultiplicativeUkf])
def test_nees_over_twenty_runs_lies_in_its_95_percent_band(build: Build) -> None:
    low, high = chi_square_band(DOF, SEEDS)
    histories = [run_on(build(PROCESS), seed) for seed in range(SEEDS)]
    for history in histories:
        assert history.status.verdict == "ok", history.status.reasons
        assert np.isfinite(history.mean).all()
        correlation = history.covariance / (history.std[:, :, None] * history.std[:, None, :])
        assert np.linalg.eigvalsh(correlation).min() > -1e-13
    values = np.array([nees(history, seed) for seed, history in enumerate(histories)])
    assert low < values[:, -1].mean() < high
    assert low < values.mean() < high
    over_runs = values.mean(axis=0)
    assert np.mean((over_runs > low) & (over_runs < high)) > 0.8
    nis = sum(history.nis.sum() for history in histories) / sum(history.dof.sum() for history in histories)
    assert nis == pytest.approx(1.0, abs=4 * np.sqrt(2 / sum(history.dof.sum() for history in histories)))


@pytest.mark.parametrize("build", [MultiplicativeEkf, MultiplicativeUkf])
def test_nees_leaves_the_band_when_a_hundredth_of_the_torque_noise_is_assumed(build: Build) -> None:
    stiff = TorqueFreeProcess(FULL, ProcessNoise(torque_psd=ProcessNoise.torque_psd / 100))
    values = np.array([nees(run_on(build(stiff), seed), seed) for seed in range(FEW_SEEDS)])
    high = chi_square_band(DOF, FEW_SEEDS)[1]
    assert values[:, -1].mean() > 2 * high
    assert values.mean() > 2 * high


@pytest.mark.parametrize("build", [MultiplicativeEkf, MultiplicativeUkf])
def test_nees_leaves_the_band_when_half_the_pixel_variance_is_assumed(build: Build) -> None:
    values = np.array(
        [
            nees(run_on(build(PROCESS), seed, stereo_timeline(embedded(seed).dataset, 0.7)), seed)
            for seed in range(FEW_SEEDS)
        ]
    )
    assert values.mean() > chi_square_band(DOF, FEW_SEEDS)[1]
