"""Tracks, map and model of rendered images against the truth.

Dense model of a run against the body that was rendered.
    spinfilters simulate --kind stereo-images --shape box --seed 1 --rate-rpm 4 9 3 -o images
    spinfilters compare images -o runs/images && spinfilters reconstruct runs/images
    python -m experiments.map_accuracy runs/images --shape box

Only for convex bodies (`--shape` spheres, box or octahedron): the distance of a point to the surface is that to the farthest plane.
Map and model are laid onto the body by the six numbers of a rigid motion, so that these are errors of shape.
"""

import argparse
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from jaxtyping import Float

from experiments.command_line import run_study
from spinfilters.core.attitude_conversions import matrix_from_quaternion, matrix_from_rotation_vector
from spinfilters.core.cameras import stereo_pair
from spinfilters.core.errors import InputError
from spinfilters.io.camera import StereoRig
from spinfilters.io.dataset import Dataset
from spinfilters.io.ply_files import read_ply
from spinfilters.io.truth import Truth
from spinfilters.lidar.mesh import TriangleMesh
from spinfilters.plots.figures import FigureData
from spinfilters.run.run_folder import (
    MODEL_FILE,
    RECONSTRUCTION_FILE,
    RECONSTRUCTION_FOLDER,
    read_figure_data,
)
from spinfilters.simulation.body_view import POLYHEDRA, named_mesh
from spinfilters.vision.stereo_geometry import pixels_of

WRONG_PX: Final = 3.0
"""Error of an observation, largest of its three pixels, beyond which it is of another point."""
LOSS_M: Final = 1e-3
"""Scale of the loss (Geman and McClure's weight) with which points are laid onto the body."""
ITERATIONS: Final = 15


@dataclass(frozen=True)
class MapAccuracy:
    """Errors of a run, in metres where not said otherwise.

    Attributes
    ----------
    wrong_observations, wrong_tracks: shares with an error beyond `WRONG_PX`, and of tracks with such an observation.
    map_distance, model_distance: signed distances of landmarks, and of the model's vertices, to the surface.
    dimensions: (3,) errors of the extents along the principal axes.   along_estimated: of those along the axes as estimated.
    dimensions_std, surface_std: (3,) what the run states of both.
    """

    wrong_observations: float
    wrong_tracks: float
    map_distance: Float[np.ndarray, " k"]
    model_distance: Float[np.ndarray, " v"]
    dimensions: Float[np.ndarray, " 3"]
    along_estimated: Float[np.ndarray, " 3"]
    dimensions_std: Float[np.ndarray, " 3"]
    surface_std: Float[np.ndarray, " 3"]


def main() -> None:
    """Run the study."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("run", type=Path)
    parser.add_argument("--shape", choices=sorted(POLYHEDRA), default="spheres")
    parser.add_argument("--radius", type=float, default=0.11)
    options = parser.parse_args()
    found = map_accuracy(options.run, named_mesh(options.shape, options.radius))
    print(f"observations beyond {WRONG_PX:g} px: {100 * found.wrong_observations:.3f} %")
    print(f"tracks with one of them: {100 * found.wrong_tracks:.2f} %")
    for name, distance in (("map", found.map_distance), ("model", found.model_distance)):
        millimetres = 1e3 * distance
        print(
            f"{name}: {len(distance)} points, distance to the surface median {np.median(np.abs(millimetres)):.3f} mm, "
            f"95 % within {np.quantile(np.abs(millimetres), 0.95):.2f} mm"
        )
    for words, errors, std in (
        ("along the true principal axes", found.dimensions, found.dimensions_std),
        ("along those estimated", found.along_estimated, found.surface_std),
    ):
        print(
            f"extents {words}: errors {np.round(1e3 * errors, 2)} mm (stated {np.round(1e3 * std, 2)}), "
            f"mean {1e3 * np.abs(errors).mean():.2f} mm"
        )


def map_accuracy(run: Path, mesh: TriangleMesh) -> MapAccuracy:
    """Accuracy of a run folder with a dense model.

    InputError: a run without truth, map, stereo camera or model.
    """
    data = read_figure_data(run)
    body, truth = _body_in_truth(data, run), data.dataset.truth
    assert truth is not None  # looked at with the body
    place = run / RECONSTRUCTION_FOLDER
    model, told = read_ply(place / MODEL_FILE).points, json.loads((place / RECONSTRUCTION_FILE).read_text())
    wrong, tracks = _wrong(data.dataset, truth)
    axes, corners = np.asarray(truth.principal_axes_g), mesh.vertices - body.centre
    sizes = np.array(told["dimensions_m"])
    return MapAccuracy(
        wrong,
        tracks,
        surface_distance(laid_onto(body.landmarks, mesh), mesh),
        surface_distance(laid_onto(model @ body.axes + body.centre, mesh), mesh),
        sizes - np.ptp(corners @ axes.T, axis=0),
        sizes - np.ptp(corners @ body.axes.T, axis=0),
        np.array(told["dimensions_std_m"]),
        np.array(told["surface_std_m"]),
    )


def landmarks_on(run: Path, mesh: TriangleMesh) -> Float[np.ndarray, "k 3"]:
    """Map of a run folder laid onto the true body, m. InputError: as `map_accuracy`."""
    return laid_onto(_body_in_truth(read_figure_data(run), run).landmarks, mesh)


@dataclass(frozen=True)
class _EstimatedBody:
    """Estimate of the body in the truth's frame g.

    ``landmarks`` (k, 3) m, principal ``axes`` as rows, and the true ``centre`` of mass.
    """

    landmarks: Float[np.ndarray, "k 3"]
    axes: Float[np.ndarray, "3 3"]
    centre: Float[np.ndarray, " 3"]


def _body_in_truth(data: FigureData, run: Path) -> _EstimatedBody:
    """The body as estimated, by the attitude of the first epoch. InputError: no truth, no map."""
    truth, evaluation, points = data.dataset.truth, data.most_exact, data.map_points
    if truth is None or truth.center_of_mass_g is None or truth.principal_axes_g is None:
        raise InputError(f"{run}: has no truth of the body; render images with 'spinfilters simulate'")
    if evaluation is None or evaluation.body.center_of_mass_g is None or points is None:
        raise InputError(f"{run}: has no estimator with a map; compare stereo images first")
    body, first = evaluation.body, evaluation.trajectory
    R = matrix_from_quaternion(truth.q_ig[_rows(truth, first.time[:1])[0]]).T @ matrix_from_quaternion(
        first.q_ig[0]
    )
    centre = np.asarray(truth.center_of_mass_g)
    return _EstimatedBody(
        (points - evaluation.body.center_of_mass_g) @ R.T + centre, body.principal_axes_g @ R.T, centre
    )


def _wrong(dataset: Dataset, truth: Truth) -> tuple[float, float]:
    """Shares of wrong observations and of tracks with one.

    Against the median place of each track under the true motion.
    """
    (stream,), rig = dataset.log.streams, dataset.rig
    assert isinstance(rig, StereoRig)
    assert stream.ids is not None  # a stream of landmarks always has them
    rows, rotations = _rows(truth, stream.time), matrix_from_quaternion(truth.q_ig)
    origins = truth.center_of_mass - rotations @ np.asarray(truth.center_of_mass_g)
    camera = stereo_pair(rig.calibration).points_of(stream.values, rig.calibration)
    at = np.einsum("nji,nj->ni", rotations[rows], camera - origins[rows])
    _, track, counts = np.unique(stream.ids, return_inverse=True, return_counts=True)
    order = np.argsort(track, kind="stable")
    places = np.array([np.median(part, axis=0) for part in np.split(at[order], np.cumsum(counts)[:-1])])
    expected = pixels_of(np.einsum("nij,nj->ni", rotations[rows], places[track]) + origins[rows], rig)
    wrong = np.abs(expected - stream.values).max(axis=1) > WRONG_PX
    return float(wrong.mean()), len(np.unique(track[wrong])) / len(counts)


def _rows(truth: Truth, time: Float[np.ndarray, " n"]) -> np.ndarray:
    """Epochs of the truth at these times."""
    return np.searchsorted(truth.time, time - 1e-6)


def surface_distance(points: Float[np.ndarray, "k 3"], mesh: TriangleMesh) -> Float[np.ndarray, " k"]:
    """Signed distance to a convex body's planes, positive outside."""
    normals, offsets = _planes(mesh)
    return (points @ normals.T - offsets).max(axis=1)


def laid_onto(points: Float[np.ndarray, "k 3"], mesh: TriangleMesh) -> Float[np.ndarray, "k 3"]:
    """Points moved rigidly onto the surface of a convex body, by robust least squares."""
    normals, offsets = _planes(mesh)
    for _ in range(ITERATIONS):
        every = points @ normals.T - offsets
        nearest = every.argmax(axis=1)
        distance, normal = every[np.arange(len(points)), nearest], normals[nearest]
        weight = 1 / (1 + (distance / LOSS_M) ** 2) ** 2
        J = np.hstack([np.cross(points, normal), normal])
        step = np.linalg.lstsq(J.T @ (weight[:, None] * J), -J.T @ (weight * distance), rcond=None)[0]
        points = points @ matrix_from_rotation_vector(step[:3]).T + step[3:]
    return points


def _planes(mesh: TriangleMesh) -> tuple[Float[np.ndarray, "f 3"], Float[np.ndarray, " f"]]:
    """Outward unit normals of the faces, and their distances from the origin."""
    return mesh.normals, np.einsum("fi,fi->f", mesh.normals, mesh.corners[:, 0])


if __name__ == "__main__":
    run_study(main)
