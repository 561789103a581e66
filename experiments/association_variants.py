"""Association of rendered images in other ways.

RANSAC of OpenCV beside the house's own, and poses predicted in other ways.
    python -m experiments.association_variants FOLDER --step 1

FOLDER holds rendered images with truth (`spinfilters simulate --kind stereo-images`). Poses between an image and the one `--step`
later are fitted to SIFT matches by `spinfilters.models.tracks.track_poses` and by `cv2.solvePnPRansac`. Then all images (every
step-th) are tracked with the pose of the next epoch predicted by nothing, by a constant rate, and by the true motion: no prediction
by estimated dynamics can be better than the last.
"""

import argparse
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Final
from unittest import mock

import cv2
import numpy as np
from jaxtyping import Float

from experiments.command_line import run_study
from spinfilters.core.attitude_conversions import (
    angle_from_matrix,
    matrix_from_quaternion,
    quaternion_from_matrix,
)
from spinfilters.core.cameras import stereo_pair
from spinfilters.io.camera import StereoRig
from spinfilters.io.truth import Truth, read_truth
from spinfilters.models.tracks.pose_consensus import Matches
from spinfilters.models.tracks.track_poses import fit_pose
from spinfilters.vision import association
from spinfilters.vision.association import Association, TimedPose, Tracker, constant_rate
from spinfilters.vision.front_end import FrontEndOptions
from spinfilters.vision.image_folder import LossCount
from spinfilters.vision.stereo_geometry import pixels_by_point
from spinfilters.vision.stereo_matching import StereoFeatures, clear_pairs
from spinfilters.vision.track_images import stereo_points
from spinfilters.vision.track_noise import TrackNoise

RIGHT_DEG: Final = 2.0
"""Error of a relative attitude below which RANSAC has found the motion."""
OPENCV: Final = {
    "cv2.RANSAC": cv2.SOLVEPNP_ITERATIVE,
    "cv2.USAC_ACCURATE": cv2.USAC_ACCURATE,
    "cv2.USAC_MAGSAC": cv2.USAC_MAGSAC,
}
REPROJECTION_PX: Final = 3.0
Points = Sequence[tuple[float, StereoFeatures]]
Pose = Float[np.ndarray, " 7"]


@dataclass(frozen=True)
class PairOfEpochs:
    """Matches of two epochs, and the true attitude between them.

    The attitude is of g at the second epoch with the axes of the camera at the first.
    """

    matches: Matches
    rotation: Float[np.ndarray, "3 3"]


def main() -> None:
    """Run the study."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path)
    parser.add_argument("--step", type=int, default=1)
    options = parser.parse_args()
    found = stereo_points(options.folder, FrontEndOptions(), LossCount())
    truth, rig = read_truth(options.folder), found.source.rectification.stereo
    points = found.points[:: options.step]
    truth = found.source.rectification.truth(truth)
    _compare_consensus(list(_pairs(points, rig, truth)), rig)
    _compare_predictions(points, rig, truth)


def _pairs(points: Points, rig: StereoRig, truth: Truth) -> Iterator[PairOfEpochs]:
    """Matches between neighbours; the map is what the first of them triangulates."""
    noise, camera = TrackNoise(), stereo_pair(rig.calibration)
    for (first, a), (second, b) in pairwise(points):
        pairs = clear_pairs(
            b.features.descriptors @ a.features.descriptors.T,
            Association().similarity,
            Association().ratio,
            LossCount(),
            "",
        )
        at = camera.points_of(a.values, rig.calibration)
        inverse = np.linalg.inv(pixels_by_point(at, rig))
        spread = inverse @ noise.covariance(a.features.size, a.residual) @ np.swapaxes(inverse, 1, 2)
        own = noise.covariance(b.features.size, b.residual)
        matches = Matches(at[pairs[:, 1]], b.values[pairs[:, 0]], own[pairs[:, 0]], spread[pairs[:, 1]])
        R = _true_rotation(truth, second) @ _true_rotation(truth, first).T
        yield PairOfEpochs(matches, R)


def _true_rotation(truth: Truth, time_s: float) -> Float[np.ndarray, "3 3"]:
    return matrix_from_quaternion(truth.q_ig[np.searchsorted(truth.time, time_s - 1e-6)])


def _compare_consensus(pairs: list[PairOfEpochs], rig: StereoRig) -> None:
    print("| consensus | motions within 2 deg | median error of these | ms of processor time a pair |")
    methods: dict[str, Callable[[Matches], np.ndarray | None]] = {"house": lambda m: _house(m, rig)}
    for name, flag in OPENCV.items():
        methods[name] = lambda m, flag=flag: _opencv(m, rig, flag)
    for name, method in methods.items():
        begin, errors = time.process_time(), []
        for pair in pairs:
            R = method(pair.matches)
            turn = np.eye(3) if R is None else R @ pair.rotation.T
            errors.append(np.inf if R is None else float(angle_from_matrix(turn)))
        spent, degrees = time.process_time() - begin, np.rad2deg(errors)
        right = degrees < RIGHT_DEG
        print(
            f"| {name} | {np.count_nonzero(right)} of {len(pairs)} | {np.median(degrees[right]):.3f} deg | "
            f"{1e3 * spent / len(pairs):.1f} |",
            flush=True,
        )


def _house(matches: Matches, rig: StereoRig) -> np.ndarray | None:
    fit = None if len(matches.points) < 4 else fit_pose(matches, rig.calibration)
    return None if fit is None else matrix_from_quaternion(fit.pose[3:])


def _opencv(matches: Matches, rig: StereoRig, flag: int) -> np.ndarray | None:
    """Pose by OpenCV from the left pixels: it has no robust rigid motion."""
    if len(matches.points) < 6:
        return None
    K = np.array([[rig.left.fx, 0, rig.left.cx], [0, rig.left.fy, rig.left.cy], [0, 0, 1]])
    try:
        good, turn, _, _ = cv2.solvePnPRansac(
            matches.points,
            np.ascontiguousarray(matches.pixels[:, :2]),
            K,
            np.zeros(4),
            iterationsCount=2000,
            reprojectionError=REPROJECTION_PX,
            confidence=0.999,
            flags=flag,
        )
    except cv2.error:
        return None
    return cv2.Rodrigues(turn)[0] if good else None


def _compare_predictions(points: Points, rig: StereoRig, truth: Truth) -> None:
    print("| prediction | epochs | observations | landmarks | wrong poses | ms of processor time an epoch |")
    for name, prediction in (
        ("none", lambda _poses, _time: None),
        ("constant rate", constant_rate),
        ("true motion", lambda poses, at: _moved_truly(poses, at, truth)),
    ):
        begin = time.process_time()
        with mock.patch.object(association, "constant_rate", prediction):
            tracker = Tracker(rig, TrackNoise(), LossCount())
            epochs = [tracker.add(k, at, each) for k, (at, each) in enumerate(points)]
        spent, found = time.process_time() - begin, [each for each in epochs if each is not None]
        ids = np.concatenate([each.ids for each in found])
        often = np.bincount(ids)[ids] > 1
        first = found[0]
        wrong = 0
        for each in found:
            R = _true_rotation(truth, each.time) @ _true_rotation(truth, first.time).T
            there = matrix_from_quaternion(each.pose[3:]) @ matrix_from_quaternion(first.pose[3:]).T
            wrong += angle_from_matrix(there @ R.T) > np.deg2rad(RIGHT_DEG)
        print(
            f"| {name} | {len(found)} of {len(points)} | {np.count_nonzero(often)} | {len(np.unique(ids[often]))} | {wrong} | "
            f"{1e3 * spent / len(points):.0f} |",
            flush=True,
        )


def _moved_truly(poses: Sequence[TimedPose], at: float, truth: Truth) -> Pose | None:
    """The last pose, moved as the body truly moves."""
    if not poses:
        return None
    last = poses[-1]
    before, after = (_true_pose(truth, when) for when in (last.time, at))
    R = after[0] @ before[0].T
    shift = R @ (last.pose[:3] - before[1]) + after[1]
    return np.concatenate([shift, quaternion_from_matrix(R @ matrix_from_quaternion(last.pose[3:]))])


def _true_pose(truth: Truth, time_s: float) -> tuple[np.ndarray, np.ndarray]:
    """Rotation of g, and the centre of mass, m."""
    row = np.searchsorted(truth.time, time_s - 1e-6)
    return matrix_from_quaternion(truth.q_ig[row]), truth.center_of_mass[row]


if __name__ == "__main__":
    run_study(main)
