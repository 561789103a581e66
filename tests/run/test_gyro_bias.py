"""A constant gyro bias is estimated by every estimator, with an honest covariance, beside poses and from the gyro alone."""

import io
from collections import defaultdict
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pytest
from jaxtyping import Float
from plain_comparison import plain_comparison, plainly_compared
from rich.console import Console

from spinfilters.core.attitude_conversions import inverse, rotate
from spinfilters.core.linear_algebra import normalised_square
from spinfilters.evaluation.comparison_table import comparison_table
from spinfilters.evaluation.consistency import chi_square_band, normalised_errors, true_states
from spinfilters.filters.history import EstimateHistory
from spinfilters.io.consider_parameter import exact_calibration
from spinfilters.io.dataset import Dataset
from spinfilters.io.measurement_log import MeasurementLog, MeasurementStream
from spinfilters.models.process import ProcessNoise
from spinfilters.models.state_blocks import BLOCKS
from spinfilters.models.state_layout import StateLayout
from spinfilters.run.preparation import prepare
from spinfilters.run.run_summary import summary
from spinfilters.settings.run_settings import FILTER, InitialisationOptions, Settings
from spinfilters.simulation.scenario import RICH_RPM, Scenario, simulate

SEEDS, BIAS_STD, WIDE_STD, GYRO_STD = 12, 0.003, 0.02, 0.002
WITH_BIAS = Settings(initialisation=InitialisationOptions(gyro_bias_std=BIAS_STD))
WITHOUT = Settings()
GYRO, BESIDE_POSES = "gyro", "gyro and poses"
ESTIMATORS = ("mekf", "ukf", "smoother")


@cache
def beside_poses(seed: int, size: float = 1.0) -> Dataset:
    """A tumbling body with a pose sensor and a gyro, whose bias is drawn from its prior times ``size``."""
    poses = simulate(Scenario.simplified(kind="pose", rate_rpm=RICH_RPM, epochs=100, interval=0.4, seed=seed))
    truth, generator = poses.truth, np.random.default_rng(1000 + seed)
    assert truth is not None
    bias = size * BIAS_STD * generator.standard_normal(3)
    rates = rotate(inverse(truth.q_ig), truth.rate_i) + bias
    gyro = MeasurementStream("gyro", truth.time, rates + GYRO_STD * generator.standard_normal(rates.shape))
    return replace(
        poses,
        log=MeasurementLog((gyro, *poses.log.streams)),
        truth=replace(truth, gyro_bias=bias),
        options=replace(
            poses.options, gyro_noise_std=GYRO_STD, calibration=exact_calibration(("pose", "gyro"))
        ),
    )


def dataset(kind: str, seed: int, size: float = 1.0) -> Dataset:
    """Both sensors, or the gyro alone."""
    both = beside_poses(seed, size)
    if kind == BESIDE_POSES:
        return both
    return replace(both, kind="gyro", log=MeasurementLog((both.log.stream("gyro"),)))


def seen_blocks(kind: str, layout: StateLayout) -> list[str]:
    """Blocks that measurements tell: the attitude of a gyro alone is one of definition."""
    return [block for block in layout.blocks if kind != GYRO or block != "a"]


@dataclass(frozen=True)
class LastErrors:
    """Normalised squares of the last epoch, by run: of everything that is seen, and of its blocks by name."""

    dof: int
    total: Float[np.ndarray, " runs"]
    blocks: dict[str, Float[np.ndarray, " runs"]]


def compared(
    kind: str, data: Dataset, settings: Settings
) -> list[tuple[EstimateHistory, dict[str, float], float]]:
    """Of every estimator: its history and the normalised squares of its last epoch, by block and of all that is seen."""
    assert data.truth is not None
    setup = prepare(data, settings)
    found = []
    for evaluation in plainly_compared(setup, settings).evaluations:
        history, layout = evaluation.history, evaluation.history.layout
        squares = normalised_errors(history, data.truth).blocks
        seen = seen_blocks(kind, layout)
        columns = np.concatenate([np.arange(layout.error_dim)[layout.slice(block)] for block in seen])
        error = layout.local(history.mean[-1:], true_states(data.truth, layout)[-1:])
        total = normalised_square(error[:, columns], history.factor[-1:, columns])[0]
        found.append((history, {block: float(squares[block][-1]) for block in seen}, float(total)))
    return found


def last_errors(kind: str) -> dict[str, LastErrors]:
    """Of every estimator over all seeds, in one pass."""
    totals, blocks = defaultdict(list), defaultdict(lambda: defaultdict(list))
    for seed in range(SEEDS):
        for history, squares, total in compared(
            kind, dataset(kind, seed), replace(WITH_BIAS, verdict=FILTER)
        ):
            totals[history.name].append(total)
            for block, square in squares.items():
                blocks[history.name][block].append(square)
    return {
        name: LastErrors(
            sum(BLOCKS[block].dimension for block in blocks[name]),
            np.array(totals[name]),
            {block: np.array(values) for block, values in blocks[name].items()},
        )
        for name in totals
    }


@pytest.mark.parametrize("kind", [GYRO, BESIDE_POSES])
def test_nees_of_the_bias_of_other_blocks_and_of_all_lies_in_its_band(kind: str) -> None:
    found = last_errors(kind)
    assert found.keys() == set(ESTIMATORS)
    for estimator, errors in found.items():
        for name, values in {"all": errors.total, **errors.blocks}.items():
            dof = errors.dof if name == "all" else BLOCKS[name].dimension
            low, high = chi_square_band(dof, SEEDS)
            assert low < values.mean() < high, (estimator, name)


@pytest.mark.parametrize("kind", [GYRO, BESIDE_POSES])
def test_without_the_block_a_biased_gyro_makes_the_rate_overconfident(kind: str) -> None:
    squares = [
        blocks["w"]
        for seed in range(2)
        for _, blocks, _ in compared(
            kind,
            dataset(kind, seed, 8.0),
            Settings(estimators=("mekf", "smoother"), verdict=FILTER),
        )
    ]
    assert np.mean(squares) > 3 * chi_square_band(3, 2)[1]


def test_beside_poses_all_of_the_bias_is_told() -> None:
    for history, _, _ in compared(BESIDE_POSES, dataset(BESIDE_POSES, 0), WITH_BIAS):
        assert history.status.verdict == "ok", history.status.reasons
        assert history.std[-1, history.layout.slice("b")].max() < 0.3 * BIAS_STD


def undisturbed(*moments: float) -> list[EstimateHistory]:
    """Estimates of a gyro alone, with a wide prior of its bias, on a body whose principal axes are those of g."""
    scenario = Scenario.simplified(
        kind="gyro",
        principal_moments=(moments[0], moments[1], moments[2]),
        rate_rpm=RICH_RPM,
        axes_euler_g=(0.0, 0.0, 0.0),
        epochs=60,
        interval=0.5,
        noise=ProcessNoise(torque_psd=1e-12),
        gyro_bias=(0.01, -0.02, 0.015),
    )
    settings = Settings(initialisation=InitialisationOptions(gyro_bias_std=WIDE_STD))
    return [history for history, _, _ in compared(GYRO, simulate(scenario), settings)]


def test_a_gyro_alone_tells_the_bias_of_a_body_with_three_moments() -> None:
    for history in undisturbed(1.0, 0.8, 0.5):
        away = history.mean[-1, history.layout.mean_slice("b")] - [0.01, -0.02, 0.015]
        std = history.std[-1, history.layout.slice("b")]
        assert std.max() < 0.1 * WIDE_STD
        assert np.abs(away / std).max() < 4


def test_along_the_axis_of_a_symmetric_body_a_gyro_alone_tells_no_bias_and_the_smoother_says_so() -> None:
    *_, smoother = undisturbed(1.0, 1.0, 0.6)
    std = smoother.std[-1, smoother.layout.slice("b")] / WIDE_STD
    assert std[:2].max() < 0.1
    assert std[2] > 0.9
    (sentence,) = smoother.status.reasons
    assert sentence.startswith("the bias of the gyro is not determined along")
    assert "1.00) in frame g" in sentence


@pytest.mark.parametrize("settings", [WITH_BIAS, WITHOUT], ids=["with a bias", "without"])
def test_the_summary_and_the_table_show_the_bias_where_it_is_estimated(settings: Settings) -> None:
    data = dataset(BESIDE_POSES, 0)
    comparison = plain_comparison(data, settings)
    text = io.StringIO()
    Console(file=text, width=160).print(comparison_table(comparison.evaluations))
    found = summary(comparison)["estimators"]["mekf"]
    assert ("gyro bias [rad/s]" in text.getvalue()) == (settings is WITH_BIAS)
    if settings is WITHOUT:
        assert (found["gyro_bias"], found["gyro_bias_std"]) == (None, None)
        return
    assert data.truth is not None
    assert data.truth.gyro_bias is not None
    away = np.subtract(found["gyro_bias"], data.truth.gyro_bias) / found["gyro_bias_std"]
    assert np.abs(away).max() < 4


def test_a_data_set_without_a_gyro_has_no_bias() -> None:
    both = beside_poses(0)
    poses = replace(both, log=MeasurementLog((both.log.stream("pose"),)))
    assert "b" not in prepare(poses, WITH_BIAS).process.layout.blocks
