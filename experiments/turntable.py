"""The dinosaur on a turntable: rotation per image of real tracks, from one camera.

    python -m experiments.turntable DATA/vgg_dinosaur_turntable

The map is triangulated with the cameras of the data set (dino_Ps.mat), so it is not independent of them. The poses, of a body
before a camera at rest, come from all tracks of its landmarks, gross errors among them. Prints the angle between images, how far
its axis strays, and the verdict.
"""

import argparse
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float
from scipy.io import loadmat

from experiments.command_line import run_study
from spinfilters.core.attitude_conversions import inverse, multiply, rotation_vector_from_quaternion
from spinfilters.evaluation.estimator_evaluation import Evaluation
from spinfilters.io.camera import PinholeCamera
from spinfilters.io.dataset import Dataset
from spinfilters.io.measurement_log import MeasurementLog, MeasurementStream
from spinfilters.io.sensor_tables import KnownMap
from spinfilters.run.comparison_run import compare_dataset
from spinfilters.settings.run_settings import ProcessSettings, Settings

SIZE_PX = (720, 576)
INTERVAL_S = 1.0
FEWEST_VIEWS = 3
LARGEST_ERROR_PX = 2.0
"""Of the reprojection in a view that tells a landmark's place."""


@dataclass(frozen=True)
class Turntable:
    """Rotation of the body between images.

    Attributes
    ----------
    angles: (n,) rad.   axes: (n, 3) unit vectors, frame i.   evaluation: of the estimator.
    """

    angles: Float[np.ndarray, " n"]
    axes: Float[np.ndarray, "n 3"]
    evaluation: Evaluation

    @property
    def axis_spread(self) -> float:
        """Root mean square angle of the axes to their mean, rad."""
        mean = self.axes.mean(axis=0)
        across = np.linalg.norm(np.cross(self.axes, mean / np.linalg.norm(mean)), axis=1)
        return float(np.sqrt(np.mean(across**2)))


def main() -> None:
    """Run the study."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("data", type=Path)
    parser.add_argument("--estimator", default="smoother")
    options = parser.parse_args()
    dataset = turntable_dataset(options.data)
    (stream,) = dataset.log.streams
    found = turntable(dataset, options.estimator)
    degrees, history = np.rad2deg(found.angles), found.evaluation.history
    error = degrees.std(ddof=1) / np.sqrt(len(degrees))
    landmarks = 0 if dataset.known_map is None else len(dataset.known_map.ids)
    print(f"{len(stream)} observations of {landmarks} landmarks in {len(history.time)} images")
    print(
        f"{degrees.mean():.3f} +- {error:.3f} deg per image (standard deviation of one {degrees.std(ddof=1):.3f}), "
        f"axes within {np.rad2deg(found.axis_spread):.3f} deg (rms) of one"
    )
    print(f"{history.name} is {history.status.verdict}: {'; '.join(history.status.reasons) or '-'}")


def turntable(dataset: Dataset, estimator: str) -> Turntable:
    """Rotations between the images by an estimator. Errors: `compare_dataset`."""
    settings = Settings(
        estimators=(estimator,), process=ProcessSettings(gravity=False)
    )  # it is held, and does not fall
    comparison = compare_dataset(dataset, settings)
    evaluation = comparison.evaluations[0]
    q_ig = evaluation.trajectory.q_ig
    turns = rotation_vector_from_quaternion(multiply(q_ig[1:], inverse(q_ig[:-1])))
    angles = np.linalg.norm(turns, axis=1)
    return Turntable(angles, turns / angles[:, None], evaluation)


def turntable_dataset(folder: Path) -> Dataset:
    """Tracks of one camera with the map, one image a second."""
    cameras = _cameras(folder)
    tracks = np.loadtxt(folder / "viff.xy").reshape(-1, len(cameras), 2)
    seen = tracks.min(axis=2) >= 0
    K = _calibration(cameras[0])
    points = np.array([_landmark(cameras, *each) for each in zip(tracks, seen, strict=True)])
    known = np.flatnonzero(np.isfinite(points).all(axis=1))
    image, landmark = np.nonzero(seen[known].T)
    values = tracks[known][landmark, image]
    # pixels are not at right angles (skew): columns move with rows until they are
    values[:, 0] -= K[0, 1] / K[1, 1] * (values[:, 1] - K[1, 2])
    stream = MeasurementStream("monocular", INTERVAL_S * image, values, landmark)
    return Dataset(
        kind="mono-tracks",
        log=MeasurementLog((stream,)),
        path=folder,
        description="dinosaur on a turntable",
        rig=PinholeCamera(K[0, 0], K[1, 1], K[0, 2], K[1, 2], *SIZE_PX),
        known_map=KnownMap(np.arange(len(known)), points[known]),
    )


def _cameras(folder: Path) -> Float[np.ndarray, "c 3 4"]:
    return np.stack([np.asarray(each, dtype=float) for each in loadmat(folder / "dino_Ps.mat")["P"][0]])


def _calibration(camera: Float[np.ndarray, "3 4"]) -> Float[np.ndarray, "3 3"]:
    """Camera matrix K of K [R | t], with a positive diagonal."""
    R = np.linalg.qr(np.linalg.inv(camera[:, :3]))[1]
    K = np.linalg.inv(R)
    K = K @ np.diag(np.sign(np.diag(K)))
    return K / K[2, 2]


def _landmark(
    cameras: Float[np.ndarray, "c 3 4"], pixels: Float[np.ndarray, "c 2"], seen: Bool[np.ndarray, " c"]
) -> Float[np.ndarray, " 3"]:
    """Place of a track by linear triangulation of consistent views.

    Without the views that disagree; NaN where too few are left.
    """
    views = np.flatnonzero(seen)
    while len(views) >= FEWEST_VIEWS:
        P, u = cameras[views], pixels[views]
        rows = u[:, :, None] * P[:, None, 2] - P[:, :2]
        rows = rows / np.linalg.norm(rows, axis=2, keepdims=True)
        homogeneous = np.linalg.svd(rows.reshape(-1, 4))[2][-1]
        at = P @ homogeneous
        error = np.linalg.norm(at[:, :2] / at[:, 2:] - u, axis=1)
        if error.max() <= LARGEST_ERROR_PX:
            return homogeneous[:3] / homogeneous[3]
        views = np.delete(views, error.argmax())
    return np.full(3, np.nan)


if __name__ == "__main__":
    run_study(main)
