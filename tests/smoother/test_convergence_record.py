"""Surfaces hold what the smoother said after every epoch, at the right places and nowhere else."""

from dataclasses import replace

import numpy as np
import pytest

from spinfilters.core.errors import InputError
from spinfilters.core.linear_algebra import normalised_square
from spinfilters.filters.timeline import Epoch
from spinfilters.models.status import Verdict
from spinfilters.smoother.recursive_smoother import OUT_OF_VIEW, first_closure, record_convergence
from spinfilters.smoother.window import FixedLag, FullSmoothing
from tests.smoother.smoothing_samples import LAYOUT, MIDDLE, SOON, run, sample, smoother

FRAMES = MIDDLE.epochs


def test_the_surfaces_of_full_smoothing_are_triangles_of_what_each_solve_said() -> None:
    here = sample(MIDDLE)
    surfaces = record_convergence(smoother(here, FullSmoothing()), here.epochs)
    held = np.tri(FRAMES, dtype=bool)
    for values in surfaces.values.values():
        assert (np.isfinite(values).all(axis=2) == held).all()
        assert (np.isnan(values).all(axis=2) == ~held).all()
    for solves in (4, FRAMES):
        said = run(smoother(here, FullSmoothing()), here.epochs[:solves]).smoothed()
        mean, std = (surfaces.values[name][solves - 1, :solves] for name in ("mean", "std"))
        np.testing.assert_array_equal(mean, [row.mean for row in said])
        np.testing.assert_allclose(std, [np.sqrt(np.diag(row.factor @ row.factor.T)) for row in said])
    np.testing.assert_array_equal(surfaces.time, [epoch.time for epoch in here.epochs])


def test_an_epoch_that_left_the_window_is_not_told_of_again() -> None:
    here = sample(MIDDLE)
    sliding = smoother(here, FixedLag(4, SOON), std=np.repeat([1e-6, 0.1, 0.05], [6, 9, 5]))
    mean = record_convergence(sliding, here.epochs).values["mean"]
    held = np.isfinite(mean[..., 0])
    assert held[-1].sum() == len(sliding.window.epochs) < FRAMES
    assert held[-1, -1]
    gone = ~held & np.tri(FRAMES, dtype=bool)
    assert (gone[1:] >= gone[:-1]).all()


def test_standard_deviations_shrink_as_epochs_come_and_errors_stay_within_them() -> None:
    here = sample(MIDDLE)
    surfaces = record_convergence(smoother(here, FullSmoothing()), here.epochs)
    rates = surfaces.values["std"][:, 0, LAYOUT.slice("w")]
    assert (rates[-1] < 0.5 * rates[1]).all()
    assert (np.diff(rates, axis=0) < 0.05 * rates[:-1]).all()
    last = surfaces.latest[-1]
    error = LAYOUT.local(last.mean, here.truth[-1])
    assert normalised_square(error[np.newaxis], last.factor[np.newaxis])[0] < 60


def test_solves_are_trusted_once_the_inertia_is_determined() -> None:
    here = sample(MIDDLE)
    surfaces = record_convergence(smoother(here, FullSmoothing()), here.epochs)
    sliding = run(smoother(here, FullSmoothing()), here.epochs)
    assert not surfaces.trusted[0]
    assert surfaces.trusted[-1] == (sliding.status.verdict is Verdict.OK)


def test_what_is_told_of_a_window_is_chosen_by_the_caller() -> None:
    here, seen = sample(MIDDLE), []
    surfaces = record_convergence(
        smoother(here, FullSmoothing()),
        here.epochs[:3],
        lambda window: {"count": np.full((len(window), 1), float(len(window)))},
        lambda done, total: seen.append((done, total)),
    )
    assert seen == [(1, 3), (2, 3), (3, 3)]
    nan = np.nan
    np.testing.assert_array_equal(surfaces.values["count"][..., 0], [[1, nan, nan], [2, 2, nan], [3, 3, 3]])


def test_every_solve_has_a_time_landmarks_and_factors_from_the_first_on() -> None:
    here = sample(MIDDLE)
    record = record_convergence(smoother(here, FullSmoothing()), here.epochs)
    seconds, landmarks, factors = record.costs.T
    assert (seconds > 0).all()
    assert (np.diff(landmarks) >= 0).all()
    counted = [sum(len(m.ids) for m in epoch.measurements if m.ids is not None) for epoch in here.epochs]
    np.testing.assert_array_equal(np.diff(factors), np.array(counted[1:]) + 1)


def test_a_loop_is_closed_where_landmarks_come_back_that_were_out_of_view() -> None:
    here = sample(MIDDLE)
    seeing = [replace(epoch, time=float(k)) for k, epoch in enumerate([here.epochs[0]] * 3)]
    away = [Epoch(3.0 + k, ()) for k in range(OUT_OF_VIEW)]
    back = replace(here.epochs[0], time=3.0 + OUT_OF_VIEW)
    assert first_closure((*seeing, *away, back)) == len(seeing) + len(away) + 1
    assert first_closure((*seeing, *away[1:], back)) is None


def test_no_frame_and_too_many_frames_are_refused() -> None:
    here = sample(MIDDLE)
    for epochs in ((), tuple(here.epochs) * 60):
        with pytest.raises(InputError, match="epochs"):
            record_convergence(smoother(here, FullSmoothing()), epochs)
