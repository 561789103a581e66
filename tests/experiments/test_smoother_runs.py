"""Runs of the smoother's Monte Carlo on a few frames: bound, covariance and errors are of one piece."""

from functools import cache
from pathlib import Path

import numpy as np
import pytest

from experiments.smoother_consistency import kept
from experiments.smoother_figures import bound_figure, nees_figure, sliding_figure
from experiments.smoother_marginals import QUANTITIES, THESIS
from experiments.smoother_report import batch_table, block_table, mode_ratios, mode_table, start_table
from experiments.smoother_runs import MODES, SLOW, Arrays, SmootherCase, run_batch, run_sliding
from spinfilters.evaluation.consistency import chi_square_band

FRAMES = 24


@cache
def batch(seed: int = 0) -> Arrays:
    """All of two revolutions at once."""
    return run_batch(SmootherCase("rich", seed, FRAMES))


@cache
def sliding() -> Arrays:
    """The same frame by frame."""
    return run_sliding(SmootherCase("rich", 0, FRAMES))


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


def test_modes_that_let_nothing_go_yet_are_full_smoothing() -> None:
    frozen, full = (sliding()[f"{mode}/position"] for mode in ("frozen-180", "full"))
    assert frozen[:6] == pytest.approx(full[:6], abs=1e-9)
    assert mode_ratios([sliding()], "full") == {
        "position": 1.0,
        "velocity": 1.0,
        "attitude": 1.0,
        "moments": 1.0,
    }


def test_every_epoch_is_told_when_it_comes() -> None:
    for mode in MODES:
        assert sliding()[f"{mode}/nees"].shape == (FRAMES,)
        assert (sliding()[f"{mode}/linearisations"] >= 1).all()


def test_a_kept_run_is_read_and_not_made_again(tmp_path: Path) -> None:
    case = SmootherCase("thesis", 5)
    first = kept(lambda _: {"seed": np.array([case.seed])}, tmp_path, case)

    def fails(_: SmootherCase) -> Arrays:
        raise AssertionError

    assert kept(fails, tmp_path, case)["seed"] == first["seed"] == 5


def test_a_long_recording_is_slow_enough_to_stay_in_view() -> None:
    assert SmootherCase("rich", 0, 300).scenario.noise == SLOW["noise"]
    assert SmootherCase("rich", 0).scenario.noise.force_psd == 1e-6


def test_tables_and_pictures_hold_every_motion() -> None:
    motions, slid = {"rich": [batch(), batch(1)]}, {"rich": [sliding()]}
    assert batch_table(motions).row_count == 4
    assert block_table(motions).row_count == 7
    assert start_table(motions).row_count == 2
    assert mode_table(slid, FRAMES).row_count == len(MODES)
    for figure in (nees_figure(motions), bound_figure(motions), sliding_figure(slid)):
        assert len(figure.axes) == 2
