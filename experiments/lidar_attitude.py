"""Attitude from noisy scans without a prior of the shape.

The thesis' two sequences, and full turns at 30 m.
python -m experiments.lidar_attitude [--seeds 10] [--turn-seeds 20] [--rays 551] [--places 0 1 2 3]
"""

import argparse
from itertools import combinations

import numpy as np

from experiments.command_line import run_study
from spinfilters.core.absolute_orientation import nearest_rotation
from spinfilters.core.attitude_conversions import matrix_from_quaternion
from spinfilters.lidar.mesh import box
from spinfilters.lidar.planes import PointNoise, extract_planes
from spinfilters.lidar.scan import LidarNoise, RayPattern, rvs_noise
from spinfilters.lidar.scan_pose import rotation_vector
from spinfilters.lidar.scan_poses import scan_poses
from spinfilters.reproduction.decoust.snapshot_frames import SEQUENCES
from spinfilters.simulation.lidar_scanner import LidarSettings, Scanner, Still, thesis_rotation
from spinfilters.simulation.lidar_sequence import Initial, scan_sequence, scan_times, tumble_of

PLACES = ((5.0, 24.0, 0.02), (30.0, 4.0, 0.03), (500.0, 0.24, 2.0), (500.0, 2.0, 3.5))
"""Distance, m, field of view, deg, and what was asked for, deg."""


def main() -> None:
    """Print the largest errors."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--turn-seeds", type=int, default=20)
    parser.add_argument("--rays", type=int, default=551)
    parser.add_argument(
        "--places", type=int, nargs="*", default=range(len(PLACES)), help="numbers of the places"
    )
    options = parser.parse_args()
    print_exact(options.rays)
    for distance, field, asked in (PLACES[k] for k in options.places):
        worst = []
        for k, seed in ((k, seed) for k in (0, 1) for seed in range(options.seeds)):
            worst.append(transitions(distance, field, k, seed, options.rays, rvs_noise()))
            print(f"  {distance:g} m, sequence {k + 1}, seed {seed}: {worst[-1]:.4f} deg", flush=True)
        print(
            f"{distance:g} m, field {field:g} deg: worst transition of {options.seeds} seeds, both sequences {max(worst):.4f} deg, "
            f"median of worst {np.median(worst):.4f} (asked {asked})",
            flush=True,
        )
    if options.turn_seeds:
        print_full_turns(options.turn_seeds)


def print_exact(rays: int) -> None:
    """Errors of noise-free scans at 500 m."""
    for k in (0, 1):
        exact, corner = transitions(500.0, 0.24, k, 0, rays, LidarNoise()), corner_error(500.0, 0.24, k, rays)
        print(
            f"without noise at 500 m, sequence {k + 1}: worst transition {exact:.1e} deg (asked 1e-9), worst corner "
            f"{corner:.1e} m (asked 1e-10)",
            flush=True,
        )


def print_full_turns(seeds: int) -> None:
    """Errors of whole turns at 30 m, and their NEES."""
    turns = []
    for seed in range(seeds):
        turns.append(full_turn(seed))
        print(f"  full turn, seed {seed}: {turns[-1][0]:.4f} deg, NEES {turns[-1][1]:.2f}", flush=True)
    largest, nees = np.array(turns).T
    print(
        f"full turns at 30 m, {len(turns)} seeds: largest attitude error {largest.max():.4f} deg (asked 0.2), "
        f"mean NEES of poses {nees.mean():.2f} (6 degrees of freedom)"
    )


def transitions(
    distance: float, field: float, sequence: int, seed: int, rays: int, noise: LidarNoise
) -> float:
    """Largest error of a rotation from scan to scan, deg."""
    scanner = Scanner.of(box(), LidarSettings(RayPattern((field, field), (rays, rays)), noise))
    generator, rotations = (
        np.random.default_rng(seed),
        [thesis_rotation(*pose) for pose in SEQUENCES[sequence]],
    )
    place = np.array([distance, 0.0, 0.0])
    scans = [scanner.scan(Still(R, place), float(k), generator) for k, R in enumerate(rotations)]
    poses = scan_poses(scans, seed=seed).poses
    errors = [
        b.rotation @ a.rotation.T @ (R @ Q.T).T
        for a, b, Q, R in zip(poses[:-1], poses[1:], rotations[:-1], rotations[1:], strict=True)
    ]
    return float(np.rad2deg(max(np.linalg.norm(rotation_vector(each)) for each in errors)))


def corner_error(distance: float, field: float, sequence: int, rays: int) -> float:
    """Largest distance of a corner, where three planes meet, from the true one, m; without noise."""
    scanner = Scanner.of(box(), LidarSettings(RayPattern((field, field), (rays, rays)), LidarNoise()))
    place, generator, worst = np.array([distance, 0.0, 0.0]), np.random.default_rng(0), 0.0
    for pose in SEQUENCES[sequence]:
        R = thesis_rotation(*pose)
        points = scanner.scan(Still(R, place), 0.0, generator).points
        planes, _ = extract_planes(points, PointNoise(0.0, 0.0, 0.0), generator)
        for three in combinations(planes, 3):
            normals = np.array([plane.normal for plane in three])
            corner = np.linalg.solve(normals, [plane.normal @ plane.centroid for plane in three])
            true = place + R @ (0.5 * np.sign(R.T @ (corner - place)))
            worst = max(worst, float(np.linalg.norm(corner - true)))
    return worst


def full_turn(seed: int) -> tuple[float, float]:
    """Largest attitude error, deg, and mean NEES of poses.

    The body is a tumbling box in 60 scans; frames g are brought together.
    """
    q = np.random.default_rng(seed).standard_normal(4)
    mesh, attitude = (
        box((1.0, 1.3, 0.8)),
        matrix_from_quaternion(q / np.linalg.norm(q)),
    )
    start = Initial(
        attitude, np.array([30.0, 0.0, 0.0]), np.array([0.15, 0.2, 0.12]), np.array([2e-3, 1e-3, -1e-3])
    )
    motion = tumble_of(mesh, start)
    scanner = Scanner.of(mesh, LidarSettings(RayPattern((4.0, 4.0), (121, 121)), rvs_noise()))
    begin, epochs = scan_times(60, 1.0, 0.0)
    poses = scan_poses(scan_sequence(scanner, motion, begin, seed, lambda *_: None)).poses
    R, t = motion.poses(epochs)
    turn = nearest_rotation(np.sum([a.T @ p.rotation for a, p in zip(R, poses, strict=True)], axis=0))
    turned = np.array([rotation_vector((a @ turn).T @ p.rotation) for a, p in zip(R, poses, strict=True)])
    sure = [k for k, pose in enumerate(poses) if not pose.undetermined]
    off = np.median([R[k].T @ (poses[k].translation - t[k]) for k in sure], axis=0)
    shifted = np.array([p.translation - x - a @ off for a, p, x in zip(R, poses, t, strict=True)])
    errors = np.hstack([shifted, turned])
    nees = [e @ np.linalg.solve(p.covariance, e) for e, p in zip(errors, poses, strict=True)]
    return float(np.rad2deg(np.linalg.norm(turned, axis=1).max())), float(np.mean(nees))


if __name__ == "__main__":
    run_study(main)
