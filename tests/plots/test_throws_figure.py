"""The figure of many throws tells sound ones from degraded ones, and both from the reference."""

from io import BytesIO

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse

from spinfilters.plots.throws import Throw, throws_figure
from tests.plots.run_samples import full_runs

REFERENCE = np.array([0.33, 0.94])


def throws() -> list[Throw]:
    generator = np.random.default_rng(0)
    covariance = np.array([[1e-4, 5e-5], [5e-5, 6e-5]])
    sound = [
        Throw(number, generator.multivariate_normal(REFERENCE, covariance), covariance)
        for number in range(1, 9)
    ]
    return [*sound, Throw(9, np.array([0.7, 0.75]), 50 * covariance, degraded=True)]


def labels(figure: Figure) -> set[str]:
    return {text.get_text() for axes in figure.axes for text in axes.texts}


def test_degraded_throws_are_hollow_and_carry_the_number_of_their_segment() -> None:
    plane = throws_figure(throws(), REFERENCE).axes[0]
    marks = [line for line in plane.lines if line.get_marker() == "o"]
    assert [mark.get_markerfacecolor() == "none" for mark in marks] == [False] * 8 + [True]
    assert labels(throws_figure(throws(), REFERENCE)) == {"9"}


def test_ellipses_hold_95_percent_of_their_covariance() -> None:
    plane = throws_figure(throws()).axes[0]
    ellipse = next(patch for patch in plane.patches if isinstance(patch, Ellipse))
    samples = np.random.default_rng(1).multivariate_normal(throws()[0].ratios, throws()[0].covariance, 4000)
    inside = ellipse.get_path().contains_points(ellipse.get_patch_transform().inverted().transform(samples))
    assert inside.mean() == pytest.approx(0.95, abs=0.02)


def test_limits_show_every_sound_throw_and_the_reference_though_a_degraded_one_lies_far_off() -> None:
    plane = throws_figure(throws(), REFERENCE).axes[0]
    low, high = plane.get_xlim()
    assert all(low < throw.ratios[0] < high for throw in throws()[:8])
    assert low < REFERENCE[0] < high < 0.7


def test_limits_show_the_ellipse_of_a_single_sound_throw() -> None:
    covariance = np.diag([0.045, 0.037]) ** 2
    axes = throws_figure([Throw(1, np.array([0.28, 0.78]), covariance)]).axes
    low, high = axes[0].get_xlim()
    assert low < 0.28 - 2 * 0.045 < 0.28 + 2 * 0.045 < high
    low, high = axes[2].get_ylim()
    assert low < 0.78 - 1.96 * 0.037 < 0.78 + 1.96 * 0.037 < high


@pytest.mark.parametrize("count", [1, 9])
def test_the_figure_is_drawn_for_any_number_of_throws(count: int) -> None:
    target = BytesIO()
    throws_figure(throws()[-count:]).savefig(target, dpi=40)
    assert len(target.getvalue()) > 4000


def test_a_throw_takes_ratios_and_covariance_from_the_body() -> None:
    body = full_runs().without_truth[0].body
    throw = Throw.from_body(3, body)
    np.testing.assert_array_equal(throw.ratios, body.principal_moments[:2])
    np.testing.assert_allclose(np.sqrt(np.diag(throw.covariance)), body.principal_moments_std[:2])
