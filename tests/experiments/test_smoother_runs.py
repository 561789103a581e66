"""Runs of the smoother's Monte Carlo on a few frames: bound, covariance and errors are of one piece."""

from functools import cache
from pathlib import Path

import numpy as np
import pytest

from experiments.smoother_consistency import kept
from experiments.smoother_figures import bound_figure, nees_figure
from experiments.smoother_report import batch_table, block_table, start_table
from experiments.smoother_runs import Arrays, SmootherCase, run_batch
from spinfilters.evaluation.consistency import chi_square_band
from spinfilters.reproduction.tweddle.final_deviations import QUANTITIES, THESIS

FRAMES = 24


@cache
def batch(seed: int = 0) -> Arrays:
    """All of two revolutions at once."""
    return run_batch(SmootherCase("rich", seed, FRAMES))


def test_uncertainty_of_the_motion_is_that_of_the_bound() -> None:
    moving = [k for k, (name, *_) in enumerate(QUANTITIES) if name in {"position", "velocity", "attitude"}]
    assert batch()["std"][moving] == pytest.approx(batch()["std_bound"][moving], rel=0.1)
    assert batch()["std"].shape == THESIS.shape == (len(QUANTITIES), 3)


def test_errors_are_as_long_as_their_standard_deviations_say() -> None:
    assert batch()["nees"].shape == batch()["linear_nees"].shape == (FRAMES,)
    for name in ("nees", "linear_nees"):
        low, high = chi_square_band(20, 1, 0.999)
        assert low < batch()[name][1:].mean() < high
    assert batch()["nees"][1:] == pytest.approx(batch()["linear_nees"][1:], rel=0.3)


def test_both_schedules_come_to_the_same_optimum() -> None:
    assert batch()["converged_plain"].all()
    assert batch()["converged_drawn"].all()
    assert batch()["finite"].all()
    assert batch()["cost_plain"] == pytest.approx(batch()["cost_drawn"], abs=20.0)


def test_a_kept_run_is_read_and_not_made_again(tmp_path: Path) -> None:
    case = SmootherCase("thesis", 5)
    first = kept(lambda _: {"seed": np.array([case.seed])}, tmp_path, case)

    def fails(_: SmootherCase) -> Arrays:
        raise AssertionError

    assert kept(fails, tmp_path, case)["seed"] == first["seed"] == 5


def test_tables_and_pictures_hold_every_motion() -> None:
    motions = {"rich": [batch(), batch(1)]}
    assert batch_table(motions).row_count == 4
    assert block_table(motions).row_count == 7
    assert start_table(motions).row_count == 2
    for figure in (nees_figure(motions), bound_figure(motions)):
        assert len(figure.axes) == 2
