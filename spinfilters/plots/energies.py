"""Kinetic energy of a run over time: a free body keeps both, so that a trend is a torque, a force or a wrong inertia."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from spinfilters.core.attitude_conversions import inverse, rotate
from spinfilters.core.errors import NUMERICAL_ERRORS
from spinfilters.evaluation.epoch_spans import initialisation_end
from spinfilters.evaluation.estimated_motion import estimated_rates
from spinfilters.evaluation.estimator_evaluation import Evaluation
from spinfilters.evaluation.kinetic_energy import EnergyCourse, quadratic_energy
from spinfilters.io.truth import Truth
from spinfilters.plots.style import (
    GREY,
    SIGMAS,
    EstimatorLine,
    estimator_lines,
    finite_quantile,
    legend_below,
    mark_start,
    plot_truth,
    start_handle,
    tidy,
    truth_handle,
)


def energy_figure(evaluations: Sequence[Evaluation], truth: Truth) -> Figure:
    """Energy of the rotation per unit of the largest moment, and of the translation per mass, with bands, and the true ones.

    Parameters
    ----------
    evaluations : sequence of Evaluation
        Of the estimators, in the order of the table.
    truth : Truth
        Of the run; its rotational energy is drawn where it has moments and axes.

    Returns
    -------
    Figure
        Not yet saved or shown.
    """
    translates = all(each.history.layout.translates for each in evaluations)
    figure = Figure(figsize=(10.0, 6.6 if translates else 3.8), layout="constrained")
    panels = figure.subplots(1 + translates, 1, sharex=True, squeeze=False)[:, 0]
    lines = estimator_lines([each.name for each in evaluations])
    courses = [rotational_energy(each) for each in evaluations]
    _draw_energies(panels[0], courses, lines, *_true_rotational_energy(truth))
    panels[0].set_ylabel(r"energy / $J_{max}$  [rad$^2$/s$^2$]")
    panels[0].set_title(f"rotation{_changes(evaluations, courses)}", loc="left", fontsize="medium")
    if translates:
        speed = np.sum(truth.velocity**2, axis=1) / 2
        _draw_energies(
            panels[1],
            [translational_energy(each) for each in evaluations],
            lines,
            truth.time,
            1e6 * speed,
            1e6,
        )
        panels[1].set_ylabel("energy / mass  [uJ/kg]")
        panels[1].set_title("translation", loc="left", fontsize="medium")
    end = initialisation_end(evaluations)
    for axes in panels:
        mark_start(axes, evaluations[0].history.time[0], end)
        tidy(axes)
    panels[-1].set_xlabel("time [s]")
    figure.suptitle("Kinetic energy", fontsize="large")
    band = Patch(color=GREY, alpha=0.3, label=f"±{SIGMAS:g} σ of rate and velocity")
    legend_below(figure, [*(line.handle for line in lines), band, truth_handle(), *start_handle(end)])
    return figure


def rotational_energy(evaluation: Evaluation) -> EnergyCourse:
    """w' J w / 2 of the estimated rates with the inertia at the end, over its largest moment, (rad/s)^2.

    Parameters
    ----------
    evaluation : Evaluation
        Of an estimator.
    """
    rates, body = estimated_rates(evaluation.history), evaluation.body
    covariance = np.zeros((len(rates.time), 3, 3)) if rates.covariance is None else rates.covariance
    axes = body.principal_axes_g
    J = axes.T @ np.diag(body.principal_moments / body.principal_moments.max()) @ axes
    return quadratic_energy(rates.time, rates.rate, covariance, J)


def translational_energy(evaluation: Evaluation) -> EnergyCourse:
    """v' v / 2 of the estimated velocity of the centre of mass, J/kg.

    Parameters
    ----------
    evaluation : Evaluation
        Of an estimator that sees positions.
    """
    trajectory = evaluation.trajectory
    covariance = np.einsum("ni,ij->nij", trajectory.std_velocity**2, np.eye(3))
    return quadratic_energy(trajectory.time, trajectory.velocity, covariance, np.eye(3))


def _true_rotational_energy(truth: Truth) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Times and energies; none without moments and axes."""
    moments, axes = truth.principal_moments, truth.principal_axes_g
    if moments is None or axes is None:
        return np.empty(0), np.empty(0)
    about = rotate(inverse(truth.q_ig), truth.rate_i) @ axes.T
    return truth.time, about**2 @ (moments / moments.max()) / 2


def _draw_energies(
    axes: Axes,
    courses: Sequence[EnergyCourse],
    lines: Sequence[EstimatorLine],
    time: Float[np.ndarray, " k"],
    true: Float[np.ndarray, " k"],
    scale: float = 1.0,
) -> None:
    for course, line in zip(courses, lines, strict=True):
        line.fill(axes, course.time, scale * course.energy, SIGMAS * scale * course.std)
        line.draw(axes, course.time, scale * course.energy)
    if len(true):
        plot_truth(axes, time, true)
    # the first epochs of a filter may know nothing: most of the bands decide the limits
    drawn = [*(scale * course.energy for course in courses), true]
    low, high = (
        extreme(finite_quantile(each, share, np.nan) for each in drawn if len(each))
        for extreme, share in ((min, 0.02), (max, 0.98))
    )
    half = max(SIGMAS * scale * finite_quantile(course.std, 0.8) for course in courses)
    if np.isfinite([low, high, half]).all() and high - low + half > 0:
        axes.set_ylim(low - 1.2 * half, high + 1.2 * half)


def _changes(evaluations: Sequence[Evaluation], courses: Sequence[EnergyCourse]) -> str:
    """How much the energy of every estimator changes, of a straight line through its own epochs."""
    words = []
    for evaluation, course in zip(evaluations, courses, strict=True):
        begin = float(course.time[min(evaluation.history.initialisation, len(course.time) - 1)])
        try:
            change, _ = course.change(begin, float(course.time[-1]))
        except NUMERICAL_ERRORS:  # too few epochs for a line
            continue
        if np.isfinite(change):
            words.append(f"{evaluation.name.upper()} {100 * change:+.2g} %")
    return f": changes by {', '.join(words)}" if words else ""
