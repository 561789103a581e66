"""A constant gyro bias is estimated by every estimator, with an honest covariance, beside poses and from the gyro alone."""

from collections import defaultdict
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pytest
from jaxtyping import Float

from spinfilters.estimators.history import EstimateHistory
from spinfilters.estimators.start import StartOptions
from spinfilters.evaluation.consistency import (
    chi_square_band,
    normalised_errors,
    normalised_square,
    true_states,
)
from spinfilters.logs.dataset import Dataset
from spinfilters.logs.measurement_log import MeasurementLog
from spinfilters.simulation.scenario import RICH_RPM, Scenario, simulate
from spinfilters.state.blocks import BLOCKS
from spinfilters.state.layout import StateLayout
from spinfilters.workflow.estimation import compare_estimators
from spinfilters.workflow.preparation import prepare
from spinfilters.workflow.run_summary import summary
from spinfilters.workflow.settings import Settings

SEEDS, FEW_SEEDS, BIAS_STD = 24, 4, 0.003
WITH_BIAS = Settings(start=StartOptions(gyro_bias_std=BIAS_STD))
WITHOUT = Settings()
GYRO, BESIDE_POSES = "gyro", "gyro and poses"
ESTIMATORS = ("mekf", "ukf", "smoother")


def dataset(kind: str, seed: int, size: float = 1.0) -> Dataset:
    """A tumbling body with a gyro whose bias is drawn from its prior, alone or beside poses."""
    bias = size * BIAS_STD * np.random.default_rng(1000 + seed).standard_normal(3)
    scenario = Scenario(
        kind="gyro", rate_rpm=RICH_RPM, frames=100, interval=0.4, gyro_bias=tuple(bias.tolist()), seed=seed
    )
    gyro = simulate(scenario)
    if kind == GYRO:
        return gyro
    poses = simulate(replace(scenario, kind="pose"))
    noise = scenario.gyro_std * np.random.default_rng(2000 + seed).standard_normal((scenario.frames, 3))
    stream = simulate(replace(scenario, gyro_std=0.0)).log.stream("gyro")
    independent = replace(stream, values=stream.values + noise)
    return replace(
        poses,
        log=MeasurementLog((independent, *poses.log.streams)),
        truth=gyro.truth,
        options=replace(poses.options, gyro_noise_std=scenario.gyro_std),
    )


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
    prepared = prepare(data, settings)
    found = []
    for evaluation in compare_estimators(prepared, settings, lambda name, done, total: None).evaluations:
        history, layout = evaluation.history, evaluation.history.layout
        squares = normalised_errors(history, data.truth).blocks
        seen = seen_blocks(kind, layout)
        columns = np.concatenate([np.arange(layout.error_dim)[layout.slice(block)] for block in seen])
        error = layout.local(history.mean[-1:], true_states(data.truth, layout)[-1:])
        total = normalised_square(error[:, columns], history.factor[-1:, columns])[0]
        found.append((history, {block: float(squares[block][-1]) for block in seen}, float(total)))
    return found


@cache
def last_errors(kind: str) -> dict[str, LastErrors]:
    """Of every estimator over all seeds."""
    totals, blocks = defaultdict(list), defaultdict(lambda: defaultdict(list))
    for seed in range(SEEDS):
        for history, squares, total in compared(kind, dataset(kind, seed), WITH_BIAS):
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


@pytest.mark.parametrize("estimator", ESTIMATORS)
@pytest.mark.parametrize("kind", [GYRO, BESIDE_POSES])
def test_nees_of_the_bias_of_other_blocks_and_of_all_lies_in_its_band(kind: str, estimator: str) -> None:
    errors = last_errors(kind)[estimator]
    for name, values in {"all": errors.total, **errors.blocks}.items():
        dof = errors.dof if name == "all" else BLOCKS[name].dimension
        low, high = chi_square_band(dof, SEEDS)
        print(kind, estimator, name, f"{values.mean() / dof:.2f} in {low / dof:.2f} .. {high / dof:.2f}")
        assert low < values.mean() < high, name
