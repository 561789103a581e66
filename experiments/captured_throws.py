"""Throws of bodies before motion capture: poses at 300 Hz for 0.4 to 1 s, nothing stated.

    python -m experiments.captured_throws [--seeds 40] [--first 0] [--disturbance 0] [--true-noise] [-o FILE]

Every seed draws its own body, spin (6 to 15 rad/s, away from the principal axes), length and centre of mass; poses have noise of
0.01 m and 0.01 rad. ``--disturbance`` is the true density of force and torque. Printed are of the MEKF and of the smoother how many
estimates are ``ok``, the mean NEES per degree of freedom of the last epoch with the band of as many consistent estimates, those of
each block, and the share of (recording, quantity) beyond 4 stated deviations in the last epoch. A throw is determined where the
Cramer-Rao bound, with the disturbances that there are, puts each moment within 0.1 of the largest: of these the ``ok`` are counted.
``-o`` keeps a line of JSON for each run.
"""

import argparse
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from time import process_time
from typing import Any, Final

import numpy as np

from experiments.command_line import rows_of_seeds, run_study
from spinfilters.core.errors import SpinfiltersError
from spinfilters.evaluation.consistency import chi_square_band
from spinfilters.evaluation.estimator_evaluation import Evaluation
from spinfilters.evaluation.recording_bound import cramer_rao_bound, without_bounds
from spinfilters.evaluation.stated_errors import LARGEST_STATED_ERROR, quantity_errors
from spinfilters.inference.setup import Setup
from spinfilters.io.dataset import Dataset
from spinfilters.models.process import ProcessNoise
from spinfilters.run.estimation import ComparisonExtent, compare_estimators
from spinfilters.run.preparation import prepare
from spinfilters.settings.run_settings import Settings
from spinfilters.simulation.scenario import Scenario, simulate, without_noise
from spinfilters.verdict.checks import LARGEST_MOMENT_STD
from spinfilters.verdict.doubts import evaluated

ESTIMATORS: Final = ("mekf", "smoother")
SAMPLES_PER_SECOND: Final = 300
STD: Final = 0.01
"""Of the poses' noise, m and rad."""


def drawn(seed: int, density: float) -> Scenario:
    """The throw of a seed."""
    draws = np.random.default_rng([seed, 300])
    second = np.sort(draws.uniform(0.15, 1.0, 3))[::-1]  # second moments: every such body is possible
    moments = np.array([second[1] + second[0], second[0] + second[2], second[1] + second[2]])
    while True:  # a spin near a principal axis tells no moments
        direction = draws.standard_normal(3)
        direction /= np.linalg.norm(direction)
        if np.sort(np.abs(direction))[1] > 0.25:
            break
    rate = direction * draws.uniform(6.0, 15.0)
    seconds = draws.uniform(0.4, 1.0)
    return Scenario.simplified(
        kind="pose",
        principal_moments=tuple(moments / moments.max()),
        rate_rpm=tuple(rate * 30 / np.pi),
        velocity=tuple(draws.uniform(-2.0, 2.0, 3)),
        center_of_mass_g=tuple(draws.uniform(-0.05, 0.05, 3)),
        epochs=round(seconds * SAMPLES_PER_SECOND),
        interval=1 / SAMPLES_PER_SECOND,
        range_m=4.0,
        position_std=STD,
        rotation_std=STD,
        noise=ProcessNoise(density, density),
        seed=seed,
    )


def rows_of(seed: int, density: float, stated: bool) -> Iterator[dict[str, Any]]:
    """A row of each estimator on the throw of a seed."""
    begin, scenario = process_time(), drawn(seed, density)
    recording = simulate(scenario)
    dataset: Dataset = with_densities(recording, density) if stated else without_noise(recording)
    settings = Settings(estimators=ESTIMATORS)
    head: dict[str, Any] = {"seed": seed, "epochs": scenario.epochs}
    try:
        setup = prepare(dataset, settings)
        extent = ComparisonExtent(bounding=without_bounds)
        comparison = compare_estimators(setup, settings, lambda *_: None, extent=extent)
    except SpinfiltersError as refusal:
        yield {**head, "estimator": "", "verdict": "refused", "checks": [], "reason": str(refusal)}
        return
    head["bound"] = _moment_bound(setup, comparison.evaluations[-1])
    for each in comparison.evaluations:
        status, nees = each.history.status, each.nees
        yield {
            **head,
            "estimator": each.name,
            "verdict": str(status.verdict),
            "checks": [finding.check for finding in status.findings],
            "dof": None if nees is None else nees.dof,
            "nees": None if nees is None else float(nees.total[-1]),
            "blocks": {} if nees is None else {name: float(own[-1]) for name, own in nees.blocks.items()},
            "last": {name: float(own[-1]) for name, own in quantity_errors(each).items()},
            "noise": {
                level.name: [level.value, level.log_std, level.share, level.expected]
                for level in each.history.noise
            },
            "seconds": process_time() - begin,
        }


def with_densities(recording: Dataset, density: float) -> Dataset:
    """The recording with its true densities stated: a simulation does not state those of zero, which are identified then."""
    return replace(recording, options=replace(recording.options, force_psd=density, torque_psd=density))


def _moment_bound(setup: Setup, estimate: Evaluation) -> float | None:
    """Least standard deviation of the worst moment, of the largest; None where the throw has no bound."""
    truth = setup.dataset.truth
    assert truth is not None
    bound = cramer_rao_bound(setup, truth, estimate)
    return None if bound is None else float(evaluated(bound, setup).body.principal_moments_std.max())


def lines_of(rows: Sequence[dict[str, Any]]) -> Iterator[str]:
    """Lines of the report."""
    for name in ("", *ESTIMATORS):
        own = [row for row in rows if row["estimator"] == name]
        if not own:
            continue
        verdicts = dict(Counter(row["verdict"] for row in own))
        failed = dict(Counter(check for row in own for check in row["checks"]))
        yield f"{name or 'refused'}: {len(own)} throws, {verdicts}, checks that failed {failed}"
        known = [row for row in own if row.get("nees") is not None]
        if not known:
            continue
        dof = known[0]["dof"]
        low, high = (float(limit) / dof for limit in chi_square_band(dof, len(known)))
        mean = np.mean([row["nees"] for row in known]) / dof
        yield f"  NEES per degree of freedom {mean:.2f}, band {low:.2f} to {high:.2f}, of {dof}"
        ok = [row for row in known if row["verdict"] == "ok"]
        determined = [row for row in known if row["bound"] is not None and row["bound"] <= LARGEST_MOMENT_STD]
        held = sum(row["verdict"] == "ok" for row in determined)
        yield f"  {len(determined)} of {len(known)} are determined by the Cramer-Rao bound, {held} of these ok"
        if ok:
            yield f"  of those that are ok {np.mean([row['nees'] for row in ok]) / dof:.2f}"
        blocks = {
            block: np.mean([row["blocks"][block] for row in known]) / (5 if block == "s" else 3)
            for block in known[0]["blocks"]
        }
        yield "  by block " + ", ".join(f"{block} {value:.2f}" for block, value in blocks.items())
        for title, some in {"all": known, "ok": ok}.items():
            errors = [error for row in some for error in row["last"].values()]
            beyond = sum(error > LARGEST_STATED_ERROR for error in errors)
            largest = max(errors, default=0.0)
            yield f"  {title}: {beyond} of {len(errors)} (throw, quantity) beyond 4 in the last epoch, largest {largest:.1f}"


def main(arguments: Sequence[str] | None = None) -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, default=40)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--disturbance", type=float, default=0.0, help="true density of force and torque")
    parser.add_argument("--true-noise", action="store_true", help="state the noise and the densities")
    parser.add_argument("-o", "--output", type=Path, default=None)
    options = parser.parse_args(arguments)
    seeds = range(options.first, options.first + options.seeds)
    rows = rows_of_seeds(
        lambda seed: rows_of(seed, options.disturbance, options.true_noise), seeds, options.output
    )
    for line in lines_of(rows):
        print(line)


if __name__ == "__main__":
    run_study(main)
