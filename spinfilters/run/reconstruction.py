"""Dense model of a run's body with dimensions and animation.

Depth of every pair, fused by the estimated motion.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from jaxtyping import Float

from spinfilters.core.attitude_conversions import matrix_from_quaternion
from spinfilters.core.camera_trajectory import CameraTrajectory, in_camera
from spinfilters.core.errors import InputError
from spinfilters.evaluation.estimator_evaluation import Evaluation
from spinfilters.io.dataset_reader import has_images
from spinfilters.io.input_file import path_text
from spinfilters.io.output_files import make_folder, write_bytes, write_json
from spinfilters.io.ply_files import write_ply
from spinfilters.models.status import CENTRE, POSITION, Holds
from spinfilters.plots.figures import FigureData
from spinfilters.run.run_folder import (
    ALIGNMENT_FILE,
    ALIGNMENT_PICTURE,
    ANIMATION_FILE,
    MODEL_FILE,
    RECONSTRUCTION_FILE,
    RECONSTRUCTION_FOLDER,
    read_figure_data,
)
from spinfilters.run.run_summary import read_summary
from spinfilters.vision.body_model import BodyModel, DistanceVolume, Grid, body_model
from spinfilters.vision.depth_map import depth_map
from spinfilters.vision.image_folder import LossCount, PairReader, read_pairs, stamped_pairs
from spinfilters.vision.rectification import Rectification, read_raw_rig
from spinfilters.vision.visible_surface import MOST_FRAMES, animation, beside, reprojection

Progress = Callable[[str, int, int], None]
VOXELS: Final = 128
"""Along each axis of the volume, unless stated."""
FEWEST_LANDMARKS: Final = 20
MARGIN: Final = 1.1
"""Of the ball in which the body is looked for, over the distance that 99 % of its landmarks have."""
LEAST_NEAR, NEAR_VOXELS = 0.6, 1.0
"""Share of the landmarks that must lie within so many voxels of the surface: it is that of other images otherwise."""
STAGE: Final = "depth maps"
SAME_TIME_S: Final = 1e-6


@dataclass(frozen=True)
class Reconstruction:
    """Files and numbers of a run's dense model.

    Attributes
    ----------
    model : BodyModel
        Of the body.
    losses : LossCount
        Of pairs.
    document : dict[str, Any]
        What reconstruction.json holds.
    """

    model: BodyModel
    losses: LossCount
    document: dict[str, Any]


@dataclass(frozen=True, eq=False)
class PrincipalAxesMotion:
    """Poses of the principal axes in the rectified left camera.

    ``time`` (n,) s, ``rotation`` (n, 3, 3), ``position`` (n, 3) m.
    ``radius`` (m) is that of a ball around the centre of mass that holds the body; ``name`` of the estimator; ``axes_cov`` (3, 3)
    rad^2 of the axes; ``landmarks`` (k, 3) m, principal axes.
    """

    name: str
    time: Float[np.ndarray, " n"]
    rotation: Float[np.ndarray, "n 3 3"]
    position: Float[np.ndarray, "n 3"]
    radius: float
    axes_cov: Float[np.ndarray, "3 3"]
    landmarks: Float[np.ndarray, "k 3"]

    def row(self, time: float) -> int | None:
        """Epoch of a time, s; None where there is none, or it is not finite."""
        row = int(np.argmin(np.abs(self.time - time)))
        finite = np.isfinite(self.rotation[row]).all() and np.isfinite(self.position[row]).all()
        return row if finite and abs(self.time[row] - time) < SAME_TIME_S else None


def reconstruct(
    folder: Path, images: Path | None, voxels: int = VOXELS, progress: Progress = lambda *_: None
) -> Reconstruction:
    """Write the dense model of a run folder: PLY, dimensions and animation.

    Parameters
    ----------
    images : Path or None
        Folder of the images, None for the one that the run names.
    progress : Progress
        Called with stage, how much and of how much.

    Raises
    ------
    InputError
        No run, no images, no estimator with a map, images of other times than the run's, no surface.
    """
    figure_data = read_figure_data(folder)
    source = images_of(folder, images)
    motion = body_motion(folder, figure_data)
    sequence = _Images(source, motion)
    volume = _fused(sequence, motion, DistanceVolume(Grid(motion.radius, voxels)), progress)
    if not volume.count:
        raise InputError(
            f"{path_text(source)}: no pair has the time of an epoch of {path_text(folder)} and depth where the body is; "
            f"{_cure(figure_data)}"
        )
    model = body_model(volume, motion.axes_cov, motion.landmarks)
    near = model.share_near(motion.landmarks, NEAR_VOXELS * volume.grid.voxel)
    if near < LEAST_NEAR:
        raise InputError(
            f"{path_text(source)}: the surface has {100 * near:.0f} % of the landmarks of {path_text(folder)} on it; "
            f"{_cure(figure_data)}"
        )
    document = _document(model, motion, volume, sequence.losses)
    moving = _animated(model, motion, source, progress)
    place = folder / RECONSTRUCTION_FOLDER
    make_folder(place)
    for name in (ALIGNMENT_FILE, ALIGNMENT_PICTURE):  # of the model that is replaced
        (place / name).unlink(missing_ok=True)
    _write_model(place / MODEL_FILE, model)
    write_bytes(place / ANIMATION_FILE, moving)
    write_json(place / RECONSTRUCTION_FILE, document)
    return Reconstruction(model, sequence.losses, document)


def _cure(figure_data: FigureData) -> str:
    """What to do where images and the motion of a run do not belong together, or that motion does not hold."""
    cure = "give the images that the run was made of with --images"
    estimate = figure_data.most_exact
    holds = {} if estimate is None else estimate.history.status.holds
    wrong = [name for name in (POSITION, CENTRE) if holds.get(name, Holds.OK) is not Holds.OK]
    if not wrong:
        return cure
    words = " and ".join(name.replace("_", " ") for name in wrong)
    words += " of that run do not hold" if wrong[1:] else " of that run does not hold"
    return f"{cure}. Or give fewer --voxels, or record a longer motion: {words}"


def _fused(
    sequence: "_Images", motion: PrincipalAxesMotion, volume: DistanceVolume, progress: Progress
) -> DistanceVolume:
    """The volume with the depth of every pair; those without any are counted as lost."""
    stereo = sequence.rectification.stereo
    for row, pair in sequence.pairs(lambda *at: progress("depth", *at)):
        seen = depth_map(*pair, stereo, (motion.position[row], motion.radius))
        if seen is None or not seen.count:
            sequence.losses.lose(STAGE, "without depth where the body is")
            continue
        sequence.losses.keep(STAGE)
        volume.add(seen, stereo, motion.rotation[row], motion.position[row])
    return volume


def images_of(folder: Path, images: Path | None) -> Path:
    """Folder of a run's images. InputError: none is known, or it has no images."""
    told = read_summary(folder)["dataset"].get("images") if images is None else None
    if images is None and not isinstance(told, str):
        raise InputError(f"{path_text(folder)}: does not name its images; give their folder with --images")
    source = Path(str(told)) if images is None else images
    if not has_images(source):
        raise InputError(
            f"{path_text(source)}: has no stereo images; give the folder with cam0/data and cam1/data with --images"
        )
    return source


def body_motion(folder: Path, figure_data: FigureData) -> PrincipalAxesMotion:
    """Motion of the most exact estimator, and the map's size.

    Raises
    ------
    InputError
        No estimator has a motion, no map, too few landmarks.
    """
    evaluation, points = figure_data.most_exact, figure_data.map_points
    if evaluation is None or points is None or evaluation.body.center_of_mass_g is None:
        raise InputError(
            f"{path_text(folder)}: has no estimator with a motion and a map of landmarks; compare stereo images first"
        )
    if len(points) < FEWEST_LANDMARKS:
        raise InputError(
            f"{path_text(folder)}: its map has {len(points)} landmarks, at least {FEWEST_LANDMARKS} are needed"
        )
    return _motion(evaluation, points, CameraTrajectory.of(figure_data.dataset.inspector))


def _motion(
    evaluation: Evaluation, points: Float[np.ndarray, "k 3"], inspector: CameraTrajectory | None
) -> PrincipalAxesMotion:
    body, trajectory = evaluation.body, evaluation.trajectory
    poses = np.concatenate([trajectory.position, trajectory.q_ig], axis=1)
    if inspector is not None:
        poses = in_camera(poses, inspector.at(trajectory.time))
    landmarks = (points - body.center_of_mass_g) @ body.principal_axes_g.T
    distance = np.linalg.norm(landmarks, axis=1)
    rotation = matrix_from_quaternion(poses[:, 3:]) @ body.principal_axes_g.T
    radius = MARGIN * float(np.quantile(distance, 0.99))
    cov = body.principal_axes_cov
    return PrincipalAxesMotion(
        evaluation.name, trajectory.time, rotation, poses[:, :3], radius, cov, landmarks
    )


class _Images:
    """Rectified pairs of a folder at the epochs of a motion."""

    def __init__(self, source: Path, motion: PrincipalAxesMotion) -> None:
        self.rectification, self.losses, self._motion = (
            Rectification(read_raw_rig(source)),
            LossCount(),
            motion,
        )
        self._stamped = stamped_pairs(source, self.losses)

    def pairs(
        self, progress: Callable[[int, int], None]
    ) -> Iterator[tuple[int, tuple[np.ndarray, np.ndarray]]]:
        """Epoch and rectified pair, in order of time; the rest is counted as lost."""
        reader = PairReader(self.rectification.rig.size, self.losses)
        for number, pair in enumerate(read_pairs(self._stamped, reader), start=1):
            row = None if pair is None else self._motion.row(pair.time)
            if pair is not None and row is not None:
                yield row, self.rectification.images(pair.left, pair.right)
            elif pair is not None:
                self.losses.lose(STAGE, "of no epoch of the run")
            progress(number, len(self._stamped))


def _animated(model: BodyModel, motion: PrincipalAxesMotion, source: Path, progress: Progress) -> bytes:
    """Left images next to the model as the estimate places it, evenly over the run."""
    sequence, pictures = _Images(source, motion), []
    step = -(-len(motion.time) // MOST_FRAMES)
    rig = sequence.rectification.stereo
    for row, (left, _) in sequence.pairs(lambda *at: progress("animation", *at)):
        if row % step == 0:
            pictures.append(
                beside(left, reprojection(model, rig, motion.rotation[row], motion.position[row]))
            )
    return animation(pictures)


def _document(
    model: BodyModel, motion: PrincipalAxesMotion, volume: DistanceVolume, losses: LossCount
) -> dict[str, Any]:
    return {
        "schema": 1,
        "estimator": motion.name,
        "epochs": volume.count,
        "voxel_m": volume.grid.voxel,
        "vertices": len(model.vertices),
        "triangles": len(model.triangles),
        "dimensions_m": model.dimensions.extents.tolist(),
        "dimensions_std_m": model.dimensions.std.tolist(),
        "surface_std_m": model.dimensions.surface_std.tolist(),
        "axes_std_deg": np.degrees(model.dimensions.rotation_std).tolist(),
        "notes": model.dimensions.sentences,
        "losses": losses.document,
    }


def _write_model(path: Path, model: BodyModel) -> None:
    grey = np.clip(np.rint(model.grey), 0, 255).astype(np.uint8)
    columns = dict(zip("xyz", model.vertices.T.astype(float), strict=True))
    comments = (
        "body in principal axes, moments ascending along x, y, z; origin at the centre of mass, m",
        f"extents {' '.join(f'{size:.5f}' for size in model.dimensions.extents)} m",
    )
    write_ply(path, columns | dict.fromkeys(("red", "green", "blue"), grey), comments, model.triangles)
