"""Errors of estimates called ok, in stated standard deviations.

    python -m experiments.honest_verdicts [--seeds 12 [--first 5]] [--cases gyro] [--silent] [--estimators mekf] [-o runs/honest]

Simulates every case of `experiments.honest_cases`, estimates with MEKF, UKF and smoother, and prints of every case the verdicts,
the largest error of the latest epoch in standard deviations among the estimates called ``ok`` and the quantity it is of, and the
mean NEES per degree of freedom of mass distribution and rate; draws the errors. With ``--silent`` no noise is stated. An ``ok``
with an error beyond 4 is a defect.
"""

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from experiments.command_line import run_study
from experiments.honest_cases import CASES, LAYOUT, Recording, RecordingCase, principal_axes, recordings
from spinfilters.core.attitude_conversions import (
    inverse,
    multiply,
    quaternion_from_matrix,
    rotation_vector_from_quaternion,
)
from spinfilters.core.errors import InputError
from spinfilters.core.linear_algebra import normalised_square
from spinfilters.evaluation.estimator_evaluation import Evaluation
from spinfilters.evaluation.stated_errors import LARGEST_STATED_ERROR
from spinfilters.io.output_files import make_folder
from spinfilters.models.status import Verdict
from spinfilters.plots.style import save_figure
from spinfilters.run.estimation import compare_estimators
from spinfilters.run.preparation import prepare
from spinfilters.settings.run_settings import ProcessSettings, Settings
from spinfilters.simulation.scenario import without_noise

NAMES = ("mekf", "ukf", "smoother")


@dataclass(frozen=True)
class VerdictOutcome:
    """What one estimator said of one recording.

    Attributes
    ----------
    errors: largest component of every published quantity's error at the latest epoch, in stated standard deviations.
    nees: of blocks s and w there, per degree of freedom.
    """

    case: str
    seed: int
    estimator: str
    verdict: Verdict
    errors: dict[str, float]
    nees: dict[str, float]

    @property
    def worst(self) -> tuple[float, str]:
        """The largest error and the quantity it is of."""
        return max((size, name) for name, size in self.errors.items())

    @property
    def is_dishonest(self) -> bool:
        """Whether it is called ``ok`` and is not."""
        return self.verdict is Verdict.OK and not self.worst[0] <= LARGEST_STATED_ERROR


@dataclass(frozen=True)
class SweepExtent:
    """Recordings and estimators of a sweep.

    Attributes
    ----------
    seeds: recordings that are drawn of a case; of these the ``first`` are estimated, all for None.
    silent: whether no noise is stated.
    """

    seeds: int = 12
    first: int | None = None
    estimators: tuple[str, ...] = NAMES
    silent: bool = False


def main() -> None:
    """Run the sweep, print, draw."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=12)
    parser.add_argument("--first", type=int, default=None, help="only so many of the seeds")
    parser.add_argument("--cases", default="", help="only cases whose name holds this")
    parser.add_argument("--silent", action="store_true", help="state no noise")
    parser.add_argument("--estimators", nargs="+", choices=NAMES, default=NAMES)
    parser.add_argument("-o", "--output", type=Path, default=Path("runs/honest"))
    options = parser.parse_args()
    make_folder(options.output)
    chosen, found = [case for case in CASES if options.cases in case.name], []
    extent = SweepExtent(options.seeds, options.first, tuple(options.estimators), options.silent)
    for case in chosen:
        outcomes = list(outcomes_of(case, extent))
        found += outcomes
        print(row_of(case, outcomes), flush=True)
    for outcome in found:
        if outcome.is_dishonest:
            print(f"ok and wrong: {outcome.case}, seed {outcome.seed}, {outcome.estimator}: {outcome.worst}")
    save_figure(figure(chosen, found), options.output / "honest-verdicts.png")
    print(
        f"{sum(o.is_dishonest for o in found)} of {len(found)} ok and wrong; {options.output / 'honest-verdicts.png'}"
    )


def outcomes_of(case: RecordingCase, extent: SweepExtent) -> Iterator[VerdictOutcome]:
    """Verdicts of every estimator on a case's recordings, with noise stated or not."""
    settings = Settings(estimators=extent.estimators, process=ProcessSettings(drag=case.drag > 0))
    for seed, recording in enumerate(recordings(case, extent.seeds)[: extent.first]):
        dataset = without_noise(recording.dataset) if extent.silent else recording.dataset
        try:
            evaluations = compare_estimators(
                prepare(dataset, settings), settings, lambda *_: None
            ).evaluations
        except InputError:  # refused, with its reason: nothing is said of it
            continue
        for evaluation in evaluations:
            yield outcome_of(case, seed, evaluation, recording)


def outcome_of(
    case: RecordingCase, seed: int, evaluation: Evaluation, recording: Recording
) -> VerdictOutcome:
    """Errors of the latest epoch."""
    history, verdict = evaluation.history, evaluation.history.status.verdict
    if not np.isfinite(history.mean[-1]).all() or not np.isfinite(history.factor[-1]).all():
        return VerdictOutcome(case.name, seed, evaluation.name, verdict, {"not finite": np.inf}, {})
    error = _state_error(evaluation, recording)
    layout, factor = history.layout, history.factor[-1]
    std = np.linalg.norm(factor, axis=1)
    published = {b: error[layout.slice(b)] / std[layout.slice(b)] for b in layout.blocks if b != "s"}
    published |= _body_errors(case, evaluation)
    sizes = {name: float(np.abs(values).max()) for name, values in published.items()}
    nees = {
        b: float(normalised_square(error[np.newaxis, part], factor[np.newaxis, part])[0])
        / (part.stop - part.start)
        for b, part in ((b, layout.slice(b)) for b in "ws")
    }
    return VerdictOutcome(case.name, seed, evaluation.name, verdict, sizes, nees)


def _state_error(evaluation: Evaluation, recording: Recording) -> np.ndarray:
    """Error of the state at the latest epoch, about the estimate.

    Truth minus estimate; a gyro's frame i is frame g of its first sample.
    """
    history, states = evaluation.history, recording.states
    layout = history.layout
    true = np.concatenate([states[len(history.time) - 1, LAYOUT.mean_slice(b)] for b in layout.blocks])
    if "t" not in layout.blocks:
        q, part = LAYOUT.mean_slice("a"), layout.mean_slice("a")
        true[part] = multiply(history.mean[0, part], multiply(inverse(states[0, q]), true[part]))
    return layout.local(history.mean[-1], true)


def _body_errors(case: RecordingCase, evaluation: Evaluation) -> dict[str, np.ndarray]:
    """Of moments, their log ratios and the principal axes, in standard deviations."""
    body, order = evaluation.body, np.argsort(case.moments)
    moments, axes = np.array(case.moments)[order] / max(case.moments), principal_axes().T[order]
    ratios = np.log(moments[[2, 1]] / moments[[1, 0]]) - [body.k1, body.k2]
    signs = [np.diag([x, y, x * y]) * np.linalg.det(axes) for x, y in product((-1.0, 1.0), repeat=2)]
    turns = [quaternion_from_matrix(body.principal_axes_g @ (sign @ axes).T) for sign in signs]
    turn = min((rotation_vector_from_quaternion(q) for q in turns), key=lambda r: float(r @ r))
    return {
        "moments": (body.principal_moments - moments)[:2] / body.principal_moments_std[:2],
        "log ratios": ratios / [body.k1_std, body.k2_std],
        "axes": turn / body.principal_axes_std,
    }


def row_of(case: RecordingCase, outcomes: Sequence[VerdictOutcome]) -> str:
    """One case in a line for each estimator."""
    lines = []
    for name in dict.fromkeys(outcome.estimator for outcome in outcomes):
        own = [o for o in outcomes if o.estimator == name]
        ok = [o for o in own if o.verdict is Verdict.OK]
        worst = max((o.worst for o in ok), default=(np.nan, "-"))
        nees = {b: np.mean([o.nees[b] for o in ok]) if ok else np.nan for b in "sw"}
        lines.append(
            f"{case.name if not lines else '':28s} {name:9s} "
            f"{len(ok):3d} of {len(own):3d} ok, worst {worst[0]:7.2f} {worst[1]:10s} "
            f"NEES s {nees['s']:6.2f} w {nees['w']:6.2f}"
            + ("   <-- beyond 4" if worst[0] > LARGEST_STATED_ERROR else "")
        )
    return "\n".join(lines)


def figure(cases: Sequence[RecordingCase], outcomes: Sequence[VerdictOutcome]) -> Figure:
    """Largest error of every run against the case: filled where it is called ok."""
    drawn = Figure(figsize=(9.0, 1.5 + 0.24 * len(cases)), layout="constrained")
    axes = drawn.add_subplot()
    place = {case.name: len(cases) - k for k, case in enumerate(cases)}
    ran = {outcome.estimator for outcome in outcomes}
    for name, color, shift in zip(NAMES, ("C0", "C1", "C2"), (0.25, 0.0, -0.25), strict=True):
        if name not in ran:
            continue
        for is_ok, fill in ((True, color), (False, "none")):
            chosen = [o for o in outcomes if o.estimator == name and (o.verdict is Verdict.OK) == is_ok]
            axes.scatter(
                [np.clip(o.worst[0], 0.1, 1e3) for o in chosen],
                [place[o.case] + shift for o in chosen],
                s=14,
                facecolors=fill,
                edgecolors=color,
                linewidths=0.8,
                label=f"{name.upper()}, {'ok' if is_ok else 'degraded or failed'}",
            )
    axes.axvline(LARGEST_STATED_ERROR, color="0.4", linewidth=1.0)
    axes.set(xscale="log", xlim=(0.3, 1e3), ylim=(0.4, len(cases) + 0.6))
    axes.set_yticks(list(place.values()), list(place))
    axes.set_xlabel("largest error of the latest epoch [stated standard deviations]")
    drawn.legend(loc="outside lower center", ncols=3, fontsize="small")
    return drawn


if __name__ == "__main__":
    run_study(main)
