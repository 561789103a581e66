"""The dense model of a run on a shape of the user's."""

import json
import shutil
from contextlib import redirect_stdout
from dataclasses import dataclass
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pictures import unrendered_pictures
from scipy.spatial.transform import Rotation

from spinfilters.cli.main import main
from spinfilters.io.ply_files import write_ply
from spinfilters.lidar.mesh import TriangleMesh, box
from spinfilters.lidar.shape_alignment import facet_cloud, fitting_poses, surface_cloud
from spinfilters.run.comparison_run import RunOutput, compare_into
from spinfilters.run.run_folder import read_figure_data
from spinfilters.settings.run_settings import FILTER, Settings
from spinfilters.simulation.scenario import Scenario, simulate

CENTRE = np.array([0.012, -0.02, 0.03])
ESTIMATES_ALONE = Settings(estimators=("mekf",), verdict=FILTER)
TURN = Rotation.from_euler("xyz", [100, -40, 160], degrees=True).as_matrix()


def l_shape() -> TriangleMesh:
    """A box with a block on one face, which has no symmetry."""
    body, block = box((0.3, 0.2, 0.1)), box((0.05, 0.05, 0.12)).moved(np.eye(3), np.array([0.1, 0.06, 0.1]))
    triangles = np.vstack([body.triangles, block.triangles + len(body.vertices)])
    return TriangleMesh(np.vstack([body.vertices, block.vertices]), triangles)


def write_mesh(path: Path, mesh: TriangleMesh) -> Path:
    write_ply(path, dict(zip("xyz", mesh.vertices.T, strict=True)), (), mesh.triangles)
    return path


def finely(mesh: TriangleMesh, times: int) -> TriangleMesh:
    """Every triangle in four, so many times."""
    for _ in range(times):
        a, b, c = np.moveaxis(mesh.corners, 1, 0)
        ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
        parts = [np.stack(each, axis=1) for each in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))]
        corners = np.concatenate(parts)
        mesh = TriangleMesh(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3))
    return mesh


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of poses with the shape as its dense model: centre of mass and principal axes as it estimates them."""
    folder = tmp_path_factory.mktemp("runs") / "run"
    with unrendered_pictures():
        recording = simulate(Scenario.simplified(kind="pose", epochs=80, rate_rpm=(4.0, 9.0, 3.0)))
        compare_into(recording, ESTIMATES_ALONE, RunOutput(folder, with_figures=False))
    place = folder / "reconstruction"
    place.mkdir()
    # model = R'(shape - t): TURN is what the alignment should find
    model = finely(l_shape(), 3).moved(TURN.T, -TURN.T @ CENTRE)
    noisy = model.vertices + 5e-4 * np.random.default_rng(2).normal(size=model.vertices.shape)
    write_mesh(place / "model.ply", TriangleMesh(noisy, model.triangles))
    return folder


@dataclass(frozen=True)
class AlignedModel:
    """What the command prints, and the file that it writes."""

    printed: str
    told: dict[str, Any]


@pytest.fixture(scope="module")
def aligned(run: Path, tmp_path_factory: pytest.TempPathFactory) -> AlignedModel:
    """The model of the run on its shape in mm."""
    shape = write_mesh(tmp_path_factory.mktemp("shapes") / "body.ply", l_shape().scaled(1000.0))
    with redirect_stdout(StringIO()) as printed:
        assert main(["align", str(run), str(shape), "--scale", "0.001"]) == 0
    told = json.loads((run / "reconstruction" / "alignment.json").read_text())
    return AlignedModel(printed.getvalue(), told)


def test_a_model_is_put_on_its_shape_from_any_rotation(run: Path, aligned: AlignedModel) -> None:
    told = aligned.told
    assert "centre of mass in the axes of the shape: x 1" in aligned.printed
    assert (run / "reconstruction" / "alignment.png").stat().st_size > 1000
    assert Rotation.from_matrix(TURN.T @ np.array(told["rotation"])).magnitude() < np.deg2rad(0.2)
    np.testing.assert_allclose(told["center_of_mass_m"], CENTRE, atol=2e-4)
    assert not told["other_rotations"]
    assert told["notes"] == []
    body = read_figure_data(run).evaluations[0].body
    J = TURN @ np.diag(body.principal_moments) @ TURN.T
    np.testing.assert_allclose(told["inertia"], J, atol=0.005)
    # the principal axes of the run are the uncertain part: the alignment adds to them
    own = np.sqrt(np.diag(TURN @ body.principal_axes_cov @ TURN.T))
    assert (np.deg2rad(told["rotation_std_deg"]) >= 0.99 * own).all()


def test_the_place_of_frame_g_in_the_shape_is_stated(run: Path, aligned: AlignedModel) -> None:
    told = aligned.told
    body = read_figure_data(run).evaluations[0].body
    assert body.center_of_mass_g is not None
    R, t = (np.array(told["g_to_shape"][key]) for key in ("rotation", "translation_m"))
    np.testing.assert_allclose(R @ body.center_of_mass_g + t, told["center_of_mass_m"], atol=1e-12)


def test_rotations_that_fit_as_well_are_counted(tmp_path: Path) -> None:
    generator = np.random.default_rng(1)
    sides = box((0.3, 0.2, 0.1))
    model = facet_cloud(finely(sides, 4).moved(TURN.T, -TURN.T @ CENTRE))
    found = fitting_poses(model, surface_cloud(sides, 4000, generator))
    assert len(found) == 4  # the half turns about the axes of a box
    assert min(Rotation.from_matrix(TURN.T @ each.rotation).magnitude() for each in found) < np.deg2rad(0.5)


def test_a_model_of_one_side_is_refused_in_one_line(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    side = finely(TriangleMesh(np.array([[0.0, 0, 0], [0.3, 0, 0], [0, 0.3, 0]]), np.array([[0, 1, 2]])), 4)
    flat = tmp_path / "flat"
    shutil.copytree(run, flat)
    write_mesh(flat / "reconstruction" / "model.ply", side)
    assert main(["align", str(flat), str(write_mesh(tmp_path / "body.ply", box((0.3, 0.2, 0.1))))]) == 2
    complaint = capsys.readouterr().err
    assert "shows too little of the body" in complaint
    assert len(complaint.splitlines()) == 1


def test_what_cannot_be_aligned_is_refused_in_one_line(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    in_mm = write_mesh(tmp_path / "mm.ply", l_shape().scaled(1000.0))
    (tmp_path / "empty").mkdir()
    cases = (
        ([str(run), str(in_mm)], "; give --scale 0.001"),
        ([str(run), str(tmp_path / "none.stl")], "none.stl"),
        ([str(tmp_path / "empty"), str(in_mm)], "summary.json"),
    )
    for arguments, words in cases:
        assert main(["align", *arguments]) == 2
        complaint = capsys.readouterr().err
        assert words in complaint
        assert len(complaint.splitlines()) == 1
