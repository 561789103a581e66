"""Conditioning of process noise: the corrected rule of section 4.9, scalings, and whitening at any time step."""

import numpy as np
import pytest

from observability.conditioning import (
    BEST_CONDITION,
    best_time_step,
    best_velocity_unit,
    condition_number,
    double_integrator_covariance,
    jacobi_scaling,
    noise_covariance,
    scaled,
    suggest_scaling,
    whitening_matrix,
)
from spinfilters.core.errors import InputError, ShapeError
from spinfilters.models.process import ProcessNoise
from spinfilters.plots.observability_figures import conditioning_figure

STEPS = [10.0**k for k in range(-8, 9)]
TUMBLE = np.array([0.05, 1.05, 0.05])


@pytest.mark.parametrize("alpha", [1e-3, 1.0, 3.46, 1e5])
def test_the_best_step_is_the_root_of_three_over_alpha_and_nothing_near_it_is_better(alpha: float) -> None:
    best = best_time_step(alpha)
    assert best == pytest.approx(np.sqrt(3) / alpha, rel=1e-15)
    least = condition_number(double_integrator_covariance(best, alpha))
    assert least == pytest.approx(BEST_CONDITION, rel=1e-12)
    for factor in (0.99, 1.01):
        assert condition_number(double_integrator_covariance(best * factor, alpha)) > least


def test_the_unit_of_velocity_for_an_hour_is_half_a_millimetre_per_second() -> None:
    assert best_velocity_unit(3600.0) == pytest.approx(4.81e-4, rel=1e-3)
    assert best_time_step(best_velocity_unit(3600.0)) == pytest.approx(3600.0)


def test_the_best_ellipse_lies_at_45_degrees() -> None:
    vectors = np.linalg.eigh(double_integrator_covariance(np.sqrt(3)))[1]
    np.testing.assert_allclose(np.abs(vectors), np.sqrt(0.5), atol=1e-14)


@pytest.mark.parametrize("dt", STEPS)
def test_without_rotation_jacobi_scaling_is_best_at_every_step(dt: float) -> None:
    for covariance in (double_integrator_covariance(dt), noise_covariance(dt, np.zeros(3))):
        assert condition_number(scaled(covariance, jacobi_scaling(covariance))) == pytest.approx(
            13.928, abs=1e-3
        )


@pytest.mark.parametrize("dt", STEPS)
@pytest.mark.parametrize("size", [2, 12])
def test_whitening_is_right_to_rounding_at_every_step(dt: float, size: int) -> None:
    covariance = double_integrator_covariance(dt) if size == 2 else noise_covariance(dt, np.zeros(3))
    whitening = whitening_matrix(covariance)
    np.testing.assert_allclose(whitening @ covariance @ whitening.T, np.eye(size), atol=1e-14)


def test_a_condition_number_beyond_double_precision_is_still_right() -> None:
    covariance = double_integrator_covariance(1e-8)
    assert condition_number(covariance) == pytest.approx(12e16, rel=1e-6)


def test_the_suggested_units_are_the_best_where_there_is_no_rotation() -> None:
    scaling = suggest_scaling(0.5, np.zeros(3))
    assert scaling.velocity == pytest.approx(2 * np.sqrt(3))
    assert scaling.rate == pytest.approx(2 * np.sqrt(3))
    assert scaling.after == pytest.approx(BEST_CONDITION)
    assert scaling.before > 3 * scaling.after


def test_the_suggestion_for_a_tumble_is_a_sentence_with_its_numbers() -> None:
    scaling = suggest_scaling(0.1, TUMBLE)
    assert scaling.after < 15 < 1000 < scaling.before
    assert "at 0.1 s hold velocities in units of 17.3 m/s, rates in 17.3 rad/s" in str(scaling)


@pytest.mark.parametrize(("dt", "rate"), [(0.1, 1.0), (2.0, 1.05), (5.0, 20.9)])
def test_no_unit_of_rate_beats_the_suggested_one_or_si_where_it_says_so(dt: float, rate: float) -> None:
    scaling, covariance = (
        suggest_scaling(dt, np.array([0.0, 0.0, rate])),
        noise_covariance(dt, np.array([0.0, 0.0, rate]), ProcessNoise(1.0, 1.0)),
    )
    turn = np.r_[3:6, 9:12]
    rotation = covariance[np.ix_(turn, turn)]
    others = [
        condition_number(scaled(rotation, np.repeat([1.0, alpha], 3)))
        for alpha in np.geomspace(1e-3, 1e3, 121)
    ]
    assert min(others) > 0.98 * min(scaling.before, scaling.after)
    assert ("no unit of rate improves on SI" in str(scaling)) == (scaling.after >= 0.99 * scaling.before)


@pytest.mark.parametrize(
    ("call", "error", "text"),
    [
        (lambda: best_time_step(0.0), InputError, "alpha is 0.0; it must be positive"),
        (lambda: double_integrator_covariance(np.nan), InputError, "dt is nan"),
        (lambda: suggest_scaling(1.0, np.array([np.inf, 0, 0])), InputError, "must be finite, in rad/s"),
        (lambda: jacobi_scaling(np.zeros((2, 3))), ShapeError, "a covariance is square"),
        (lambda: jacobi_scaling(np.diag([1.0, 0.0])), InputError, "leave out what no noise reaches"),
        (lambda: whitening_matrix(np.array([[1.0, 2.0], [2.0, 1.0]])), InputError, "not positive definite"),
    ],
)
def test_wrong_input_is_refused(call, error: type[Exception], text: str) -> None:
    with pytest.raises(error, match=text):
        call()


def test_the_figure_marks_the_best_step_of_every_unit() -> None:
    figure = conditioning_figure(TUMBLE)
    over_time, _, units, whole = figure.axes
    best = [np.asarray(line.get_xdata())[0] for line in units.lines if line.get_marker() == "o"]
    np.testing.assert_allclose(np.sort(best), np.sort(np.sqrt(3) / np.array([0.1, 1.0, 10.0])))
    assert len(whole.lines) == 4
    assert np.min(over_time.lines[0].get_ydata()) == pytest.approx(BEST_CONDITION, rel=1e-2)
