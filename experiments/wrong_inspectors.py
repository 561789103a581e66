"""Verdicts on tracks of moving inspectors whose poses are right, late, drifting, of another point, sparse or missing.

Run: python -m experiments.wrong_inspectors [--cases late,clean] [--inspectors sway,dead-band] [--seeds 10] [--first 0]

Of every case: how many estimates are ``ok``, how many of these have an error of a published quantity beyond 4 stated
deviations, the largest such error, the mean NEES per degree of freedom (the whole covariance), and in how many recordings that
are not ``ok`` the inspector is among the first two causes, or a reason says that its poses are sparse, or that the camera moved.
Motion, noise and tracks are those of the bundled example, with fewer landmarks (``--landmarks``). Of wrong poses nothing is stated:
the deviations of the calibration are the defaults.
"""

import argparse
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from experiments.command_line import run_study
from spinfilters.evaluation.stated_errors import LARGEST_STATED_ERROR, stated_errors
from spinfilters.run.comparison_run import compare_dataset
from spinfilters.settings.run_settings import Settings
from spinfilters.simulation.inspector import INSPECTORS, STATIC
from spinfilters.simulation.scenario import RICH_RPM, THESIS_RPM, Scenario, simulate, without_map

MOVING: Final = tuple(name for name in INSPECTORS if name != STATIC)
CASES: Final[dict[str, tuple[float, ...]]] = {
    "clean": (0.0,),
    "late": (0.05, 0.1, 0.5),
    "turning": (0.028, 0.1),
    "drifting": (0.02,),
    "lever": (0.05, 0.07),
    "sparse": (5.0,),
    "missing": (1.0,),
}
"""Errors of `spinfilters.simulation.inspector` with their sizes."""
TOLD: Final = ("poses are too sparse", "the camera may have moved")
"""Words of reasons that name the inspector where the motion is too far off for a test of causes."""
INSPECTOR: Final = "inspector"
"""Beginning of the names of errors of an inspector."""


@dataclass(frozen=True)
class InspectorOutcome:
    """One estimate of one recording.

    Attributes
    ----------
    is_ok: its verdict.   error: largest, in stated deviations, and of what.   nees: mean, per degree of freedom.
    is_named: whether the inspector is among the first two causes, or its poses are told to be sparse or missing.
    """

    is_ok: bool
    error: tuple[float, str]
    nees: float
    is_named: bool


def outcomes(scenario: Scenario, estimators: tuple[str, ...]) -> list[InspectorOutcome]:
    """Every estimator on a scenario's tracks without a map."""
    dataset = without_map(simulate(scenario))
    compared = compare_dataset(dataset, Settings(estimators=estimators))
    found = []
    for each in compared.evaluations:
        assert dataset.truth is not None
        errors, status = stated_errors(each), each.history.status
        named = any(INSPECTOR in name for name in compared.models.names[:2])
        told = [words for words in TOLD if any(words in reason for reason in status.reasons)]
        nees = np.nan if each.nees is None else each.nees.mean
        worst = max((size, name) for name, size in errors.items())
        found.append(InspectorOutcome(status.verdict == "ok", worst, nees, named or bool(told)))
        print(
            f"  {scenario.inspector} {scenario.inspector_errors} seed {scenario.seed} {each.name}: {status.verdict}, "
            f"NEES {nees:.2f}, {worst[1]} {worst[0]:.1f}, {compared.models.names}{told or ''}",
            flush=True,
        )
    return found


def main(arguments: Sequence[str] | None = None) -> None:
    """Print outcomes of every case."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--cases", default=",".join(CASES))
    parser.add_argument("--inspectors", default=",".join(MOVING))
    parser.add_argument("--sizes", default="", help="in the place of the usual ones")
    parser.add_argument("--landmarks", type=int, default=1400)
    parser.add_argument("--rich", action="store_true", help="the motion that makes everything observable")
    parser.add_argument("--estimators", default="mekf,smoother")
    options = parser.parse_args(arguments)
    usual = Scenario.common_workload(RICH_RPM if options.rich else THESIS_RPM)
    for name in options.inspectors.split(","):
        for case in options.cases.split(","):
            sizes = tuple(map(float, options.sizes.split(","))) if options.sizes else CASES[case]
            for size in sizes:
                errors = () if case == "clean" else ((case, size),)
                own = replace(usual, inspector=name, inspector_errors=errors, landmarks=options.landmarks)
                every = [
                    outcomes(replace(own, seed=seed), tuple(options.estimators.split(",")))
                    for seed in range(options.first, options.first + options.seeds)
                ]
                print(f"{name} {case} {size:g}: {_summary(every)}", flush=True)


def _summary(every: Sequence[Sequence[InspectorOutcome]]) -> str:
    each = [outcome for recording in every for outcome in recording]
    ok = [outcome for outcome in each if outcome.is_ok]
    wrong = [outcome for outcome in ok if outcome.error[0] > LARGEST_STATED_ERROR]
    doubted = [recording for recording in every if not all(outcome.is_ok for outcome in recording)]
    named = sum(any(outcome.is_named for outcome in recording) for recording in doubted)
    worst = max((outcome.error for outcome in ok), default=(0.0, "-"))
    return (
        f"{len(ok)} of {len(each)} ok, {len(wrong)} of these beyond {LARGEST_STATED_ERROR:g} deviations "
        f"(largest {worst[0]:.1f}, {worst[1]}), NEES "
        f"{np.nanmean([outcome.nees for outcome in each]):.2f}, inspector named in {named} of {len(doubted)} doubted recordings"
    )


if __name__ == "__main__":
    run_study(main)
