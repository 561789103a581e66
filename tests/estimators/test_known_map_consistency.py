from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from spinfilters.evaluation.consistency import chi_square_band
from spinfilters.models.process import ProcessNoise
from spinfilters.simulation.scenario import Scenario, simulate
from spinfilters.workflow.estimation import compare_estimators
from spinfilters.workflow.preparation import prepare
from spinfilters.workflow.settings import SensorSettings, Settings

SEEDS, LANDMARKS, DOF = 20, 600, 20
SETTINGS = Settings(estimators=("mekf", "ukf"))


@cache
def simulated(seed):
    return simulate(Scenario(seed=seed, landmarks=LANDMARKS))


def runs(settings, seeds):
    """NEES (seeds, frames) of every estimator; every belief is checked to be finite and never indefinite."""
    nees = {name: [] for name in settings.estimators}
    for seed in range(seeds):
        comparison = compare_estimators(prepare(simulated(seed), settings), settings, lambda *_: None)
        for evaluation in comparison.evaluations:
            history = evaluation.history
            assert np.isfinite(history.mean).all()
            assert np.isfinite(history.factor).all()
            std = history.std
            correlation = history.covariance / (std[:, :, None] * std[:, None, :])
            assert np.linalg.eigvalsh(correlation).min() > -1e-12
            nees[evaluation.name].append(evaluation.nees.total)
    return {name: np.array(values) for name, values in nees.items()}


def test_twenty_seeds_of_the_embedded_default_are_inside_the_95_percent_band_of_nees():
    low, high = chi_square_band(DOF, SEEDS)
    for name, nees in runs(SETTINGS, SEEDS).items():
        assert low < nees[:, -1].mean() < high, name
        assert low < nees.mean() < high, name
        inside = (nees.mean(axis=0) > low) & (nees.mean(axis=0) < high)
        assert inside.mean() > 0.8, name


@pytest.mark.parametrize(
    "wrong",
    [
        {"sensors": SensorSettings(pixel_std=0.7)},
        {"sensors": SensorSettings(pixel_std=1.4)},
        {"process": replace(SETTINGS.process, torque_psd=ProcessNoise.torque_psd / 4)},
    ],
    ids=["measurement noise halved", "measurement noise doubled", "torque noise quartered"],
)
def test_the_band_is_missed_with_wrong_noise(wrong):
    seeds = 8
    low, high = chi_square_band(DOF, seeds)
    nees = runs(replace(SETTINGS, estimators=("mekf",), **wrong), seeds)["mekf"]
    assert not low < nees.mean() < high
