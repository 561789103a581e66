"""Attitudes and named causes of tumbling bodies in scans of the command line's default size.

    python -m experiments.scanned_bodies [--bodies spacecraft box] [--mesh FILE] [--noise none thesis] [--seeds 5] [--scans 40]
                                         [--first-seed 0] [--rays 200] [-o FILE]

Bodies are the built-in spacecraft, a box of 1 x 1.3 x 0.8 m, and a mesh from a file. Seed 0 is the attitude that ``lidar scan``
begins with, and others are drawn; the seed also draws the noise. Printed of each estimator are its verdict, the largest attitude
error over all epochs whose scan was used, the checks that failed, and the model errors that their sentences mention. Epochs of an
initialisation count as used where the smoother of the first epochs did not refuse their scan. ``-o`` keeps a line of JSON for each
estimator, and ``--rows FILE`` prints the table of such lines again.
"""

import argparse
import json
import re
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from time import process_time
from typing import Any, Final

import numpy as np

from experiments.command_line import rows_of_seeds, run_study
from spinfilters.core.errors import SpinfiltersError
from spinfilters.evaluation.estimator_evaluation import Evaluation
from spinfilters.inference.setup import Setup
from spinfilters.lidar.mesh import TriangleMesh, box, read_mesh
from spinfilters.run.estimation import compare_estimators
from spinfilters.run.preparation import prepare
from spinfilters.run.readers import read_dataset
from spinfilters.settings.run_settings import Settings
from spinfilters.simulation.lidar_sequence import (
    ScannedScene,
    mesh_of,
    scan_sequence,
    scan_times,
    truth_of,
    write_sequence,
)
from spinfilters.simulation.scan_arguments import BodyArguments, ErrorArguments, RayArguments, ScanArguments
from spinfilters.verdict.model_errors.alternatives import ALTERNATIVES

FIELD_OF_VIEW: Final = 2 * 1.1 * float(np.rad2deg(np.arcsin(0.25)))
"""Deg, around a body that is four radii away, with a tenth to spare."""
LARGEST_ERROR: Final = 1.0
"""Deg, of an attitude in a scan that is used."""


def main() -> None:
    """Print a line per run and estimator, then the table."""
    options = parser().parse_args()
    if options.rows:
        rows = [json.loads(line) for path in options.rows for line in path.read_text().splitlines()]
        print("\n".join(table_of(rows)))
        return
    meshes = {name: box((1.0, 1.3, 0.8)) if name == "box" else mesh_of(name) for name in options.bodies}
    meshes |= {path.stem: read_mesh(path) for path in options.mesh}
    seeds = range(options.first_seed, options.first_seed + options.seeds)
    rows = []
    for name, mesh in meshes.items():
        for noise in options.noise:

            def run(seed: int, name: str = name, mesh: TriangleMesh = mesh, noise: str = noise) -> list[Any]:
                """Rows of a seed, printed."""
                found = list(rows_of(name, mesh, noise, options.scans, seed, options.rays))
                print("\n".join(line_of(row) for row in found), flush=True)
                return found

            rows += rows_of_seeds(run, seeds, options.output)
    print("\n".join(table_of(rows)))


def parser() -> argparse.ArgumentParser:
    """Options of the command."""
    made = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    made.add_argument("--bodies", nargs="*", choices=("spacecraft", "box"), default=("spacecraft", "box"))
    made.add_argument("--mesh", type=Path, nargs="*", default=())
    made.add_argument("--noise", nargs="*", choices=("none", "thesis"), default=("none", "thesis"))
    made.add_argument("--seeds", type=int, default=5)
    made.add_argument("--first-seed", type=int, default=0)
    made.add_argument("--scans", type=int, default=40)
    made.add_argument("--rays", type=int, default=200)
    made.add_argument("--rows", type=Path, nargs="*", help="files of -o, whose table is printed")
    made.add_argument("-o", "--output", type=Path)
    return made


def scene_of(mesh: TriangleMesh, noise: str, seed: int, rays: int) -> ScannedScene:
    """The mesh before a lidar as ``lidar scan`` has it, from the attitude of a seed."""
    z, y, x = (
        np.random.default_rng([seed, 37]).uniform(-180.0, 180.0, 3).tolist() if seed else (0.0, 0.0, 0.0)
    )
    options = ScanArguments(
        mesh="cube",
        seed=seed,
        body=BodyArguments(rotation=(z, y, x), translation=(4 * mesh.radius, 0.0, 0.0)),
        beams=RayArguments(rays=(rays, rays), fov=(FIELD_OF_VIEW, FIELD_OF_VIEW)),
        errors=ErrorArguments(noise="thesis" if noise == "thesis" else "none"),
    )
    return replace(ScannedScene.of(options), mesh=mesh)


def rows_of(
    body: str, mesh: TriangleMesh, noise: str, scans: int, seed: int, rays: int
) -> Iterator[dict[str, Any]]:
    """A row of each estimator."""
    head: dict[str, Any] = {"body": body, "noise": noise, "scans": scans, "seed": seed, "rays": rays}
    started, arguments = process_time(), BodyArguments()
    scene = scene_of(mesh, noise, seed, rays)
    motion = scene.tumbling(arguments.rate_rpm, arguments.velocity)
    begin, epochs = scan_times(scans, arguments.interval, 0.0)
    sequence = scan_sequence(scene.scanner, motion, begin, seed, lambda *_: None)
    with tempfile.TemporaryDirectory() as folder:
        write_sequence(Path(folder), sequence, truth_of(motion, epochs), body)
        try:
            dataset = read_dataset(folder)
            settings = Settings()
            setup = prepare(dataset, settings)
            comparison = compare_estimators(setup, settings, lambda *_: None)
        except SpinfiltersError as refusal:
            yield {**head, "estimator": "", "verdict": "refused", "reasons": [str(refusal)], "causes": []}
            return
    head["doubts"], head["used"] = list(dataset.doubts), len(setup.timeline)
    for each in comparison.evaluations:
        yield {**head, **row_of(each, setup), "seconds": process_time() - started}


def row_of(found: Evaluation, setup: Setup) -> dict[str, Any]:
    """What is looked at of one estimator."""
    history, errors, status = found.history, found.errors, found.history.status
    assert errors is not None
    size = np.rad2deg(np.linalg.norm(errors.attitude, axis=1))
    used = history.accepted[errors.rows] > 0
    refused = [each for each in setup.initial.refused.values() if len(each) == history.initialisation]
    before = errors.rows < history.initialisation
    for each in refused:
        used[before] = ~each[errors.rows[before]]
    if not refused:
        used[before] = True
    sentences = " ".join(status.reasons)
    named = {name for each in status.findings for name in re.split(r"[:+/]", each.check)[1:]}
    return {
        "estimator": found.name,
        "verdict": str(status.verdict),
        "checks": [each.check for each in status.findings],
        "causes": sorted(named | {each.name for each in ALTERNATIVES if each.phrase in sentences}),
        "reasons": list(status.reasons),
        "unused_epochs": int(np.count_nonzero(~used)),
        "own": float(np.max(size[used & ~before], initial=0.0)),
        "initialisation": float(np.max(size[used & before], initial=0.0)),
        "unused": float(np.max(size[~used], initial=0.0)),
        "attitudes": [[float(a), bool(b)] for a, b in zip(size, used, strict=True)],
        "nees": None if found.nees is None else float(np.mean(found.nees.total / found.nees.dof)),
    }


def line_of(row: dict[str, Any]) -> str:
    """One run and estimator."""
    head = f"{row['body']}, noise {row['noise']}, {row['scans']} scans, seed {row['seed']}"
    if not row["estimator"]:
        return f"{head}: {row['verdict']}, {row['reasons'][0]}"
    return (
        f"{head}, {row['estimator']}: {row['verdict']}, {row['own']:.3g} deg, in the initialisation {row['initialisation']:.3g}, "
        f"{row['unused_epochs']} scans not used (within {row['unused']:.3g}); {' '.join(row['checks']) or 'no check'}"
        f"; causes: {' '.join(row['causes']) or 'none'}"
    )


def table_of(rows: Sequence[dict[str, Any]]) -> Iterator[str]:
    """A line per body, noise, number of scans and estimator."""
    yield "body, noise, scans, estimator | runs | largest error deg, own epochs | initialisation | verdicts | causes"
    keys = dict.fromkeys((r["body"], r["noise"], r["scans"], r["estimator"]) for r in rows)
    for key in keys:
        own = [r for r in rows if (r["body"], r["noise"], r["scans"], r["estimator"]) == key]
        verdicts = {
            name: sum(r["verdict"] == name for r in own) for name in sorted({r["verdict"] for r in own})
        }
        causes = sorted({cause for r in own for cause in r["causes"]})
        largest = [max(r.get(part, np.nan) for r in own) for part in ("own", "initialisation")]
        marks = ["" if not each > LARGEST_ERROR else " (beyond)" for each in largest]
        errors = " | ".join(f"{each:.3g}{mark}" for each, mark in zip(largest, marks, strict=True))
        told = ", ".join(f"{count} {name}" for name, count in verdicts.items())
        yield f"{', '.join(map(str, key))} | {len(own)} | {errors} | {told} | {' '.join(causes) or 'none'}"


if __name__ == "__main__":
    run_study(main)
