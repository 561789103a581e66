"""The sampled posterior: a Gaussian where the smoother's is one, and the same by both ways of sampling."""

from functools import cache

import numpy as np
import pytest

from spinfilters import compare, simulate
from spinfilters.inference.smoother_run import smoothed_problem
from spinfilters.run.preparation import prepare
from spinfilters.settings.run_settings import Settings
from spinfilters.smoother.mass_posterior import even_points
from spinfilters.smoother.posterior import Posterior, SamplingOptions, sample_posterior

FEW = SamplingOptions(samples=128)


@cache
def posterior(rates: tuple[float, float, float], options: SamplingOptions) -> Posterior:
    """Of a short gyro recording."""
    setup = prepare(simulate("gyro", rate_rpm=rates, frames=20, seed=2), Settings())
    problem, found = smoothed_problem(setup, Settings())
    sampled = sample_posterior(problem, found.mean, options)
    assert sampled is not None
    return sampled


def test_a_rich_motion_has_the_gaussian_of_the_smoother() -> None:
    data = simulate("gyro", rate_rpm=(4.0, 9.0, 3.0), frames=100, seed=3)
    found = compare(data, ["smoother", "posterior"]).summary["estimators"]
    for name in ("attitude", "rate", "moments", "axes"):
        assert found["smoother"]["posterior_divergence"][name] < 0.01
        assert found["smoother"]["posterior_tail"][name] == pytest.approx(0.05, abs=0.03)
    std = np.array([found[name]["principal_moments_std"][:2] for name in ("smoother", "posterior")])
    assert std[1] == pytest.approx(std[0], rel=0.08)


def test_walkers_find_the_posterior_that_importance_finds() -> None:
    rates = (2.0, 6.0, 1.0)
    walked = posterior(rates, SamplingOptions(128, -np.inf, walkers=16, steps=24, settling=4))
    weighted = posterior(rates, FEW)
    assert (walked.last.method, weighted.last.method) == ("mcmc", "importance")
    for each in (walked, weighted):
        assert len(each.last.weights) == len(each.last.means) == len(each.last.factors)
    mean = [each.mass.weights @ each.mass.principal_moments[:, :2] for each in (walked, weighted)]
    away = weighted.mass.principal_moments[:, :2] - mean[1]
    std = np.sqrt(weighted.mass.weights @ np.square(away))
    assert mean[0] == pytest.approx(mean[1], abs=0.5 * float(std.max()))
    walked_away = walked.mass.principal_moments[:, :2] - mean[0]
    assert np.sqrt(walked.mass.weights @ np.square(walked_away)) == pytest.approx(std, rel=0.5)


def test_tracks_without_a_map_are_refused() -> None:
    with pytest.raises(Exception, match="posterior"):
        compare(simulate("stereo-tracks", frames=30), ["posterior"])


def test_even_points_fill_the_cube_evenly() -> None:
    points = even_points(512, 7, 0)
    assert ((points > 0) & (points < 1)).all()
    counts = np.histogram(points[:, 0], bins=16, range=(0, 1))[0]
    assert np.abs(counts - 32).max() <= 4
    assert points.mean(axis=0) == pytest.approx(np.full(7, 0.5), abs=0.01)
