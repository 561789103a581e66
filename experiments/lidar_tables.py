"""Decoust's Tables 4.1, 4.2, 4.3 and Figures 4.13, 4.16 beside what the same processing gives here.

    python -m experiments.lidar_tables ../shared/data/source_tables

What differs, and why:

Table 4.1  All nine differences of boundary corners are printed digits. The column "Distance" is 10 times too small. The corner's
           own difference depends on the "arbitrary" points whose normals are taken.
Table 4.2  The centre's error is the corners' error times the amplification below: thousands for four neighbouring poses. The
           normal equations in mm of Eq. 4.15 lose 1.5 m; here they are centred.
Table 4.3  Boundary corners lie inside the cube by up to a spacing of the rays, so the sphere shrinks.
Figure 4.13, 4.16  Triples are compared as sets within a transition: the thesis numbers boundary corners anew.
           A choice of another edge point, one ray further, changes an angle by 1.8 deg at 1 m.
"""

import argparse
from pathlib import Path

import numpy as np
from jaxtyping import Float

from experiments.command_line import run_study
from experiments.lidar_thesis.reference_frames import best_fitting_sphere
from experiments.lidar_thesis.sequences import PLACE, SEQUENCES, ProcessedSequence, processed_sequence
from spinfilters.simulation.lidar_sequence import RANGE_NOISE

DIGITS = 0.015
"""Deg: two printed decimals, and the rounding of what was subtracted."""


def printed(path: Path, first: int) -> Float[np.ndarray, "n m"]:
    """Numbers of a table from a column on."""
    lines = [line for line in path.read_text().splitlines() if not line.startswith("#")][1:]
    return np.array([[float(cell) for cell in line.split(",")[first:]] for line in lines])


def table_4_1(sequence: ProcessedSequence, folder: Path) -> None:
    """Differences of the first snapshot's corners, cm."""
    theirs = printed(folder / "table_4_1_corner_errors.csv", 2)[:, 0].reshape(4, 3)
    corner = 100 * sequence.errors(sequence.corners)[0]
    ours = np.array([100 * sequence.errors(sequence.boundary_corners[:, k])[0] for k in range(3)])
    print("Table 4.1: difference of coordinates (cm), printed | ours")
    print(f"  corner             {theirs[0]} | {corner}")
    worst = 0.0
    for k in range(1, 4):
        match = ours[np.argmin(np.abs(ours - theirs[k]).max(axis=1))]
        worst = max(worst, float(np.abs(match - theirs[k]).max()))
        print(f"  boundary corner {k}  {theirs[k]} | {match.round(3)}, distance {np.linalg.norm(match):.2f}")
    print(f"  largest difference of the nine: {worst:.4f} cm")


def spheres(sequence: ProcessedSequence, folder: Path) -> None:
    """Centres of rotation from 4, 8 and 12 poses, mm."""
    tables = (
        ("table_4_2_sphere_fit_corners_only.csv", "Table 4.2, corners", False),
        ("table_4_3_sphere_fit_corners_and_boundary_corners.csv", "Table 4.3, with boundary corners", True),
    )
    for file, words, with_boundary in tables:
        theirs = printed(folder / file, 1)
        print(f"{words}: centre and radius (mm), printed | ours")
        for column, count in enumerate((4, 8, 12)):
            points = sequence.corners[:count]
            if with_boundary:
                points = np.concatenate([points, sequence.boundary_corners[:count].reshape(-1, 3)])
            sphere = best_fitting_sphere(points[np.isfinite(points).all(axis=1)])
            ours = 1000 * np.array([*sphere.centre, sphere.radius])
            print(
                f"  {count:2d} poses  {theirs[:, column]} | {ours.round(3)}, amplification {sphere.amplification:.0f}"
            )


def transitions(sequence: ProcessedSequence, file: Path, words: str) -> None:
    """Errors of transitions, deg."""
    theirs = printed(file, 1).reshape(-1, 3, 3)
    ours = np.stack([sequence.transition_errors(k) for k in range(3)], axis=1)
    equal = 0
    print(f"{words}: angle errors x y z of three boundary corners (deg), printed | ours")
    for number, (a, b) in enumerate(zip(theirs, ours, strict=True), 1):
        gap = np.abs(a[:, None] - b).max(axis=2)
        equal += np.count_nonzero(np.nanmin(np.where(np.isnan(gap), np.inf, gap), axis=1) < DIGITS)
        print(f"  {number:2d}  {a.ravel()} | {b.round(2).ravel()}")
    print(f"  {equal} of {3 * len(theirs)} triples agree within {DIGITS} deg")
    print(
        f"  largest: printed {theirs.max():.2f}, ours {np.nanmax(ours):.2f}; snapshots without a corner: {_lost(sequence)}"
    )


def _lost(sequence: ProcessedSequence) -> int:
    return sum(each is None for each in sequence.snapshots)


def main() -> None:
    """Print everything."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("tables", type=Path, help="folder of the thesis' tables as CSV")
    folder = parser.parse_args().tables
    np.set_printoptions(linewidth=200, suppress=True)
    first, second = (processed_sequence(angles) for angles in SEQUENCES)
    table_4_1(first, folder)
    print(f"centre of rotation, true: {1000 * PLACE} mm, radius 866.025 mm")
    spheres(first, folder)
    transitions(first, folder / "fig_4_13_transition_errors_seq1.csv", "Figure 4.13")
    transitions(second, folder / "fig_4_16_transition_errors_seq2.csv", "Figure 4.16")
    noisy = processed_sequence(SEQUENCES[0], noise=RANGE_NOISE)
    print(
        f"with 0.01 m (3 sigma) of range noise {_lost(noisy)} of {len(noisy.snapshots)} snapshots have no corner"
    )


if __name__ == "__main__":
    run_study(main)
