"""Histories in files: what newer versions tell besides, and files that do not."""

from dataclasses import replace
from pathlib import Path
from zipfile import ZIP_DEFLATED

import numpy as np
import pytest

from spinfilters.core.errors import InputError
from spinfilters.filters.history import EstimateHistory, GrowingHistory
from spinfilters.models.body import MassSamples
from spinfilters.models.state_layout import ROTATION_BLOCKS, Gaussian, StateLayout
from spinfilters.models.state_mixture import ErrorMixture
from spinfilters.models.status import OWN_STATUS, EstimatorStatus, Finding, Holds, Verdict
from spinfilters.run.array_files import (
    FINDINGS,
    HOLDS,
    INITIALISATION,
    MASS_WEIGHTS,
    MIXTURE_WEIGHTS,
    OBSERVATIONS,
    read_arrays,
    read_history,
    write_arrays,
    write_history,
)

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


def test_samples_of_the_mass_distribution_survive_a_file_and_damaged_ones_are_refused(tmp_path: Path) -> None:
    path, random = tmp_path / "history.npz", np.random.default_rng(1)
    mass = MassSamples(random.normal(size=(7, 5)), np.full(7, 1 / 7), 0.4, 1.5)
    write_history(path, replace(filtered(), mass=mass))
    copy = read_history(path).mass
    assert copy is not None
    np.testing.assert_array_equal(copy.points, mass.points)
    np.testing.assert_array_equal(copy.weights, mass.weights)
    assert (copy.gaussian_shape, copy.gaussian_nees) == (0.4, 1.5)
    write_arrays(path, {**read_arrays(path), MASS_WEIGHTS: np.ones(6)})
    with pytest.raises(InputError, match="samples of the mass distribution"):
        read_history(path)


def test_explanations_of_the_last_errors_survive_a_file_and_damaged_ones_are_refused(tmp_path: Path) -> None:
    path, size = tmp_path / "history.npz", filtered().layout.error_dim
    mixture = ErrorMixture(
        np.array([0.9, 0.1]), np.array([1.0, 3.0])[:, np.newaxis, np.newaxis] * np.eye(size)
    )
    write_history(path, replace(filtered(), mixture=mixture))
    copy = read_history(path).mixture
    assert copy is not None
    np.testing.assert_array_equal(copy.weights, mixture.weights)
    np.testing.assert_array_equal(copy.factors, mixture.factors)
    write_arrays(path, {**read_arrays(path), MIXTURE_WEIGHTS: np.ones(3)})
    with pytest.raises(InputError, match="mixture of errors"):
        read_history(path)


def test_findings_and_what_holds_survive_a_file(tmp_path: Path) -> None:
    found = Finding(
        "gap", "nothing was measured", "cut it", {"seconds": 3.0, "other": "a word"}, frozenset({"rate"})
    )
    status = EstimatorStatus(Verdict.DEGRADED, (found,), {"rate": Holds.DOUBTFUL, "moments": Holds.OK})
    write_history(tmp_path / "history.npz", replace(filtered(), status=status))
    copy = read_history(tmp_path / "history.npz").status
    assert copy.verdict is Verdict.DEGRADED
    assert copy.reasons == status.reasons
    assert dict(copy.holds) == dict(status.holds)
    (again,) = copy.findings
    assert (again.check, dict(again.numbers), again.about) == (
        "gap",
        {"seconds": 3.0, "other": "a word"},
        frozenset({"rate"}),
    )
    assert (again.sentence, again.cure) == ("nothing was measured", "cut it")


def test_reasons_of_an_older_version_have_no_check_of_their_own(tmp_path: Path) -> None:
    old = {FINDINGS: None, HOLDS: None, "reasons": np.array(["something"])}
    copy = read_history(changed(tmp_path / "history.npz", **old)).status
    assert [(each.check, each.reason) for each in copy.findings] == [(OWN_STATUS, "something")]
    assert dict(copy.holds) == {}


def test_a_file_of_an_older_version_is_read_and_its_initialisation_took_no_time(tmp_path: Path) -> None:
    old = {INITIALISATION: None, OBSERVATIONS: None}
    copy = read_history(changed(tmp_path / "history.npz", **old))
    assert (copy.initialisation, copy.observations) == (2, None)
    smoothed = read_history(changed(tmp_path / "history.npz", **old, dof=np.zeros(EPOCHS, dtype=int)))
    assert smoothed.initialisation == 0


@pytest.mark.parametrize(
    "wrong",
    [
        {FINDINGS: np.array(["["]), "reasons": np.array(["a"])},
        {FINDINGS: np.array(["[]"]), "reasons": np.array(["a"])},
        {FINDINGS: np.array(["[" * 100_000]), "reasons": np.array(["a"])},
        {FINDINGS: np.array(['{"check": "gap", "numbers": [1], "about": null}']), "reasons": np.array(["a"])},
        {FINDINGS: np.array([]), "reasons": np.array(["a"])},
        {HOLDS: np.array(["rate=fine"])},
        {HOLDS: np.array(["rate"])},
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
