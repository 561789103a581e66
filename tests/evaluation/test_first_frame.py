"""Estimates whose g is defined by their first frame, against a truth in another g."""

import json
from dataclasses import replace

import numpy as np
import pytest

from spinfilters.core.attitude_conversions import (
    inverse,
    matrix_from_quaternion,
    multiply,
    quaternion_from_rotation_vector,
    rotate,
)
from spinfilters.core.errors import InputError
from spinfilters.core.mass_distribution import from_inertia, inertia_matrix
from spinfilters.evaluation.consistency import chi_square_band, true_states
from spinfilters.evaluation.estimated_motion import estimated_rates, true_rates
from spinfilters.evaluation.estimator_evaluation import Evaluation, evaluate
from spinfilters.evaluation.trajectory_errors import Alignment, tells_first_frame, truth_in_first_frame
from spinfilters.filters.history import EstimateHistory
from spinfilters.models.state_blocks import BLOCKS
from spinfilters.models.state_layout import ROTATION_BLOCKS, StateLayout
from spinfilters.run.run_summary import estimator_numbers
from tests.evaluation.estimate_samples import (
    FULL,
    consistent_history,
    history_of,
    sample_factor,
    sample_truth,
)

COUNT = 300
TRUTH = sample_truth(np.random.default_rng(0), COUNT)
TURN = quaternion_from_rotation_vector(np.array([1.1, -0.7, 2.0]))
SHIFT = np.array([0.3, -0.5, 0.2])
"""The estimate's g in the truth's: p_true = R(TURN) p_estimate + SHIFT."""
GAUGE = [*range(*FULL.slice("t").indices(FULL.error_dim)), *range(*FULL.slice("a").indices(FULL.error_dim))]


def in_another_frame(states: np.ndarray, turn: np.ndarray, shift: np.ndarray) -> np.ndarray:
    """The same motion told in the g of the estimate, block by block from the formulas of the conventions."""
    t, q, w, c, s = (states[:, FULL.mean_slice(block)] for block in "tawcs")
    moved, R = states.copy(), matrix_from_quaternion(turn)
    moved[:, FULL.mean_slice("t")] = t + matrix_from_quaternion(q) @ shift
    moved[:, FULL.mean_slice("a")] = multiply(q, turn)
    moved[:, FULL.mean_slice("w")] = rotate(inverse(turn), w)
    moved[:, FULL.mean_slice("c")] = rotate(inverse(turn), c - shift)
    moved[:, FULL.mean_slice("s")] = [from_inertia(R.T @ inertia_matrix(row) @ R) for row in s]
    return moved


def defining(history: EstimateHistory) -> EstimateHistory:
    """The history with a first frame whose pose is exact, as a definition of g is."""
    mean, factor = history.mean.copy(), history.factor.copy()
    exact = in_another_frame(true_states(TRUTH, FULL)[:1], TURN, SHIFT)[0]
    for block in "ta":
        mean[0, FULL.mean_slice(block)] = exact[FULL.mean_slice(block)]
    factor[0, GAUGE] = 0.0
    factor[0, GAUGE, GAUGE] = 1e-6
    return replace(history, mean=mean, factor=factor)


def perfect() -> EstimateHistory:
    """The truth itself in another g, with doubts of a millimetre and a milliradian."""
    states = in_another_frame(true_states(TRUTH, FULL), TURN, SHIFT)
    generator = np.random.default_rng(1)
    return defining(history_of(states, np.array([sample_factor(generator, FULL.error_dim, 1e-3)] * COUNT)))


def consistent() -> EstimateHistory:
    """Estimates in another g whose errors are drawn from their covariance; the first frame defines g."""
    generator = np.random.default_rng(2)
    history = consistent_history(TRUTH, generator, 1e-4)
    states = in_another_frame(true_states(TRUTH, FULL), TURN, SHIFT)
    drawn = np.einsum("nij,nj->ni", history.factor, generator.standard_normal((COUNT, FULL.error_dim)))
    return defining(replace(history, mean=FULL.retract(states, -drawn)))


def error_sizes(evaluation: Evaluation) -> dict[str, float]:
    """Largest component of every error by name."""
    errors, body = evaluation.errors, evaluation.body_errors
    assert errors is not None
    assert body is not None
    found = vars(errors) | vars(body)
    names = (
        "position",
        "attitude",
        "velocity",
        "rate",
        "principal_moments",
        "axes_angle",
        "center_of_mass_g",
    )
    return {name: float(np.abs(found[name]).max()) for name in names}


def test_a_perfect_estimate_in_a_shifted_and_turned_frame_has_no_error_and_no_nees() -> None:
    evaluation = evaluate(perfect(), TRUTH, Alignment.FIRST_FRAME)
    assert evaluation.alignment is Alignment.FIRST_FRAME
    assert evaluation.nees is not None
    assert max(error_sizes(evaluation).values()) < 1e-7
    assert evaluation.nees.dof == 20
    assert evaluation.nees.total.max() < 1e-9
    assert all(values.max() < 1e-9 for values in evaluation.nees.blocks.values())


def test_a_wrong_constant_transformation_does_not_go_unnoticed() -> None:
    exact = perfect()
    for block, wrong in (("t", np.array([0.01, 0.0, 0.0])), ("a", np.array([0.0, 0.02, 0.0]))):
        mean, error = exact.mean.copy(), np.zeros(FULL.error_dim)
        error[FULL.slice(block)] = wrong
        mean[0] = FULL.retract(mean[0], error)
        evaluation = evaluate(replace(exact, mean=mean), TRUTH, Alignment.FIRST_FRAME)
        assert evaluation.nees is not None
        assert error_sizes(evaluation)["center_of_mass_g"] > 4e-3
        assert np.median(evaluation.nees.total) > 20
        assert np.median(evaluation.nees.blocks["c"]) > 3
        assert (np.median(evaluation.nees.blocks["s"]) > 5) == (block == "a")
    unaligned = evaluate(exact, TRUTH, Alignment.NONE)
    assert error_sizes(unaligned)["attitude"] > 1
    assert error_sizes(unaligned)["center_of_mass_g"] > 0.1


def test_nees_of_a_consistent_estimate_lies_in_the_band_as_a_whole_and_by_block() -> None:
    nees = evaluate(consistent(), TRUTH, Alignment.FIRST_FRAME).nees
    assert nees is not None
    low, high = chi_square_band(nees.dof, COUNT - 1, 0.999)
    assert low < nees.total[1:].mean() < high
    for block, values in nees.blocks.items():
        low, high = chi_square_band(BLOCKS[block].dimension, COUNT - 1, 0.999)
        assert low < values[1:].mean() < high, block
    assert nees.blocks["t"][0] < 1e-9
    assert nees.blocks["a"][0] < 1e-9


def test_the_truth_in_the_first_frame_describes_the_same_motion_in_inertial_axes() -> None:
    told = truth_in_first_frame(perfect(), TRUTH)
    for name in ("time", "center_of_mass", "velocity", "rate_i", "principal_moments"):
        np.testing.assert_array_equal(getattr(told, name), getattr(TRUTH, name))
    expected = in_another_frame(true_states(TRUTH, FULL), TURN, SHIFT)
    np.testing.assert_allclose(FULL.local(expected, true_states(told, FULL)), 0.0, atol=1e-12)


def test_numbers_tell_the_alignment_and_the_nees_of_every_block() -> None:
    found = estimator_numbers(evaluate(consistent(), TRUTH, Alignment.FIRST_FRAME))["errors"]
    assert json.loads(json.dumps(found, allow_nan=False)) == found
    assert found["alignment"] == "first frame"
    for block in FULL.blocks:
        value = found[f"nees_per_dof_{block}"]
        assert isinstance(value, float)
        assert 0.8 < value < 1.2


def test_true_rates_meet_the_estimate_in_its_frame() -> None:
    history = perfect()
    errors = evaluate(history, TRUTH, Alignment.FIRST_FRAME).errors
    assert errors is not None
    np.testing.assert_allclose(
        true_rates(TRUTH, errors.frame).rate, estimated_rates(history).rate, atol=1e-12
    )


def measured_first_pose(history: EstimateHistory) -> EstimateHistory:
    factor = history.factor.copy()
    factor[0] = 1e-3 * np.eye(FULL.error_dim)
    return replace(history, factor=factor)


@pytest.mark.parametrize(
    ("history", "truth"),
    [
        (perfect(), replace(TRUTH, center_of_mass_g=None)),
        (perfect(), replace(TRUTH, time=np.append(-1.0, TRUTH.time[1:]))),
        (measured_first_pose(perfect()), TRUTH),
    ],
    ids=["no centre of mass", "no true pose at the first frame", "a first pose in doubt"],
)
def test_where_the_first_frame_does_not_tell_a_rotation_is_fitted_and_nees_left_out(
    history: EstimateHistory, truth: object
) -> None:
    assert isinstance(truth, type(TRUTH))
    assert not tells_first_frame(history, truth)
    evaluation = evaluate(history, truth, Alignment.FIRST_FRAME)
    assert evaluation.alignment is Alignment.BODY_FRAME
    assert evaluation.nees is None
    assert evaluation.errors is not None
    assert np.abs(evaluation.errors.attitude).max() < 1e-7
    with pytest.raises(InputError, match="BODY_FRAME"):
        truth_in_first_frame(history, truth)


def test_a_state_of_rotations_has_no_first_pose() -> None:
    layout = StateLayout(ROTATION_BLOCKS)
    history = history_of(
        true_states(TRUTH, layout), np.tile(1e-6 * np.eye(layout.error_dim), (COUNT, 1, 1)), layout
    )
    assert not tells_first_frame(history, TRUTH)
    assert evaluate(history, TRUTH, Alignment.FIRST_FRAME).alignment is Alignment.INERTIAL_FRAME


@pytest.mark.parametrize("std", [1e-6, 1e-2], ids=["attitude defined", "attitude fitted"])
def test_errors_of_rotations_do_not_hang_on_the_inertial_frame_of_the_truth(std: float) -> None:
    layout = StateLayout(ROTATION_BLOCKS)
    history = history_of(
        true_states(TRUTH, layout), np.tile(std * np.eye(layout.error_dim), (COUNT, 1, 1)), layout
    )
    turned = replace(
        TRUTH,
        q_ig=multiply(TURN, TRUTH.q_ig),
        rate_i=rotate(TURN, TRUTH.rate_i),
        velocity=rotate(TURN, TRUTH.velocity),
        center_of_mass=rotate(TURN, TRUTH.center_of_mass),
    )
    errors = evaluate(history, turned, Alignment.FIRST_FRAME).errors
    assert errors is not None
    np.testing.assert_allclose(errors.attitude, 0, atol=1e-9)
    np.testing.assert_allclose(errors.rate, 0, atol=1e-9)


def test_a_frame_fitted_to_the_measurements_takes_six_degrees_of_freedom_whatever_the_fit() -> None:
    generator, fitted = np.random.default_rng(4), replace(TRUTH, frame_is_fitted=True)
    history = consistent_history(TRUTH, generator, 1e-4)
    low, high = chi_square_band(14, COUNT)
    nees = evaluate(history, fitted).nees
    assert nees is not None
    assert nees.dof == 14
    assert low < nees.total.mean() < high
    turn, shift = quaternion_from_rotation_vector(np.array([1e-3, -2e-3, 1e-3])), np.array([1e-3, 2e-3, 0.0])
    moved = replace(history, mean=in_another_frame(history.mean, turn, shift))
    away, counted = evaluate(moved, fitted).nees, evaluate(moved, TRUTH).nees
    assert away is not None
    assert counted is not None
    assert counted.mean > 50
    assert low < away.total.mean() < high
