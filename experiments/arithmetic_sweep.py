"""Random search for an indefinite covariance of map-free filters.

In both precisions, checked after every step.
    python -m experiments.arithmetic_sweep [--runs 10000] [--every 8] [-o runs/arithmetic]

Time steps from 1e-4 s to 10 s, variances that an update lowers by up to 1e12 and more (`arithmetic_runs`). After every step the
factor must be finite, every landmark's own root without a zero on its diagonal, and the covariance of the state that the factor
forms in higher precision positive definite. One in ``--every`` runs of the MEKF is solved again, every step as the linear problem
that it was (`arithmetic_methods`): by a reference in extended precision, which tells the error of the standard deviations, and by
covariances in the conventional forms in the run's precision, which show that the check can fail. Last, the process noise over one
step is compared with that composed of many.
"""

import argparse
from collections.abc import Iterable
from dataclasses import dataclass, field
from itertools import takewhile
from pathlib import Path

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from rich.progress import track

from experiments.arithmetic_methods import (
    CONVENTIONAL,
    LinearStep,
    forms_definite,
    is_definite,
    joint_before,
    linear_step,
    reference,
    stds,
)
from experiments.arithmetic_runs import LAYOUT, FilterStep, RandomRun, random_run, steps
from experiments.command_line import run_study
from spinfilters.core.errors import SpinfiltersError
from spinfilters.filters.iterated_update import IterationOptions
from spinfilters.io.output_files import make_folder
from spinfilters.models.process import ProcessNoise, TorqueFreeProcess
from spinfilters.plots.style import BLUE, GREEN, ORANGE, PURPLE, RED, save_figure, tidy

PRECISIONS = ("float64", "float32")
COLOURS = {"float64": BLUE, "float32": RED}
RATIO = 1e12
"""Prior to posterior, of variances: what is asked for. A few runs go beyond it."""
PARTS = 256
"""Of a time step, into which it is cut to compose its noise."""
DECADES = np.arange(0.0, 15.0, 2.0)
"""Bins of the ratio in the figure."""


@dataclass
class Checked:
    """Findings of a run.

    Attributes
    ----------
    failures: one word each.   ratio: largest variance before an update over that after it.
    smallest: least eigenvalue of the correlations after any step.   std_error: largest relative error of a standard deviation,
        NaN where the run was not solved again.   indefinite: by conventional form, whether it ever was.
    """

    run: RandomRun
    failures: list[str] = field(default_factory=list)
    steps: int = 0
    ratio: float = 1.0
    smallest: float = np.inf
    std_error: float = np.nan
    indefinite: dict[str, bool] = field(default_factory=dict)

    @property
    def solved_again(self) -> bool:
        """Whether there is a reference."""
        return bool(self.indefinite)


def main() -> None:
    """Run the sweep."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--runs", type=int, default=10_000)
    parser.add_argument("--every", type=int, default=8, help="one in so many runs is solved again")
    parser.add_argument("-o", "--output", type=Path, default=Path("runs/arithmetic"))
    options = parser.parse_args()
    make_folder(options.output)
    found = [check(seed, options.every) for seed in track(range(options.runs), description="runs")]
    print(described(found))
    for dt in np.logspace(-4, 1, 6):
        print(f"process noise over {dt:g} s: relative error {noise_error(float(dt)):.1e}")
    save_figure(figure(found), options.output / "arithmetic.png")
    print(f"picture: {options.output / 'arithmetic.png'}")


def check(seed: int, every: int) -> Checked:
    """One run; solved again if its turn has come."""
    run = random_run(seed)
    checked = Checked(run)
    again = run.estimator == "mekf" and (seed // 4) % every == 0
    estimator = run.filter(IterationOptions(iterations=1) if again else None)
    try:
        taken = []
        for step in steps(run, estimator):
            inspect(checked, step)
            taken.append(step)
    except (np.linalg.LinAlgError, SpinfiltersError) as error:
        checked.failures.append(type(error).__name__)
        return checked
    if again:
        solve_again(checked, taken)
    return checked


def inspect(checked: Checked, step: FilterStep) -> None:
    """Look at the covariances after a step: of the state, and of each landmark's own error.

    Modes may be functions of the state: those that came in last are errors of its pose.
    """
    factor = step.after["factor"]
    checked.steps += 1
    if not (np.isfinite(factor).all() and np.isfinite(step.after["mean"]).all()):
        checked.failures.append("not finite")
        return
    roots = step.after.get("map.roots", np.ones((1, 3, 3)))
    if not np.isfinite(roots).all() or not np.diagonal(roots, axis1=1, axis2=2).all():
        checked.failures.append("a landmark is singular")
    state = factor[: LAYOUT.error_dim].astype(float)
    if not state.any(axis=1).all():
        checked.failures.append("singular")
        return
    if not forms_definite(state):
        checked.failures.append("indefinite")
    if step.measurement is not None:
        rows = state / np.linalg.norm(state, axis=1, keepdims=True)
        checked.smallest = min(checked.smallest, float(np.linalg.svd(rows, compute_uv=False)[-1]) ** 2)
        before, after = stds(step.before["factor"][: LAYOUT.error_dim]), stds(state)
        checked.ratio = max(checked.ratio, float(np.max(before / after)) ** 2)


def solve_again(checked: Checked, taken: list[FilterStep]) -> None:
    """Each step's linear problem by the reference, and by conventional forms."""
    checked.indefinite, checked.std_error = dict.fromkeys(CONVENTIONAL, False), 0.0
    for step in takewhile(_is_in_g, taken):
        problem, before = linear_step(checked.run, step), joint_before(checked.run, step)
        exact = reference(before.astype(np.longdouble), problem)
        error = np.abs(stds(step.after["factor"][: LAYOUT.error_dim]) / stds(exact) - 1).max()
        checked.std_error = max(checked.std_error, float(error))
        kept = before.astype(checked.run.options.precision)
        for name in CONVENTIONAL:
            checked.indefinite[name] |= _fails(kept @ kept.T, name, problem)


def _is_in_g(step: FilterStep) -> bool:
    """Whether the state is still told in frame g.

    A filter that knows no landmark again goes on in another frame.
    """
    modes = step.after.get("map.modes", np.zeros((0, 3, 0))).shape[2]
    return len(step.after["factor"]) == LAYOUT.error_dim + modes


def _fails(covariance: np.ndarray, name: str, problem: LinearStep) -> bool:
    """Whether a conventional form makes a covariance that is not positive definite."""
    with np.errstate(all="ignore"):
        try:
            after = CONVENTIONAL[name](covariance, problem)
        except np.linalg.LinAlgError:
            return True
    return not is_definite(after)


def noise_error(dt: float) -> float:
    """Largest relative difference of Q over dt to composed steps.

    `PARTS` shorter steps, in products of standard deviations.
    """
    process = TorqueFreeProcess(LAYOUT, ProcessNoise())
    x = random_run(0).belief.mean.copy()
    x[LAYOUT.mean_slice("w")] = [0.4, 0.9, 0.3]
    whole, parts = process.noise_covariance(x, dt), np.zeros((20, 20))
    for _ in range(PARTS):
        x, transition, noise = process.linearise(x, dt / PARTS)
        parts = transition @ parts @ transition.T + noise @ noise.T
    std = np.sqrt(np.diag(parts))
    moving = std > 0
    scale = np.outer(std[moving], std[moving])
    return float(np.abs((whole - parts)[np.ix_(moving, moving)] / scale).max())


def described(found: list[Checked]) -> str:
    """The report."""
    failures = [word for one in found for word in one.failures]
    count = sum(one.steps for one in found)
    lines = [
        f"{len(found)} runs, {count} covariances: {len(failures)} failures {sorted(set(failures)) or ''}"
    ]
    for precision in PRECISIONS:
        mine = [one for one in found if one.run.precision == precision]
        again = [one for one in mine if one.solved_again]
        ratios = np.array([one.ratio for one in mine])
        lines.append(
            f"{precision}: variance ratios up to {ratios.max():.1e}, {np.mean(ratios > 1e9):.1%} above 1e9, "
            f"{np.mean(ratios > RATIO):.1%} above {RATIO:g}; least eigenvalue of correlations {min(o.smallest for o in mine):.1e}"
        )
        lines += [
            _errors(precision, again, low, high)
            for low, high in ((1, 1e4), (1e4, 1e8), (1e8, RATIO), (RATIO, np.inf))
        ]
        for name in CONVENTIONAL:
            bad = sum(one.indefinite[name] for one in again)
            lines.append(f"  {name}: {bad} of {len(again)} runs indefinite")
    return "\n".join(lines)


def _errors(precision: str, again: Iterable[Checked], low: float, high: float) -> str:
    errors = [one.std_error for one in again if low <= one.ratio < high]
    if not errors:
        return f"  ratio {low:g} .. {high:g}: no run"
    median, most = np.median(errors), max(errors)
    return f"  ratio {low:g} .. {high:g}: {len(errors)} runs, error of std median {median:.1e}, largest {most:.1e}"


def figure(found: list[Checked]) -> Figure:
    """Eigenvalues against the time step, errors against the ratio, and how often the conventional forms fail."""
    drawn = Figure(figsize=(13.0, 4.2), layout="constrained")
    left, middle, right = drawn.subplots(1, 3)
    again = [one for one in found if one.solved_again]
    for precision in PRECISIONS:
        mine = [one for one in found if one.run.precision == precision]
        style = {"s": 5, "color": COLOURS[precision], "alpha": 0.35, "linewidths": 0}
        left.scatter([o.run.dt for o in mine], [o.smallest for o in mine], label=precision, **style)
        solved = [one for one in again if one.run.precision == precision]
        floor = float(np.finfo(np.float64).eps) / 10
        errors = [max(o.std_error, floor) for o in solved]
        condition = [o.smallest**-0.5 for o in solved]
        middle.scatter(condition, errors, label=precision, **(style | {"s": 9, "alpha": 0.6}))
    left.set(
        xscale="log", yscale="log", xlabel="time step [s]", ylabel="least eigenvalue of the correlations [-]"
    )
    middle.set(xscale="log", yscale="log", ylabel="largest relative error of a standard deviation [-]")
    _failures(right, again)
    middle.set_xlabel("condition of the factor, its rows scaled to one [-]")
    right.set_xlabel("variance before / after an update [-]")
    for axes, scale in ((left, 3), (middle, 3), (right, 1)):
        tidy(axes)
        axes.legend(frameon=False, markerscale=scale, fontsize="small", loc="upper left")
    left.legend(frameon=False, markerscale=3, fontsize="small", loc="lower left")
    return drawn


def _failures(axes: Axes, again: list[Checked]) -> None:
    """Share of runs with an indefinite covariance, by form and precision."""
    colours = iter((BLUE, RED, GREEN, ORANGE))
    for precision in PRECISIONS:
        mine = [one for one in again if one.run.precision == precision]
        for name in CONVENTIONAL:
            share = _share([one.ratio for one in mine], [one.indefinite[name] for one in mine])
            axes.plot(
                10 ** (DECADES[:-1] + 1),
                share,
                "o-",
                color=next(colours),
                markersize=4,
                label=f"{name}, {precision}",
            )
    factor = _share([one.ratio for one in again], [bool(one.failures) for one in again])
    axes.plot(10 ** (DECADES[:-1] + 1), factor, "s-", color=PURPLE, markersize=5, label="factor, both")
    axes.set(
        xscale="log",
        ylabel="runs with an indefinite covariance [-]",
        ylim=(-0.03, 1.45),
        yticks=np.linspace(0, 1, 6),
    )


def _share(ratios: list[float], bad: list[bool]) -> Float[np.ndarray, " b"]:
    at = np.digitize(np.log10(ratios), DECADES[1:-1])
    counts = np.bincount(at, minlength=len(DECADES) - 1)
    sums = np.bincount(at, weights=bad, minlength=len(DECADES) - 1)
    return np.where(counts > 0, sums / np.maximum(counts, 1), np.nan)


if __name__ == "__main__":
    run_study(main)
