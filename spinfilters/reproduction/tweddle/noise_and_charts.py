"""Equations 4.55, 4.92 and 4.107: discrete process noise, exact and published, and parametrisations of the inertia (chapter 4)."""

import math
from functools import cache
from typing import Final

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure
from scipy.linalg import eigh, expm

from spinfilters.core.attitude_conversions import cross_matrix, quaternion_from_rotation_vector
from spinfilters.core.conventions import RPM
from spinfilters.core.inertia_charts import (
    aghili_constraint,
    aghili_parameters,
    is_body,
    moments_from_aghili,
    moments_from_lichter,
    moments_from_log_ratios,
)
from spinfilters.core.mass_distribution import from_inertia
from spinfilters.evaluation.trajectory_errors import root_mean_square
from spinfilters.models.process import ProcessNoise, TorqueFreeProcess
from spinfilters.models.state_layout import ROTATION_BLOCKS, StateLayout
from spinfilters.plots.style import BLACK, BLUE, GREEN, RED, tidy
from spinfilters.reproduction.item import ComparedNumber, Item, ItemResult, tweddle_item
from spinfilters.simulation.scenario import simulate_motion

MOMENTS: Final = np.array([1.0322, 1.0, 0.8596])
RATE: Final = np.array([0.5, 10.0, 0.5]) * RPM
TORQUE_PSD: Final = 1e-6
"""(rad/s^2)^2/Hz (section 6.4)."""
STEPS: Final = (0.05, 0.1, 0.2, 0.5, 1.0, 2.0)
BODIES: Final = 4000
MEASURED: Final = (0.60, 1.61)
"""Published variances over those of a Monte Carlo at 10 rpm and 0.5 s, an earlier measurement of this project."""
SAMPLED: Final = 0.5
"""s: the interval of the data set."""


def published_covariance(dt: float) -> Float[np.ndarray, "6 6"]:
    """Noise of attitude and rate over dt as published: the integral of exp(A t) B B' exp(A' t), A of Eqs 4.80 and 4.107 (Van Loan).

    Parameters
    ----------
    dt : float
        Duration, s.
    """
    J, zero = np.diag(MOMENTS), np.zeros((3, 3))
    A = np.block([[-cross_matrix(RATE) / 2, np.eye(3)], [zero, -np.linalg.solve(J, cross_matrix(RATE) @ J)]])
    entry = np.diag([0.0, 0.0, 0.0, 1.0, 1.0, 1.0]) * TORQUE_PSD
    both = expm(dt * np.block([[-A, entry], [np.zeros((6, 6)), A.T]]))
    return both[6:, 6:].T @ both[:6, 6:]


@cache
def _process() -> tuple[TorqueFreeProcess, Float[np.ndarray, " m"]]:
    """Rotation of the thesis' body, its principal axes along g, and a state."""
    layout = StateLayout(ROTATION_BLOCKS)
    x = layout.origin()
    x[layout.mean_slice("w")] = RATE
    x[layout.mean_slice("s")] = from_inertia(np.diag(MOMENTS))
    return TorqueFreeProcess(layout, ProcessNoise(torque_psd=TORQUE_PSD)), x


def sampled_covariance(dt: float, seed: int = 107) -> Float[np.ndarray, "6 6"]:
    """Covariance of attitude and rate over dt from many bodies that the stochastic equation moves."""
    process, x = _process()
    bodies = np.tile(x, (BODIES, 1))
    end = simulate_motion(process, bodies, np.array([0.0, dt]), np.random.default_rng(seed))[-1]
    error = process.layout.local(process.step(x, dt), end)[:, :6]
    return error.T @ error / BODIES


def _ratios(covariance: np.ndarray, reference: np.ndarray) -> Float[np.ndarray, " 6"]:
    """Ratios of variances along all directions, ascending: generalised eigenvalues."""
    return np.asarray(eigh(covariance, reference, eigvals_only=True))


def make_process_noise() -> ItemResult:
    """Eqs 4.80 and 4.107: the published linearisation against the exact noise and a Monte Carlo of its own."""
    process, x = _process()
    exact = {dt: process.noise_covariance(x, dt)[:6, :6] for dt in STEPS}
    published = {dt: _ratios(published_covariance(dt), exact[dt]) for dt in STEPS}
    sampled = _ratios(sampled_covariance(SAMPLED), exact[SAMPLED])
    # extreme sample variances of n bodies over six directions: about 1 +- (sqrt(6 / n) + sqrt(6 / n))
    band = 4.0 * np.sqrt(6.0 / BODIES)
    turned = np.linalg.norm(RATE) * SAMPLED / 2
    why = (
        "the print's matrix A has -w/2 where the derivative of the error on its side has -w: of a rotation by "
        f"{math.degrees(2 * turned):.0f} deg in a step it loses {math.degrees(turned):.0f} deg"
    )
    rows = [
        ComparedNumber(
            f"{word} variance of the {name} noise over the exact one, {SAMPLED} s",
            float(values[at]),
            expected=(1.0 - band, 1.0 + band),
            why=why,
        )
        for name, values in (("sampled", sampled), ("published", published[SAMPLED]))
        for word, at in (("smallest", 0), ("largest", -1))
    ]
    rows += [
        ComparedNumber(
            f"{word} variance of the published noise over the sampled one; measured before with other draws, {before:g}",
            value,
            expected=((1.0 - band) * before, (1.0 + band) * before),
            why=f"the sample of {BODIES} bodies scatters by {band / 4:.1%}, and this is more than four times that",
        )
        for word, before, value in zip(
            ("smallest", "largest"),
            MEASURED,
            _ratios(published_covariance(SAMPLED), sampled_covariance(SAMPLED))[[0, -1]].tolist(),
            strict=True,
        )
    ]
    figure = Figure(figsize=(6.8, 4.4), layout="constrained")
    axes = figure.subplots()
    for at, name in ((0, "smallest"), (-1, "largest")):
        values = [published[dt][at] for dt in STEPS]
        axes.loglog(STEPS, values, color=(RED, BLUE)[at], marker="o", label=f"published, {name} direction")
    axes.plot([SAMPLED] * 2, [sampled[0], sampled[-1]], "s", color=GREEN, label=f"sampled, {BODIES} bodies")
    axes.axhline(1.0, color=BLACK, linewidth=0.9, label="exact")
    axes.set(xlabel="time step [s]", ylabel="variance over the exact one [-]")
    axes.set_title("process noise at 10 rpm: published against exact", loc="left", fontsize="medium")
    axes.legend(frameon=False, fontsize="small")
    tidy(axes)
    table = [
        {"time_step_s": dt, "smallest": float(v[0]), "largest": float(v[-1])} for dt, v in published.items()
    ]
    return ItemResult(rows, {"process_noise": figure}, {"published_over_exact": table})


def make_discretisation() -> ItemResult:
    """Eqs 4.31 to 4.55: noise that enters once a step against noise that enters all the time, of one coordinate."""
    dt, psd, steps, bodies = 0.5, 1e-6, 20, 20_000
    generator = np.random.default_rng(55)
    exact = psd * np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
    fine = 50
    x = np.zeros((bodies, 2))
    for _ in range(fine):  # half a drift, a kick of the velocity, half a drift
        x[:, 0] += x[:, 1] * dt / fine / 2
        x[:, 1] += np.sqrt(psd * dt / fine) * generator.standard_normal(bodies)
        x[:, 0] += x[:, 1] * dt / fine / 2
    sampled = x.T @ x / bodies
    once = psd * np.array([[0.0, 0.0], [0.0, dt]])
    phi = np.array([[1.0, dt], [0.0, 1.0]])
    grown = {"exact": np.zeros((2, 2)), "once a step": np.zeros((2, 2))}
    courses: dict[str, list[float]] = {name: [] for name in grown}
    for _ in range(steps):
        for name, entry in (("exact", exact), ("once a step", once)):
            grown[name] = phi @ grown[name] @ phi.T + entry
            courses[name].append(float(np.sqrt(grown[name][0, 0])))
    limit = (steps - 1) * (2 * steps - 1) / (2 * steps**2)
    rows = [
        ComparedNumber(
            "sampled position variance of a step over dt^3/3 q",
            float(sampled[0, 0] / exact[0, 0]),
            expected=(0.96, 1.04),
            why=f"the sample's deviation is {np.sqrt(2 / bodies):.2g}, and this is more than four times that",
        ),
        ComparedNumber(
            "noise once a step (Eq. 4.36), which adds to the velocity alone: position variance of a step over the exact one",
            (courses["once a step"][0] / courses["exact"][0]) ** 2,
            expected=(0.0, 0.0),
        ),
        ComparedNumber(
            f"the same after {steps} steps, where sums of squares give (n - 1)(2 n - 1) / (2 n^2)",
            float(grown["once a step"][0, 0] / grown["exact"][0, 0]),
            expected=(limit - 1e-9, limit + 1e-9),
        ),
    ]
    figure = Figure(figsize=(6.4, 4.2), layout="constrained")
    axes = figure.subplots()
    time = dt * (1 + np.arange(steps))
    for (name, values), colour in zip(courses.items(), (BLACK, RED), strict=True):
        axes.loglog(time, 1e3 * np.maximum(values, 1e-9), color=colour, marker=".", label=name)
    axes.set(xlabel="time [s]", ylabel="deviation of the position [mm]", ylim=(1e-2, None))
    axes.set_title("a point mass under white force: two discretisations", loc="left", fontsize="medium")
    axes.legend(frameon=False)
    tidy(axes)
    return ItemResult(rows, {"discretisation": figure})


def make_charts() -> ItemResult:
    """Eqs 4.89 to 4.99: which beliefs of each parametrisation are bodies, and what the print slips in."""
    generator = np.random.default_rng(92)
    std, count = 0.2, 20_000
    p = aghili_parameters(MOMENTS) + std * generator.standard_normal((count, 3))
    k = np.log(MOMENTS[:2] / MOMENTS[1:]) + std * generator.standard_normal((count, 2))
    q = generator.standard_normal((count, 4))
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    x, y, z, w = (q[:, i] for i in range(4))
    printed = np.stack([2 * (x * z + y * w), 2 * (y * z + x * w), w**2 - x**2 - y**2 - z**2], axis=1)
    column = np.stack([2 * (x * z + y * w), 2 * (y * z - x * w), w**2 - x**2 - y**2 + z**2], axis=1)
    start = aghili_parameters(MOMENTS)
    rows = [
        ComparedNumber(
            "Eq. 4.92 at the thesis' body",
            float(aghili_constraint(start)),
            expected=(-1e-12, 1e-12),
        ),
        ComparedNumber(
            f"Aghili's three numbers with deviation {std}: share of beliefs that keep the constraint within 0.01",
            float((np.abs(aghili_constraint(p)) < 0.01).mean()),
            expected=(0.0, 0.1),
        ),
        ComparedNumber(
            f"Aghili's with deviation {std}: share that are bodies",
            float(is_body(moments_from_aghili(p)).mean()),
            expected=(0.9, 1.0),
        ),
        ComparedNumber(
            f"ratios k1, k2 with deviation {std}: share that are bodies",
            float(is_body(moments_from_log_ratios(k)).mean()),
            expected=(0.9, 1.0),
        ),
        ComparedNumber(
            "ratios k1, k2 with the thesis' prior deviation 3 (section 6.4): share that are bodies",
            float(is_body(moments_from_log_ratios(3.0 * generator.standard_normal((count, 2)))).mean()),
            expected=(0.0, 0.5),
        ),
        ComparedNumber(
            "Lichter's: share of quaternions that are bodies",
            float(is_body(moments_from_lichter(q)).mean()),
            expected=(0.99, 1.0),
        ),
        ComparedNumber(
            "I_zz of the quaternion (0, 0, 0, 1)",
            float(moments_from_lichter(quaternion_from_rotation_vector(np.zeros(3)))[2]),
            expected=(0.0, 0.0),
        ),
        ComparedNumber(
            "Eq. 4.96 as printed: root mean square length of z, a column of a rotation",
            root_mean_square(printed),
            expected=(1.0 - 1e-9, 1.0 + 1e-9),
            why="a slip in print: the third column of a rotation has 2(q2 q3 - q1 q0) and q0^2 - q1^2 - q2^2 + q3^2, and "
            f"its length is then {root_mean_square(column):.12g}",
        ),
    ]
    own = moments_from_log_ratios(k)
    figure = Figure(figsize=(10.0, 4.4), layout="constrained")
    for axes, moments, name in zip(
        figure.subplots(1, 2),
        (moments_from_aghili(p), own),
        ("Aghili's numbers, Gaussian", "ratios k1, k2, Gaussian"),
        strict=True,
    ):
        good = is_body(moments)
        ratio = moments / moments[:, 1:2]
        axes.plot(*ratio[good][:3000, ::2].T, ".", color=BLUE, markersize=2, label="a body")
        axes.plot(*ratio[~good][:3000, ::2].T, ".", color=RED, markersize=2, label="none")
        axes.plot(MOMENTS[0], MOMENTS[2], "+", color=BLACK, markersize=12, label="truth")
        axes.set(xlabel="Jxx / Jyy", ylabel="Jzz / Jyy", xlim=(0, 2.2), ylim=(0, 2.2))
        axes.set_title(name, loc="left", fontsize="medium")
        axes.legend(frameon=False, fontsize="small")
        tidy(axes)
    note = (
        "Section 4.7.2 judges the parametrisations by words; here by the share of Gaussian beliefs that are bodies. The package "
        "estimates second moments, whose every value is a body."
    )
    return ItemResult(rows, {"charts": figure}, note=note)


NOISE_AND_CHARTS: Final[tuple[Item, ...]] = (
    tweddle_item(
        "Equation 4.55",
        "with 4.31 to 4.54, section 4.3",
        "Noise once a step, or all the time",
        make_discretisation,
    ),
    tweddle_item(
        "Equation 4.92", "with 4.89 to 4.99, section 4.7", "Parametrisations of the inertia", make_charts
    ),
    tweddle_item(
        "Equation 4.107",
        "with Equation 4.80, section 4.8",
        "Published process noise against the exact one",
        make_process_noise,
        1.0,
    ),
)
