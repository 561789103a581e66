"""The table of white disturbances: whoever states, simulates or identifies them has every one."""

import numpy as np
import pytest

from spinfilters.campaigns.recording_factors import NoiseFactor
from spinfilters.campaigns.row_columns import noise_levels
from spinfilters.io.dataset import DatasetOptions, noise_ranges
from spinfilters.io.disturbances import DENSITIES, DISTURBANCES, NAMES, Disturbance, noise_columns, noise_dim
from spinfilters.models.process import ProcessNoise, TorqueFreeProcess
from spinfilters.models.state_blocks import BLOCKS
from spinfilters.models.state_layout import FULL_BLOCKS, ROTATION_BLOCKS, StateLayout
from spinfilters.settings.run_settings import ProcessSettings
from spinfilters.settings.settings_schema import field_words
from tests.models.process_samples import random_point

FULL = StateLayout(FULL_BLOCKS)
INTERVAL = 0.01
RATE = 0.1


def alone(disturbance: Disturbance) -> TorqueFreeProcess:
    """The process in which no other one acts."""
    densities = {name: float(name == disturbance.option) for name in DENSITIES}
    return TorqueFreeProcess(FULL, ProcessNoise(**densities))


def disturbed(disturbance: Disturbance) -> np.ndarray:
    """1 of every component of its block that it drives, 0 of others."""
    block = FULL.slice(disturbance.block)
    return np.isin(np.arange(block.stop - block.start), disturbance.axes).astype(float)


def test_every_density_is_a_setting_an_option_of_data_sets_and_a_factor_of_campaigns() -> None:
    for record in (ProcessNoise(), ProcessSettings(), NoiseFactor()):
        assert all(hasattr(record, name) for name in DENSITIES)
    assert DENSITIES.keys() <= noise_ranges().keys()
    assert set(DENSITIES) <= set(noise_levels())
    assert DENSITIES.keys() <= field_words(ProcessSettings).keys() & field_words(NoiseFactor).keys()
    stated = DatasetOptions(densities=dict.fromkeys(DENSITIES, 1e-3))
    assert stated.densities == {name: getattr(stated, name) for name in DENSITIES}


def test_columns_of_disturbances_follow_one_another() -> None:
    for blocks in (ROTATION_BLOCKS, FULL_BLOCKS):
        columns = noise_columns(blocks)
        assert list(columns) == [name for name in NAMES if name in columns]
        assert [at.start for at in columns.values()] == [0, *(at.stop for at in columns.values())][:-1]
        assert {each.name for each in DISTURBANCES if each.block in blocks} == columns.keys()
    assert len({each.rank for each in DISTURBANCES}) == len(DISTURBANCES)


@pytest.mark.parametrize("disturbance", DISTURBANCES, ids=lambda each: each.name)
def test_a_disturbance_fills_its_own_columns_and_drives_its_block(disturbance: Disturbance) -> None:
    x = random_point(FULL, RATE, np.random.default_rng(1))
    G = alone(disturbance).linearise(x, INTERVAL).noise_factor
    own = noise_columns(FULL_BLOCKS)[disturbance.name]
    assert G.shape == (FULL.error_dim, noise_dim(FULL_BLOCKS))
    assert np.all(G[:, : own.start] == 0)
    assert np.all(G[:, own.stop :] == 0)
    driven = np.diag(G @ G.T)[FULL.slice(disturbance.block)]
    np.testing.assert_allclose(driven, disturbed(disturbance) * INTERVAL, rtol=0.05, atol=1e-12)


@pytest.mark.parametrize("disturbance", DISTURBANCES, ids=lambda each: each.name)
def test_simulated_impulses_have_the_covariance_of_the_noise_factor(disturbance: Disturbance) -> None:
    process, x = alone(disturbance), random_point(FULL, RATE, np.random.default_rng(2))
    normal = np.random.default_rng(3).standard_normal((1, 4000, 2, process.disturbed_dim))
    end = process.disturbed_steps(np.tile(x, (4000, 1)), INTERVAL, normal)
    error = FULL.local(process.step(x, INTERVAL), end)[:, FULL.slice(disturbance.block)]
    seen = np.mean(error**2, axis=0) / (INTERVAL)
    np.testing.assert_allclose(seen, disturbed(disturbance), atol=0.1)


def test_a_disturbance_drives_a_block_that_there_is() -> None:
    assert {each.block for each in DISTURBANCES} <= BLOCKS.keys()
