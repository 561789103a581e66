"""Histories in files: what newer versions tell besides, and files that do not."""

from dataclasses import replace
from pathlib import Path
from zipfile import ZIP_DEFLATED

import numpy as np
import pytest

from spinfilters.errors import InputError
from spinfilters.estimators.history import EstimateHistory, GrowingHistory
from spinfilters.runs.history_file import INITIALISATION, OBSERVATIONS, read_history, write_history
from spinfilters.runs.npz_file import read_arrays, write_arrays
from spinfilters.state.gaussian import Gaussian
from spinfilters.state.layout import ROTATION_BLOCKS, StateLayout
from spinfilters.state.status import EstimatorStatus

LAYOUT, EPOCHS = StateLayout(ROTATION_BLOCKS), 5


def filtered() -> EstimateHistory:
    """Five epochs of a filter, the first two of which are its initialisation."""
    rows = GrowingHistory(LAYOUT, 0.0)
    belief = Gaussian(LAYOUT, LAYOUT.origin(), np.eye(LAYOUT.error_dim))
    for epoch in range(EPOCHS):
        rows.append(float(epoch), belief, [], 0.0 if epoch < 2 else 1e-3)
    history = rows.ended("mekf", EstimatorStatus())
    dof = np.array([0, 0, 3, 3, 3])
    return replace(history, dof=dof, initialisation=2, observations=np.full(EPOCHS, 1))


def changed(path: Path, **arrays: np.ndarray | None) -> Path:
    """The file of `filtered` with other arrays, or without those that are None."""
    write_history(path, filtered())
    kept = {**read_arrays(path), **arrays}
    write_arrays(path, {name: array for name, array in kept.items() if array is not None}, ZIP_DEFLATED)
    return path


def test_the_initialisation_and_the_observations_survive_a_file(tmp_path: Path) -> None:
    write_history(tmp_path / "history.npz", filtered())
    copy = read_history(tmp_path / "history.npz")
    assert copy.initialisation == 2
    assert copy.initialisation_end == 1.0
    assert copy.observations is not None
    np.testing.assert_array_equal(copy.observations, np.ones(EPOCHS))


def test_a_file_of_an_older_version_is_read_and_its_initialisation_took_no_time(tmp_path: Path) -> None:
    old = {INITIALISATION: None, OBSERVATIONS: None}
    copy = read_history(changed(tmp_path / "history.npz", **old))
    assert (copy.initialisation, copy.observations) == (2, None)
    smoothed = read_history(changed(tmp_path / "history.npz", **old, dof=np.zeros(EPOCHS, dtype=int)))
    assert smoothed.initialisation == 0


@pytest.mark.parametrize(
    "wrong",
    [
        {INITIALISATION: np.array(EPOCHS + 1)},
        {INITIALISATION: np.array(-1)},
        {INITIALISATION: np.array(1.5)},
        {INITIALISATION: np.array([1, 2])},
        {OBSERVATIONS: np.ones(EPOCHS + 1, dtype=int)},
        {OBSERVATIONS: np.ones(EPOCHS)},
    ],
    ids=str,
)
def test_numbers_that_do_not_fit_are_refused_in_one_line(tmp_path: Path, wrong: dict) -> None:
    with pytest.raises(InputError, match=r"history\.npz: is no history of a run"):
        read_history(changed(tmp_path / "history.npz", **wrong))
