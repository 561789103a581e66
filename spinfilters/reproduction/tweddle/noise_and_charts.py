"""Chapters 3 and 4: what three rates determine of the principal moments, discrete process noise, parametrisations of the inertia.

Equations 3.11 to 3.15 are of section 3.3 and Listing B.3. Equations 4.55, 4.92 and 4.107 are exact and as published. Figures 4-6 to
4-8 show the noise of a double integrator over the time step and the unit of velocity, and its condition number (section 4.9).
"""

import math
from functools import cache
from typing import Final

import casadi as ca
import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.linalg import eigh, expm

from observability import analyse
from observability.conditioning import (
    best_time_step,
    best_velocity_unit,
    condition_number,
    double_integrator_covariance,
)
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
from spinfilters.plots.observability_figures import TIME_STEPS
from spinfilters.plots.style import BLACK, BLUE, GREEN, ORANGE, RED, SKY, tidy
from spinfilters.reproduction.item import ComparedNumber, Item, ItemResult, tweddle_item
from spinfilters.simulation.scenario import simulate_motion

EULER: Final = {
    "states": ["wx", "wy", "wz"],
    "parameters": ["Jx", "Jy", "Jz"],
    "equations": {
        "wx": "(Jy - Jz)/Jx*wy*wz",
        "wy": "(Jz - Jx)/Jy*wx*wz",
        "wz": "(Jx - Jy)/Jz*wy*wx",
    },
    "outputs": {"x": "wx", "y": "wy", "z": "wz"},
}
"""Eqs 3.8 to 3.13."""
PRINTED_NULL: Final = np.array([-7.0 / 4.0, -6.0 / 4.0, 1.0])
"""Eq. 3.15 at the generic moments."""
GENERIC: Final = {"wx": 2, "wy": 3, "wz": 5, "Jx": 7, "Jy": 6, "Jz": 4}


def moment_gradients() -> Float[np.ndarray, "3 3"]:
    """Gradients of the rates' derivatives (Eq. 3.14) by the moments at the generic point; those by the rates do not meet them."""
    w, J = ca.SX.sym("w", 3), ca.SX.sym("J", 3)
    gradients = ca.jacobian(ca.cross(J * w, w) / J, J)  # J w' = (J w) x w
    return np.array(ca.Function("gradients", [w, J], [gradients])([2.0, 3.0, 5.0], [7.0, 6.0, 4.0]))


def _null_vector_figure(found: Float[np.ndarray, "3"]) -> Figure:
    """Entries of the null vector, printed and ours."""
    figure = Figure(figsize=(6.0, 3.6), layout="constrained")
    axes = figure.subplots()
    places = np.arange(3)
    axes.bar(places - 0.18, PRINTED_NULL, 0.34, color=ORANGE, label="printed")
    axes.bar(places + 0.18, found, 0.34, color=BLUE, label="ours")
    axes.axhline(0.0, color=BLACK, linewidth=0.8)
    axes.set_xticks(places, ["Jx", "Jy", "Jz"])
    axes.set_ylabel("entry over that of Jz [-]")
    axes.set_title("null vector of the observability matrix, J = (7, 6, 4)", loc="left", fontsize="medium")
    axes.legend(frameon=False)
    tidy(axes)
    return figure


def make_rank() -> ItemResult:
    """Rank, order and null vector, and the special cases of the text."""
    found = analyse(EULER, name="Euler's equations")
    special = {
        "equal moments": GENERIC | {"Jx": 5, "Jy": 5, "Jz": 5},
        "spin about one principal axis": GENERIC | {"wx": 0, "wy": 0},
    }
    ranks = {name: analyse(EULER, name=name, at=point).rank for name, point in special.items()}
    is_scale = [str(each) for each in found.symmetries] == ["Jx -> e^ε Jx, Jy -> e^ε Jy, Jz -> e^ε Jz"]
    gradients = moment_gradients()
    null_vector = np.linalg.svd(gradients)[2][-1]
    null_vector = null_vector / null_vector[2]
    own_residual, printed_residual = (
        float(np.linalg.norm(gradients @ each)) for each in (null_vector, PRINTED_NULL)
    )
    entries = [
        ComparedNumber(
            f"null vector at w = (2, 3, 5), J = (7, 6, 4): entry of J{axis}",
            float(ours),
            printed=printed,
            tolerance=1e-9,
            why=f"a slip in print: its sign. The gradients times the printed vector give {printed_residual:.2g}, times ours "
            f"{own_residual:.1g}",
        )
        for axis, ours, printed in zip("xyz", null_vector, PRINTED_NULL, strict=True)
    ]
    numbers = [
        ComparedNumber("variables", float(found.dimension), printed=6.0),
        ComparedNumber("rank of O", float(found.rank), printed=5.0),
        ComparedNumber("highest order of Lie derivatives needed", float(found.order), printed=1.0),
        ComparedNumber(
            "the free direction scales all three moments alike", float(is_scale), expected=(1.0, 1.0)
        ),
        *entries,
        ComparedNumber(
            "rank with equal moments: said to be less",
            float(ranks["equal moments"]),
            expected=(0.0, 4.0),
            why=f"with rates about all three axes the rank is {ranks['equal moments']} of {found.dimension}, and only the scale "
            "stays open: another ratio would bend the motion",
        ),
        ComparedNumber(
            "rank in a spin about one principal axis: less than 5",
            float(ranks["spin about one principal axis"]),
            expected=(0.0, 4.0),
        ),
    ]
    return ItemResult(
        numbers,
        {"null-vector": _null_vector_figure(null_vector)},
        tables={
            "answer": [
                {"line": number, "text": line} for number, line in enumerate(str(found).splitlines(), 1)
            ]
        },
        note="The print has minus signs before the first two entries of Eq. 3.15; the null vector is +(Jx, Jy, Jz)/Jz. The "
        "second row of Eq. 3.14 repeats the gradient of L^0; the gradient of L^1 is meant.",
    )


INERTIA_OBSERVABILITY: Final = tweddle_item(
    "Equation 3.15", "section 3.3", "Rank and null vector of Euler's equations", make_rank, 1.0
)


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


ALPHAS: Final = (0.1, 1.0, 10.0)
SLIP: Final[str] = (
    "The text writes dt = alpha sqrt(3) for the best time step; with Eq. 4.118 it is dt = sqrt(3) / alpha, so that both examples "
    "are inverted."
)
DAY, HOUR = 86_400.0, 3_600.0


def make_condition_numbers() -> ItemResult:
    """Figure 4-6: the condition number has its minimum at sqrt(3) s."""
    steps = np.geomspace(0.1, 30.0, 20_001)
    numbers = np.array([condition_number(double_integrator_covariance(float(dt))) for dt in steps])
    best = float(steps[np.argmin(numbers)])
    rows = [
        ComparedNumber("best time step", best, printed=math.sqrt(3.0), unit="s", tolerance=2e-3),
        ComparedNumber("condition number there", float(numbers.min()), printed=13.9, tolerance=0.05),
        ComparedNumber(
            "condition number at 0.1 s over that",
            float(numbers[0] / numbers.min()),
            expected=(10.0, math.inf),
        ),
        ComparedNumber(
            "condition number at 30 s over that",
            float(numbers[-1] / numbers.min()),
            expected=(10.0, math.inf),
        ),
    ]
    figure, axes = _panel("time step [s]", "condition number [-]", "condition number of the discrete noise")
    axes.loglog(steps, numbers, color=BLUE)
    axes.plot(best, numbers.min(), "o", color=RED, label=f"least: {numbers.min():.1f} at {best:.3f} s")
    axes.legend(frameon=False)
    table = [
        {"time_step_s": float(dt), "condition_number": float(n)}
        for dt, n in zip(steps[::50], numbers[::50], strict=True)
    ]
    return ItemResult(rows, {"conditioning": figure}, {"condition_numbers": table})


def make_uncertainty_ellipses() -> ItemResult:
    """Figure 4-7: the ellipse is upright at small steps and lies down at large ones; 45 degrees at the best one with alpha = 1."""
    rows = [
        ComparedNumber(
            "angle of the long axis from position, 0.1 s", _long_axis(0.1), expected=(80.0, 90.0), unit="deg"
        ),
        ComparedNumber(
            "angle of the long axis at sqrt(3) s",
            _long_axis(math.sqrt(3.0)),
            printed=45.0,
            unit="deg",
            tolerance=1e-6,
        ),
        ComparedNumber("angle of the long axis, 10 s", _long_axis(10.0), expected=(0.0, 15.0), unit="deg"),
    ]
    table = [{"time_step_s": float(dt), "long_axis_deg": _long_axis(float(dt))} for dt in TIME_STEPS]
    figure, axes = _panel(
        "position [-]", "velocity [-]", "ellipses of one deviation, over the largest of each"
    )
    angle = np.linspace(0.0, 2.0 * math.pi, 200)
    circle = np.stack([np.cos(angle), np.sin(angle)])
    for dt, colour in zip(
        (0.1, 0.5, math.sqrt(3.0), 4.0, 10.0), (SKY, BLUE, BLACK, ORANGE, RED), strict=True
    ):
        values, vectors = np.linalg.eigh(double_integrator_covariance(dt))
        ellipse = vectors @ (np.sqrt(values)[:, np.newaxis] * circle) / math.sqrt(values[-1])
        axes.plot(*ellipse, color=colour, label=f"{dt:.3g} s: {_long_axis(dt):.0f} deg")
    axes.set(aspect="equal", xlim=(-1.1, 1.1), ylim=(-1.1, 1.1))
    axes.legend(frameon=False, loc="center left", bbox_to_anchor=(1.0, 0.5))
    return ItemResult(
        rows, {"conditioning": figure}, {"ellipses": table}, "The 45 degrees hold for alpha = 1 alone."
    )


def make_velocity_units() -> ItemResult:
    """Figure 4-8 and both examples: the minimum moves with the unit of velocity, its height does not."""
    rows = []
    for alpha in ALPHAS:
        dt = best_time_step(alpha)
        least = condition_number(double_integrator_covariance(dt, alpha))
        rows.append(
            ComparedNumber(
                f"condition number at sqrt(3) / alpha, alpha = {alpha:g} 1/s",
                least,
                printed=13.9,
                tolerance=0.05,
            )
        )
    rows += [
        ComparedNumber(
            "example of a car: millimetres a day as alpha",
            1e-3 / DAY,
            printed=1e-9,
            unit="m/s",
            tolerance=5e-10,
            why="a millimetre a day is 1.16e-8 m/s",
        ),
        ComparedNumber(
            "example of a car: its best time step",
            best_time_step(1e-9),
            printed=11e-9,
            unit="s",
            tolerance=5e-10,
            why=f"{SLIP} Neither form gives 11 ns from 1e-9.",
        ),
        ComparedNumber(
            "alpha for a time step of an hour",
            best_velocity_unit(HOUR),
            printed=2078.0,
            unit="m/s",
            tolerance=0.5,
            why=f"{SLIP} The printed form gives {HOUR / math.sqrt(3.0):.0f}, ours {math.sqrt(3.0) / HOUR:.2g}.",
        ),
        ComparedNumber(
            "alpha of the printed formula for an hour, dt / sqrt(3)",
            HOUR / math.sqrt(3.0),
            printed=2078.0,
            tolerance=0.5,
        ),
    ]
    figure, axes = _panel(
        "time step [s]", "alpha, unit of length of the velocity [-]", "logarithm of the condition number"
    )
    steps, units = np.geomspace(1e-2, 1e2, 121), np.geomspace(1e-2, 1e2, 121)
    height = [
        [math.log10(condition_number(double_integrator_covariance(float(dt), float(a)))) for dt in steps]
        for a in units
    ]
    filled = axes.contourf(steps, units, np.array(height), levels=20, cmap="viridis")
    figure.colorbar(filled, ax=axes)
    axes.loglog(steps, math.sqrt(3.0) / steps, color=RED, label="least: dt = sqrt(3) / alpha")
    axes.set(xlim=(1e-2, 1e2), ylim=(1e-2, 1e2))
    axes.legend(loc="lower left")
    return ItemResult(rows, {"conditioning": figure}, note=SLIP)


def _panel(across: str, up: str, title: str) -> tuple[Figure, Axes]:
    """A figure of one panel."""
    figure = Figure(figsize=(6.4, 4.6), layout="constrained")
    axes = figure.subplots()
    axes.set(xlabel=across, ylabel=up)
    axes.set_title(title, loc="left", fontsize="medium")
    tidy(axes)
    return figure, axes


def _long_axis(dt: float) -> float:
    """Angle from the position axis to the long axis of the covariance, deg in [0, 90]."""
    _, vectors = np.linalg.eigh(double_integrator_covariance(dt))
    return math.degrees(math.atan2(abs(vectors[1, 1]), abs(vectors[0, 1])))


CONDITIONING: Final = (
    tweddle_item(
        "Figure 4-6",
        "section 4.9",
        "Condition number over the time step",
        make_condition_numbers,
    ),
    tweddle_item(
        "Figure 4-7",
        "section 4.9",
        "Uncertainty ellipses over the time step",
        make_uncertainty_ellipses,
    ),
    tweddle_item(
        "Figure 4-8",
        "section 4.9",
        "Condition number over time step and unit",
        make_velocity_units,
    ),
)
