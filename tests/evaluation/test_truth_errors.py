"""Errors against the truth: signs, frames, time stamps, and the figures that evo prints."""

from dataclasses import replace

import numpy as np
import pytest

from spinfilters.core.attitude_conversions import (
    angle_between,
    inverse,
    multiply,
    quaternion_from_rotation_vector,
    rotate,
)
from spinfilters.core.errors import InputError
from spinfilters.evaluation.consistency import true_states
from spinfilters.evaluation.estimated_motion import Trajectory, trajectory_of
from spinfilters.evaluation.trajectory_errors import (
    Alignment,
    attitude_alignment,
    body_errors,
    common_stamps,
    truth_errors,
)
from spinfilters.io.truth import Truth
from spinfilters.models.body import body_estimate
from spinfilters.models.state_layout import Gaussian
from tests.evaluation.estimate_samples import AXES, FULL, history_of, sample_truth

TRUTH = sample_truth(np.random.default_rng(0), 12)


def exact_trajectory(truth: Truth) -> Trajectory:
    states = true_states(truth, FULL)
    return trajectory_of(history_of(states, np.tile(np.eye(FULL.error_dim), (len(states), 1, 1))))


def turned(trajectory: Trajectory, rotation: np.ndarray) -> Trajectory:
    """The same motion told in another frame g: q_ig (x) rotation."""
    return replace(trajectory, q_ig=multiply(trajectory.q_ig, rotation))


def test_the_true_trajectory_has_no_error() -> None:
    errors = truth_errors(exact_trajectory(TRUTH), TRUTH)
    assert errors.position is not None
    assert errors.velocity is not None
    for error in (errors.position, errors.attitude, errors.velocity, errors.rate):
        np.testing.assert_allclose(error, 0.0, atol=1e-14)


def test_the_attitude_error_takes_the_truth_to_the_estimate_on_the_body_side() -> None:
    vector = np.array([0.3, -0.2, 0.1])
    errors = truth_errors(turned(exact_trajectory(TRUTH), quaternion_from_rotation_vector(vector)), TRUTH)
    np.testing.assert_allclose(errors.attitude, np.tile(vector, (12, 1)), atol=1e-13)
    assert errors.frame is None


def test_alignment_finds_a_known_rotation_between_both_frames_g() -> None:
    known = quaternion_from_rotation_vector(np.array([2.0, -1.0, 1.5]))
    generator = np.random.default_rng(1)
    noise = quaternion_from_rotation_vector(1e-3 * generator.standard_normal((12, 3)))
    signs = np.where(generator.random(12) < 0.5, -1.0, 1.0)[:, np.newaxis]
    q = signs * multiply(multiply(TRUTH.q_ig, known), noise)
    assert angle_between(attitude_alignment(q, TRUTH.q_ig), known) < 2e-3
    trajectory = turned(exact_trajectory(TRUTH), known)
    assert truth_errors(trajectory, TRUTH).ape_angle_rmse_deg > 57
    aligned = truth_errors(trajectory, TRUTH, Alignment.BODY_FRAME)
    np.testing.assert_allclose(aligned.attitude, 0.0, atol=1e-13)
    np.testing.assert_allclose(aligned.rate, 0.0, atol=1e-13)


def test_ape_is_the_hand_computed_root_mean_square() -> None:
    truth = sample_truth(np.random.default_rng(2), 4)
    shift = np.array([[3.0, 4.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 5.0], [1.0, 1.0, 1.0]])
    turns = np.deg2rad([[10.0, 0.0, 0.0], [0.0, -20.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 20.0]])
    exact = exact_trajectory(truth)
    q = multiply(exact.q_ig, quaternion_from_rotation_vector(turns))
    errors = truth_errors(replace(exact, position=exact.position + shift, q_ig=q), truth)
    assert errors.ape_rmse == pytest.approx(np.sqrt((25 + 0 + 25 + 3) / 4))
    assert errors.ape_angle_rmse_deg == pytest.approx(15.0)


def test_a_span_of_time_leaves_out_the_rest() -> None:
    exact = exact_trajectory(TRUTH)
    position = exact.position.copy()
    position[:5] += 100.0
    position[6:] += np.array([0.0, 2.0, 0.0])
    errors = truth_errors(replace(exact, position=position), TRUTH)
    late = errors.within(6.0, np.inf)
    assert late is not None
    assert late.rms.position == pytest.approx(2.0)
    assert late.rows.tolist() == list(range(6, 12))
    assert errors.within(100.0, 200.0) is None
    assert errors.rms.position is not None
    assert errors.rms.position > 100


def test_only_common_stamps_are_compared() -> None:
    rows, reference = common_stamps(
        np.array([0.0, 0.5, 1.0 + 4e-7, 2.0, 9.0]), np.array([0.5, 1.0, 2.1, 9.0])
    )
    assert rows.tolist() == [1, 2, 4]
    assert reference.tolist() == [0, 1, 3]
    assert common_stamps(np.array([3.0]), np.array([3.0]))[0].tolist() == [0]


def test_a_truth_at_other_times_is_refused_with_both_spans() -> None:
    late = replace(TRUTH, time=TRUTH.time + 0.25)
    with pytest.raises(InputError, match=r"12 from 0\.000000 s to 11\.000000 s.*0\.250000 s to 11\.250000 s"):
        truth_errors(exact_trajectory(TRUTH), late)


def test_errors_of_a_body_know_neither_scale_nor_order_nor_signs_of_the_true_axes() -> None:
    belief = Gaussian(FULL, true_states(TRUTH, FULL)[0], 1e-3 * np.eye(FULL.error_dim))
    axes = TRUTH.principal_axes_g
    assert axes is not None
    other = replace(
        TRUTH,
        principal_moments=5.0 * np.array([1.0, 0.6, 0.85]),
        principal_axes_g=np.array([-axes[2], axes[0], -axes[1]]),
    )
    for truth in (TRUTH, other):
        errors = body_errors(body_estimate(belief), truth)
        assert errors.principal_moments is not None
        assert errors.axes_angle is not None
        np.testing.assert_allclose(errors.principal_moments, 0.0, atol=1e-12)
        np.testing.assert_allclose(errors.axes_angle, 0.0, atol=1e-7)
        assert (errors.k1, errors.k2) == pytest.approx((0.0, 0.0), abs=1e-12)


def test_principal_axes_are_compared_in_the_frame_of_the_truth() -> None:
    frame = quaternion_from_rotation_vector(np.array([0.5, 1.0, -0.3]))
    body = body_estimate(Gaussian(FULL, true_states(TRUTH, FULL)[0], 1e-3 * np.eye(FULL.error_dim)))
    elsewhere = replace(body, principal_axes_g=rotate(inverse(frame), AXES))
    unaligned, aligned = body_errors(elsewhere, TRUTH), body_errors(elsewhere, TRUTH, frame)
    assert unaligned.axes_angle is not None
    assert aligned.axes_angle is not None
    assert unaligned.axes_angle.max() > 0.3
    np.testing.assert_allclose(aligned.axes_angle, 0.0, atol=1e-7)
    assert aligned.center_of_mass_g is None
