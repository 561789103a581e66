"""Attitudes of a table that are no quaternions: rotation matrices and modified Rodrigues parameters."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from spinfilters.core.errors import InputError
from spinfilters.run.readers import read_dataset
from tests.io.logger_motion import COUNT, PLACE, TIME, TURN, text

SPUN = np.column_stack([np.zeros((COUNT, 2)), np.full(COUNT, 0.8)])
"""Body rates of `TURN`, rad/s."""
MRP = TURN[:, :3] / (1.0 + TURN[:, 3:])
TILTED = (Rotation.from_rotvec([0.3, -0.5, 0.2]) * Rotation.from_quat(TURN)).as_matrix()
"""Matrices without zeros and ones, of which rounding moves every element."""
HEAD = "time_s,px,py,pz,r11,r12,r13,r21,r22,r23,r31,r32,r33,wx,wy,wz\n"


def test_a_matrix_of_four_decimals_is_read_beside_rates(tmp_path: Path) -> None:
    matrices = Rotation.from_quat(TURN).as_matrix().round(4)
    rows = np.column_stack([TIME, PLACE, matrices.reshape(-1, 9), SPUN])
    dataset = read_dataset(text(tmp_path / "track.csv", HEAD, rows.tolist()))
    assert dataset.kind == "pose"
    np.testing.assert_allclose(dataset.log.streams[0].values[:, 3:], TURN, atol=1e-4)


def test_rodrigues_parameters_of_almost_a_whole_turn_are_refused_with_file_and_line(tmp_path: Path) -> None:
    s = MRP.copy()
    s[3, 1] = 1e200
    path = text(tmp_path / "s.csv", "time_s,sigma_BN_0,sigma_BN_1,sigma_BN_2\n", np.column_stack([TIME, s]))
    with pytest.raises(
        InputError,
        match=r"s\.csv: line 5: .*1e\+200, not a number from -1e\+06 to 1e\+06; correct or delete the line$",
    ):
        read_dataset(path)


@pytest.mark.parametrize(
    "names",
    [
        ["sigma_BN_0", "sigma_BN_1", "sigma_BN_2"],
        ["sigma_BN_1", "sigma_BN_2", "sigma_BN_3"],
        ["sigma_BN[1]", "sigma_BN[2]", "sigma_BN[3]"],
        ["sigma_BN(1)", "sigma_BN(2)", "sigma_BN(3)"],
    ],
)
def test_rodrigues_parameters_are_counted_from_0_or_from_1(tmp_path: Path, names: list[str]) -> None:
    rows = np.column_stack([TIME, MRP])[:, [0, 3, 1, 2]]  # by their names, not by their order
    head = ",".join(["time_s", names[2], names[0], names[1]]) + "\n"
    dataset = read_dataset(text(tmp_path / "s.csv", head, rows.tolist()))
    (stream,) = dataset.log.streams
    assert stream.sensor == "attitude"
    np.testing.assert_allclose(np.abs((stream.values * TURN).sum(axis=1)), 1.0, atol=1e-12)


@pytest.mark.parametrize("counted", ["0123", "023", "013", "12"])
def test_rodrigues_parameters_of_mixed_counts_are_refused(tmp_path: Path, counted: str) -> None:
    head = ",".join(["time_s", *(f"sigma_BN_{k}" for k in counted)]) + "\n"
    rows = np.column_stack([TIME, np.column_stack([MRP, MRP[:, 0]])[:, : len(counted)]])
    with pytest.raises(InputError, match="no body rate"):
        read_dataset(text(tmp_path / "s.csv", head, rows.tolist()))


ELEMENTS = "time_s," + ",".join(f"R{r}{c}" for r in "123" for c in "123") + "\n"


def refusal_of(folder: Path, matrices: np.ndarray) -> str:
    path = text(folder / "m.csv", ELEMENTS, np.column_stack([TIME, matrices.reshape(-1, 9)]).tolist())
    with pytest.raises(InputError) as caught:
        read_dataset(path)
    return str(caught.value)


@pytest.mark.parametrize("decimals", [1, 2, 3])
def test_matrices_of_few_decimals_are_refused_with_the_deviation_and_the_decimals_needed(
    tmp_path: Path, decimals: int
) -> None:
    matrices = TILTED.round(decimals)
    away = np.abs(matrices @ matrices.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2))
    row = int(np.argmax(away > 1e-3))
    places = "1 decimal" if decimals == 1 else f"{decimals} decimals"
    assert refusal_of(tmp_path, matrices).endswith(
        f"m.csv: line {row + 2}: its matrix is no rotation, as R R' differs from 1 by {away[row]:.2g}, which rounding to "
        f"{places} explains; write at least 4 decimals, or delete the line"
    )


@pytest.mark.parametrize("decimals", [2, 6])
def test_a_matrix_with_a_wrong_element_is_refused_with_its_deviation(tmp_path: Path, decimals: int) -> None:
    matrices = TILTED.copy()
    matrices[0] = np.eye(3)
    matrices[0, 0, 1] = 0.3
    matrices = matrices.round(decimals)
    assert refusal_of(tmp_path, matrices).endswith(
        "line 2: its matrix is no rotation, as R R' differs from 1 by 0.3; correct or delete the line"
    )


@pytest.mark.parametrize("decimals", [2, 6])
def test_a_left_handed_matrix_is_called_a_reflection(tmp_path: Path, decimals: int) -> None:
    assert (
        "line 2: its matrix is a reflection (determinant -1), whose axes are left-handed; correct the signs"
        in (refusal_of(tmp_path, -TILTED.round(decimals)))
    )
