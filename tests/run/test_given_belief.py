"""Estimators that begin from a stated belief, or from one drawn about the truth."""

from typing import Any

import numpy as np
import pytest

import spinfilters
from spinfilters.core.chi_square import chi_square_tail
from spinfilters.core.errors import InputError
from spinfilters.evaluation.consistency import true_states
from spinfilters.settings.run_settings import InitialisationOptions
from spinfilters.simulation.scenario import Scenario, simulate

STD = {"position": 0.005, "attitude": 0.02, "velocity": 0.005, "rate": 0.02}
BODY_STD = {"center_of_mass": 0.005, "mass_distribution": 0.05}


@pytest.fixture(scope="module")
def poses() -> spinfilters.Dataset:
    """A short recording of poses with truth."""
    return spinfilters.simulate("pose", seed=4, frames=30)


def stated(poses: spinfilters.Dataset, **changes: Any) -> dict[str, Any]:
    """The truth of the first epoch as a belief."""
    truth = poses.truth
    assert truth is not None
    from spinfilters.models.state_layout import FULL_BLOCKS, StateLayout

    layout = StateLayout(FULL_BLOCKS)
    first = true_states(truth, layout)[0]
    words = ("position", "attitude", "velocity", "rate", "center_of_mass", "mass_distribution")
    mean = {word: first[layout.mean_slice(name)] for word, name in zip(words, FULL_BLOCKS, strict=True)}
    return {"mean": mean, "std": {**STD, **BODY_STD}, **changes}


def test_a_filter_begins_at_the_first_epoch_from_the_belief(poses: spinfilters.Dataset) -> None:
    belief = stated(poses)
    run = spinfilters.compare(poses, "mekf", belief=belief)
    history = run["mekf"].evaluation.history
    assert history.initialisation == 1
    np.testing.assert_allclose(history.mean[0][:3], belief["mean"]["position"], atol=1e-15)
    said = " ".join(str(run).split())
    assert "The epoch before is the stated belief" in said
    assert "starts from the stated belief" in said


@pytest.mark.parametrize("kind", ["pose", "gyro"])
def test_filter_and_smoother_use_the_same_measurements(kind: str) -> None:
    """With one of them less, the last rate of these six epochs would be less certain."""
    data = spinfilters.simulate(kind, seed=5, frames=6)
    belief: dict[str, Any] = {"std": {"rate": 0.02, "mass_distribution": 0.02}}
    if kind == "pose":
        belief["std"] |= {"position": 0.02, "attitude": 0.02, "velocity": 0.02, "center_of_mass": 0.002}
    run = spinfilters.compare(data, "mekf,rts,smoother", from_truth=3, belief=belief)
    last = {name: each.evaluation.history.belief(-1) for name, each in run.items()}
    for name in ("mekf", "rts"):
        ours, best = (np.linalg.norm(last[each].factor, axis=1) for each in (name, "smoother"))
        np.testing.assert_allclose(ours, best, rtol=0.02)
        away = last[name].layout.local(last["smoother"].mean, last[name].mean)
        assert np.abs(away / best).max() < 0.02


def test_no_smoother_is_called_for_a_filter_from_a_belief(
    poses: spinfilters.Dataset, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise AssertionError("smoothed")

    for place in (
        "spinfilters.inference.initial_estimate.solve",
        "spinfilters.inference.smoother_run.smooth_problem",
        "spinfilters.verdict.filter_diagnostics.smooth_at_once",
    ):
        monkeypatch.setattr(place, refuse)
    assert (
        spinfilters.compare(poses, "mekf", belief=stated(poses), verdict="filter")["mekf"].status
        == "degraded"
    )


def test_a_full_covariance_says_the_same_as_its_deviations(poses: spinfilters.Dataset) -> None:
    belief = stated(poses)
    std = np.concatenate(
        [np.full(5 if word == "mass_distribution" else 3, value) for word, value in belief["std"].items()]
    )
    whole = {"mean": belief["mean"], "covariance": np.diag(std**2)}
    first, second = (
        spinfilters.compare(poses, "mekf", belief=each)["mekf"].trajectory for each in (belief, whole)
    )
    np.testing.assert_allclose(first.rate_i, second.rate_i, rtol=1e-9, atol=1e-12)
    correlated = np.diag(std**2)
    correlated[0, 1] = correlated[1, 0] = 0.5 * std[0] * std[1]
    run = spinfilters.compare(poses, "mekf,smoother", belief={**whole, "covariance": correlated})
    assert all(np.isfinite(each.trajectory.rate_i).all() for each in run.values())


def test_a_belief_drawn_about_the_truth_is_consistent(poses: spinfilters.Dataset) -> None:
    """Ten draws: the mean NEES at the end lies in the central interval of all but one in ten thousand."""
    total, dof = 0.0, 0
    for seed in range(10):
        data = spinfilters.simulate("pose", seed=100 + seed, frames=12)
        nees = spinfilters.compare(data, "mekf", from_truth=seed)["mekf"].evaluation.nees
        assert nees is not None
        total, dof = total + float(nees.total[-1]), dof + nees.dof
    assert 5e-5 < chi_square_tail(total, dof) < 1 - 5e-5


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"mean": {"rate": [0, 0, 1]}}, "does not state position"),
        ({"mean": {"speed": 1}}, "initialisation.mean.speed is unknown; use position"),
        ({"mean": {"rate": [0, 0]}}, "give 3 numbers"),
        ({"mean": {"rate": [0, 0, "x"]}}, "give numbers"),
        ({"mean": {"attitude": [0, 0, 0, 2]}}, "not 1 as a unit quaternion"),
        ({"std": {"rate": -1}}, "initialisation.std.rate is -1"),
        ({"std": {"rate": 0.1}}, "does not state position"),
        ({"covariance": [[1.0]]}, "both state deviations"),
        ({"std": {}, "covariance": [[1.0]]}, "give 20 x 20"),
        ({"median": 1}, "belief.median is unknown"),
        ({"mean": {}, "std": {}}, "belief states no mean"),
    ],
)
def test_a_belief_that_cannot_be_is_refused(
    poses: spinfilters.Dataset, changes: dict[str, Any], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        spinfilters.compare(poses, "mekf", belief=stated(poses, **changes))


def test_filters_map_unknown_landmarks_from_a_belief_whose_pose_defines_their_frame() -> None:
    tracks = spinfilters.simulate("stereo-tracks", frames=12, seed=3)
    assert tracks.known_map is None
    run = spinfilters.compare(tracks, ["mekf", "ukf"], from_truth=1, verdict="filter")
    for result in run.values():
        assert result.evaluation.errors is not None
        assert result.landmarks is not None
        assert len(result.landmarks) > 100
        nees = result.evaluation.nees
        assert nees is not None
        assert nees.total[-1] / nees.dof < 3.0
        assert np.abs(result.evaluation.history.factor[0][:6]).max() < 1e-5  # position and attitude


@pytest.mark.parametrize(
    ("estimators", "belief", "message"),
    [
        ("smoother", {}, "smoother: begins with smoothed first epochs where landmarks are not known"),
        ("mekf,smoother-lag-5", {}, "smoother-lag-5: begins with smoothed first epochs"),
        ("rts", {}, "rts: holds no landmarks"),
        (
            "mekf",
            {"std": {"attitude": 0.1}},
            "std states attitude, which has none where landmarks are not known",
        ),
        ("mekf", {"std": {}, "covariance": np.eye(20).tolist()}, "covariance states the errors of the pose"),
    ],
)
def test_what_unknown_landmarks_do_not_allow_of_a_belief_is_refused(
    estimators: str, belief: dict[str, Any], message: str
) -> None:
    tracks = spinfilters.simulate("stereo-tracks", frames=6)
    mean = {"position": [0, 0, 0.6], "attitude": [0, 0, 0, 1], "rate": [0.1, 1, 0.1]}
    with pytest.raises(InputError, match=message):
        spinfilters.compare(tracks, estimators, belief={"mean": mean, "std": {"rate": 0.1}, **belief})


def test_a_belief_without_a_map_is_refused_where_the_verdict_could_say_ok() -> None:
    tracks = spinfilters.simulate("stereo-tracks", frames=6)
    with pytest.raises(InputError, match=r"over-confident.*use --verdict filter"):
        spinfilters.compare(tracks, "mekf", from_truth=1)


def test_a_belief_about_the_truth_needs_one() -> None:
    gyro = spinfilters.simulate("gyro", frames=12)
    rows = gyro.log.streams[0]
    table = np.column_stack([rows.time, rows.values])
    with pytest.raises(InputError, match="needs a truth"):
        spinfilters.compare(table, "mekf", kind="gyro", from_truth=1)


def test_a_gyro_begins_from_its_rate_and_moments_alone() -> None:
    gyro = spinfilters.simulate("gyro", frames=30, seed=2)
    assert gyro.truth is not None
    mean = {"rate": gyro.log.streams[0].values[0], "principal_moments": [1.2, 1.1, 1.0]}
    run = spinfilters.compare(
        gyro, "mekf", belief={"mean": mean, "std": {"rate": 0.05, "mass_distribution": 0.3}}
    )
    assert np.isfinite(run["mekf"].body.principal_moments).all()


def test_settings_with_a_belief_are_written_and_read_again() -> None:
    initialisation = InitialisationOptions(mean={"rate": [0.0, 0.0, 1.0]}, std={"rate": 0.1})
    settings = spinfilters.Settings(initialisation=initialisation)
    assert spinfilters.Settings(**settings.document) == settings


def test_a_smoother_begins_from_measurements_where_the_filter_lost_the_motion() -> None:
    """Of ten times the usual deviations; the filter's trajectory does not lead to the solution here."""
    std = {"position": 0.05, "attitude": 0.2, "velocity": 0.05, "rate": 0.2}
    std |= {"center_of_mass": 0.05, "mass_distribution": 0.5}
    data = simulate(Scenario(kind="pose", seed=4, epochs=100, rate_rpm=(4.0, 9.0, 3.0)))
    run = spinfilters.compare(data, "smoother", from_truth=4, belief={"std": std}, verdict="filter")
    nees = run["smoother"].evaluation.nees
    assert "smoother-unsettled" not in str(run["smoother"].evaluation.history.status)
    assert nees is not None
    assert nees.total[-1] / nees.dof < 2.0
