"""Decoust's figures of parameters, poses and transitions.

3.3 to 3.7 (influence of the parameters), 4.7 (errors over poses), 4.14 and 4.17 (errors of transitions).
python -m experiments.lidar_figures -o runs/lidar
"""

import argparse
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from experiments.command_line import run_study
from experiments.lidar_thesis.scan_features import Parameters, find_bndry_points, find_edge_points
from experiments.lidar_thesis.sequences import PLACE, SEQUENCES, ProcessedSequence, processed_sequence
from experiments.lidar_thesis.surfaces import surf_segm
from spinfilters.io.output_files import make_folder
from spinfilters.lidar.scan import RayPattern
from spinfilters.plots.style import AXIS_COLOURS, BLUE, GREY, RED, SKY, save_figure
from spinfilters.simulation.lidar_scanner import LidarSettings, Scanner, Still, thesis_rotation
from spinfilters.simulation.lidar_sequence import mesh_of

INFLUENCES = {
    "3.3": (
        "surface variance",
        [Parameters(surface_variance=10.0**k) for k in (-1, -2, -5, -10)],
        (1e-1, 1e-2, 1e-5, 1e-10),
    ),
    "3.4": ("neighbours, edges", [Parameters(edge_neighbors=k) for k in (5, 10, 16, 50)], (5, 10, 16, 50)),
    "3.5": ("chi", [Parameters(chi=k) for k in (0.1, 0.6, 1.0, 1.6)], (0.1, 0.6, 1.0, 1.6)),
    "3.6": ("neighbours, boundary", [Parameters(boundary_neighbors=k) for k in (10, 35)], (10, 35)),
    "3.7": (
        "normal tolerance",
        [Parameters(normal_tolerance=10.0**k) for k in (-1, -3, -5)],
        (1e-1, 1e-3, 1e-5),
    ),
}
POSE = (30.0, 50.0, 0.0)


def main() -> None:
    """Draw everything."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("-o", "--output", type=Path, default=Path("runs/lidar"))
    folder = parser.parse_args().output
    make_folder(folder)
    scanner = Scanner.of(mesh_of("cube"), LidarSettings(RayPattern((0.3, 0.3), (83, 83))))
    points = scanner.scan(Still(thesis_rotation(*POSE), PLACE), 0.0, np.random.default_rng(0)).points
    for name in INFLUENCES:
        save_figure(influence(name, points), folder / f"figure-{name}.png")
    first, second = (processed_sequence(angles) for angles in SEQUENCES)
    save_figure(corner_errors(first), folder / "figure-4.7.png")
    save_figure(transition_figure(first), folder / "figure-4.14.png")
    save_figure(transition_figure(second), folder / "figure-4.17.png")
    print(f"pictures in {folder}")


def influence(name: str, points: np.ndarray) -> Figure:
    """Edges (blue), boundaries (red) or surfaces (colours) of one cloud for some values of a parameter."""
    words, choices, values = INFLUENCES[name]
    figure = Figure(figsize=(3.2 * len(choices), 3.4), layout="constrained")
    for place, (parameters, value) in enumerate(zip(choices, values, strict=True), 1):
        axes = figure.add_subplot(1, len(choices), place)
        found = find_edge_points(points, parameters)
        if name in ("3.3", "3.4"):
            colours = np.where(found.label == 1, BLUE, SKY)
        elif name == "3.7":
            number = surf_segm(find_bndry_points(found, parameters), parameters).of_point
            colours = np.where(number < 0, GREY, np.array([f"C{k % 10}" for k in number]))
        else:
            colours = np.where(find_bndry_points(found, parameters).label == 2, RED, SKY)
        axes.scatter(points[:, 2], points[:, 1], c=colours.tolist(), s=6, linewidths=0)
        axes.set(title=f"{words} {value:g}", xlabel="z (m)", ylabel="y (m)", aspect="equal")
    figure.suptitle(f"Figure {name}")
    return figure


def corner_errors(sequence: ProcessedSequence) -> Figure:
    """Distances between true and measured corners by snapshot, m."""
    figure = Figure(figsize=(7, 4), layout="constrained")
    axes = figure.add_subplot()
    found = {"C": sequence.corners, **{f"BC{k + 1}": sequence.boundary_corners[:, k] for k in range(3)}}
    for name, points in found.items():
        axes.plot(
            np.arange(1, len(points) + 1),
            np.linalg.norm(sequence.errors(points), axis=1),
            marker="o",
            label=name,
        )
    axes.set(xlabel="snapshot", ylabel="distance to the true corner (m)", title="Figure 4.7")
    axes.legend()
    return figure


def transition_figure(sequence: ProcessedSequence) -> Figure:
    """Angle errors of x, y and z by transition, one panel per boundary corner."""
    figure = Figure(figsize=(7, 7), layout="constrained")
    for k in range(3):
        axes = figure.add_subplot(3, 1, k + 1)
        for name, values, colour in zip("xyz", sequence.transition_errors(k).T, AXIS_COLOURS, strict=True):
            axes.plot(np.arange(1, len(values) + 1), values, marker="o", color=colour, label=name)
        axes.set(xlabel="transition", ylabel="error (deg)", title=f"BC{k + 1}")
        axes.legend()
    return figure


if __name__ == "__main__":
    run_study(main)
