"""The sampled posterior: a Gaussian where the smoother's is one, and the same by both ways of sampling."""

from dataclasses import replace
from functools import cache, partial

import numpy as np
import pytest

from spinfilters import compare, simulate
from spinfilters.evaluation.stated_errors import posterior_quantities
from spinfilters.inference.smoother_run import smooth_at_once, smoothed_problem
from spinfilters.run.preparation import prepare
from spinfilters.settings.run_settings import Settings
from spinfilters.smoother import mass_posterior
from spinfilters.smoother import posterior as posterior_module
from spinfilters.smoother.linear_system import Marginals
from spinfilters.smoother.mass_posterior import MassSampler, even_points
from spinfilters.smoother.posterior import MassFrame, Posterior, SamplingOptions, sample_posterior
from spinfilters.smoother.problem import InitialGuess
from tests.smoother.smoothing_samples import LONG, sample, solved

FEW = SamplingOptions(samples=128)
FEWEST = SamplingOptions(samples=24, walkers=12, steps=2, settling=0)


@pytest.fixture(autouse=True)
def hardly_tried(monkeypatch: pytest.MonkeyPatch) -> None:
    """How far a Gaussian would do as a proposal is no question of these tests."""
    for module in (posterior_module, mass_posterior):
        monkeypatch.setattr(module, "TRIED", 12)


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
    found = compare(data, ["smoother", "posterior"], verdict="filter").summary["estimators"]
    for name in ("attitude", "rate", "moments", "axes"):
        assert found["smoother"]["posterior_divergence"][name] < 0.01
        assert found["smoother"]["posterior_tail"][name] == pytest.approx(0.05, abs=0.03)
    std = np.array([found[name]["principal_moments_std"][:2] for name in ("smoother", "posterior")])
    assert std[1] == pytest.approx(std[0], rel=0.08)


def test_walkers_find_the_posterior_that_importance_finds() -> None:
    rates = (2.0, 6.0, 1.0)
    walked = posterior(rates, SamplingOptions(64, -np.inf, walkers=16, steps=18, settling=4))
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


def test_quantiles_of_few_samples_do_not_depend_on_which(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mass_posterior, "SAMPLES", 40)  # of the smoother, whose Gaussian is all that is used
    setup = prepare(simulate("gyro", rate_rpm=(4.0, 9.0, 3.0), frames=30, seed=2), Settings())
    problem, smoothed = smoothed_problem(setup, Settings())
    history, found = smooth_at_once(setup, Settings(), lambda done, every: None), []
    for seed in (1, 2):
        sampled = sample_posterior(problem, smoothed.mean, replace(FEW, seed=seed))
        assert sampled is not None
        found.append(posterior_quantities(sampled.last, history)["moments"].quantiles())
    width = found[0][:, -1:] - found[0][:, :1]
    assert np.abs((found[0] - found[1]) / width).max() < 0.05


def test_landmarks_are_integrated_out_with_the_motion() -> None:
    here = sample(replace(LONG, pixel_std=0.1), pixel_std=0.1)
    rich = solved(here, InitialGuess(here.truth, here.known.ids, here.known.points))
    found = sample_posterior(
        rich.problem, rich.point.trajectory, FEW, points=rich.point.points, used=rich.normal.used
    )
    assert found is not None
    layout, last = rich.problem.layout, rich.point.trajectory[-1]
    stated = np.linalg.norm(Marginals(rich.normal.system, rich.normal.eliminated).factors[-1], axis=1)
    assert np.abs(layout.local(last, found.mean[-1]) / stated).max() < 0.3
    assert np.linalg.norm(found.factor[-1], axis=1) == pytest.approx(stated, rel=0.15)
    assert found.last.method == "importance"


def test_the_posterior_takes_tracks_without_a_map() -> None:
    data = simulate("stereo-tracks", rate_rpm=(0.5, 10.0, 0.5), frames=16, seed=1)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(posterior_module, "sample_posterior", partial(sample_posterior, options=FEWEST))
        found = compare(data, ["smoother", "posterior"], verdict="filter")
    assert found["posterior"].evaluation.history.posterior is not None
    distances = found["smoother"].evaluation.distances
    assert distances is not None
    assert set(distances) >= {"attitude", "rate", "moments", "axes"}
    own = found["posterior"].evaluation.distances
    assert own is not None
    assert own["attitude"].divergence < 0.1  # its Gaussian and its samples agree about the motion


def test_mixtures_about_far_nodes_are_densities_in_one_volume() -> None:
    setup = prepare(simulate("gyro", rate_rpm=(4.0, 9.0, 3.0), frames=12, seed=2), Settings())
    problem, found = smoothed_problem(setup, Settings())
    sampler = MassSampler(problem)
    node = sampler.node(found.mean)
    assert node is not None
    d = np.array([0.6, -0.3, 0.25, 0.0, 0.15])
    wide = [
        replace(node, trajectory=sampler.moved(node, sign * d), covariance=np.diag([0.4] * 5))
        for sign in (1, -1)
    ]
    one, other = np.array([0.95, 0.05]), np.array([0.4, 0.6])
    points = MassFrame(sampler, wide).drawn(20_000, other, 1)
    logs = [sampler.log_proposal(points, wide, share) for share in (one, other)]
    assert np.exp(logs[0] - logs[1]).mean() == pytest.approx(1.0, abs=0.003)  # without volumes .986


def test_even_points_fill_the_cube_evenly() -> None:
    points = even_points(512, 7, 0)
    assert ((points > 0) & (points < 1)).all()
    counts = np.histogram(points[:, 0], bins=16, range=(0, 1))[0]
    assert np.abs(counts - 32).max() <= 4
    assert points.mean(axis=0) == pytest.approx(np.full(7, 0.5), abs=0.01)
