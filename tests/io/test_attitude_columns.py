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
HEAD = "time_s,px,py,pz,r11,r12,r13,r21,r22,r23,r31,r32,r33,wx,wy,wz\n"


def test_a_matrix_of_four_decimals_is_read_beside_rates(tmp_path: Path) -> None:
    matrices = Rotation.from_quat(TURN).as_matrix().round(4)
    rows = np.column_stack([TIME, PLACE, matrices.reshape(-1, 9), SPUN])
    dataset = read_dataset(text(tmp_path / "track.csv", HEAD, rows.tolist()))
    assert dataset.kind == "pose"
    np.testing.assert_allclose(dataset.log.streams[0].values[:, 3:], TURN, atol=1e-4)


def test_rodrigues_parameters_of_almost_a_whole_turn_are_refused_with_file_and_line(tmp_path: Path) -> None:
    s = TURN[:, :3] / (1.0 + TURN[:, 3:])
    s[3, 1] = 1e200
    path = text(tmp_path / "s.csv", "time_s,sigma_BN_0,sigma_BN_1,sigma_BN_2\n", np.column_stack([TIME, s]))
    with pytest.raises(InputError, match=r"s\.csv: line 5: .*1e\+200; correct or delete the line"):
        read_dataset(path)
