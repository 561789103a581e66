"""Checkout of a stored calibration, and what differs between two: good ones pass, bent ones fail, changes have deviations."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from spinfilters.core.attitude_conversions import matrix_from_rotation_vector
from spinfilters.core.errors import InputError
from spinfilters.simulation.board_images import drawn_poses, projected
from spinfilters.simulation.image_sequence import example_rig
from spinfilters.vision.calibration_checkout import (
    CalibrationDeviations,
    calibration_changes,
    check_stored,
    read_deviations,
    rotation_change,
)
from spinfilters.vision.calibration_images import Board, BoardView
from spinfilters.vision.rectification import RawRig

BOARD = Board(9, 6, 0.025)
TURN = np.deg2rad([0.1, 0.3, 0.05])


def views(rig: RawRig, count: int = 4) -> list[BoardView]:
    """Exact corners of the board at drawn poses."""
    generator = np.random.default_rng(2)
    poses = drawn_poses("good", count, rig, BOARD, generator)
    seen = np.ones(len(BOARD.points), dtype=bool)
    pixels = [projected(rig, BOARD.points, pose) for pose in poses]
    return [BoardView(f"left{k}.png", left, right, seen) for k, (left, right) in enumerate(pixels)]


def turned(rig: RawRig, rotation_vector: np.ndarray) -> RawRig:
    """The rig with a right camera that is turned in its place."""
    rotation = matrix_from_rotation_vector(rotation_vector) @ rig.relative_rotation
    return RawRig(rig.left, replace(rig.right, R_bc=rotation.T, t_bc=rig.right.t_bc))


def test_a_calibration_passes_on_its_own_images_and_fails_behind_a_knock() -> None:
    rig = example_rig()
    good, knocked = (
        check_stored(rig, views(rig), BOARD),
        check_stored(turned(rig, 20 * TURN), views(rig), BOARD),
    )
    assert good.passed
    assert good.level.all()
    assert 0.3 < good.distance < 0.9
    assert not knocked.passed
    assert not knocked.level.all()


def test_a_board_of_other_squares_fails_by_their_size_alone() -> None:
    rig = example_rig()
    found = check_stored(rig, views(rig), replace(BOARD, square=0.024))
    assert [result.name for result in found.results if not result.passed] == ["measured square"]


def test_no_view_is_refused() -> None:
    with pytest.raises(InputError, match="no view of the board"):
        check_stored(example_rig(), [], BOARD)


def test_changes_are_differences_with_the_deviations_of_both() -> None:
    rig = example_rig()
    stated = CalibrationDeviations(np.full((2, 4), 0.3), np.array([1e-4, 2e-4, np.nan]), np.full(3, 1e-3))
    same = calibration_changes(rig, rig)
    assert all(each.difference == 0.0 and each.std is None for each in same)
    changes = calibration_changes(rig, turned(rig, TURN), stated, stated)
    by_name = {each.name: each for each in changes}
    found = [by_name[f"rotation change about {axis}"].second for axis in "xyz"]
    np.testing.assert_allclose(found, np.rad2deg(TURN), atol=1e-9)
    assert by_name["left focal length fx"].std == pytest.approx(0.3 * np.sqrt(2))
    assert by_name["translation x"].std == pytest.approx(0.1 * np.sqrt(2))
    assert by_name["translation y"].std == pytest.approx(0.2 * np.sqrt(2))
    assert by_name["translation z"].std is None
    assert by_name["rotation change about y"].deviations == pytest.approx(TURN[1] / (1e-3 * np.sqrt(2)))
    angle, axis = rotation_change(rig, turned(rig, TURN))
    np.testing.assert_allclose(angle * axis, TURN, atol=1e-12)


def test_deviations_that_are_none_are_refused(tmp_path: Path) -> None:
    assert read_deviations(tmp_path) is None
    (tmp_path / "calibration.json").write_text('{"cam0": 3}')
    with pytest.raises(InputError, match="no standard deviations"):
        read_deviations(tmp_path)
