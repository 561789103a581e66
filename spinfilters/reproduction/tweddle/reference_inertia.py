"""Eslinger's inertia of the target and the estimated one: Equations 6.1 to 6.6 and 6.16 to 6.27 (sections 6.2.2 and 6.5.2).

Figure 6-22 aligns the dense model to a known shape, which gives the inertia in the axes of that (Eqs 6.21 to 6.27).
"""

import math
from functools import partial
from typing import Final

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from spinfilters.core.attitude_conversions import (
    matrix_from_quaternion,
    matrix_from_rotation_vector,
    quaternion_from_axis_angle,
)
from spinfilters.evaluation.reference_fit import axis_and_angle
from spinfilters.lidar.mesh import TriangleMesh
from spinfilters.lidar.registration import registered
from spinfilters.lidar.shape_alignment import facet_cloud, surface_cloud
from spinfilters.plots.reference_figures import slices_figure
from spinfilters.plots.style import AXIS_COLOURS, BLACK, BLUE, GREY, ORANGE, RED, tidy
from spinfilters.reproduction.item import ComparedNumber, Item, ItemResult, tweddle_item
from spinfilters.reproduction.tweddle.replaced_recordings import (
    FEW_PAIRS,
    PAIRS,
    RENDERED,
    RenderedRecording,
    bound_cell,
    rendered_recording,
)

ESLINGER: Final = np.array(
    [
        [2.41e-2, -1.30e-4, -1.42e-4],
        [-1.30e-4, 2.34e-2, 5.74e-5],
        [-1.42e-4, 5.74e-5, 2.01e-2],
    ]
)
"""Eq. 6.1, kg m^2, in the geometric axes of the target."""
K1, K2 = 0.0517, 0.0971
"""Eqs 6.16 and 6.17: logarithms of the estimated ratios."""
AXIS_TURN: Final = math.radians(9.094)
"""Eq. 6.25: from the estimated principal axes to the geometric ones, about y."""
SCALE: Final = 2.34e-2
RATE: Final = np.array([0.5, 10.0, 0.5])
"""rpm, commanded in section 6.2.1, geometric axes."""
PRINTED_MOMENTS: Final = (0.0241, 0.0234, 0.0201)
"""Eq. 6.3, kg m^2."""
PRINTED_AXES: Final = (
    (0.9833, 0.1787, 0.0349),
    (-0.1783, 0.9838, -0.0160),
    (-0.0372, 0.0095, 0.9993),
)
"""Eq. 6.4."""


def principal_axes(J: Float[np.ndarray, "3 3"]) -> tuple[Float[np.ndarray, " 3"], Float[np.ndarray, "3 3"]]:
    """Moments in descending order and R whose columns are the axes, J = R diag R', nearest to the identity."""
    values, vectors = np.linalg.eigh(J)
    vectors = vectors[:, ::-1] * np.sign(np.diag(vectors[:, ::-1]))
    return values[::-1], vectors


def estimated_inertia() -> Float[np.ndarray, "3 3"]:
    """Eq. 6.26 with its sign corrected: R diag(exp k1, 1, exp -k2) R' of the printed ratios and rotation."""
    R = matrix_from_quaternion(quaternion_from_axis_angle(np.array([0.0, 1.0, 0.0]), AXIS_TURN))
    return R @ np.diag([math.exp(K1), 1.0, math.exp(-K2)]) @ R.T


def make_reference_axes() -> ItemResult:
    """Moments, axes and angle of Eslinger's inertia."""
    moments, R = principal_axes(ESLINGER)
    axis, angle = axis_and_angle(R)
    if axis[2] < 0:
        axis, angle = -axis, -angle
    rows = [
        *(
            ComparedNumber(
                f"principal moment {k + 1}",
                float(moments[k]),
                printed=printed,
                unit="kg m^2",
                tolerance=0.5e-4,
            )
            for k, printed in enumerate(PRINTED_MOMENTS)
        ),
        *(
            ComparedNumber(
                f"axes, row {i + 1}, column {j + 1}",
                float(R[i, j]),
                printed=PRINTED_AXES[i][j],
                tolerance=0.5e-4,
            )
            for i in range(3)
            for j in range(3)
        ),
        *(
            ComparedNumber(f"axis of the rotation, {name}", float(axis[k]), printed=printed, tolerance=0.5e-4)
            for k, (name, printed) in enumerate(zip("xyz", (-0.0697, -0.1975, 0.9778), strict=True))
        ),
        ComparedNumber(
            "angle of the rotation", math.degrees(abs(angle)), printed=10.52, unit="deg", tolerance=0.005
        ),
    ]
    return ItemResult(
        rows,
        {"axes": _axes_figure(moments, R)},
        note="The printed axis with a positive angle is that of the transposed matrix: the rotation is by -10.52 deg about it, as "
        "the text says. The entries of Eq. 6.9 are illegible and are not compared.",
    )


def make_ratios() -> ItemResult:
    """Estimated moments by their ratios, and those of the reference."""
    moments, _ = principal_axes(ESLINGER)
    rows = [
        ComparedNumber("J1 / J2 of k1", math.exp(K1), printed=1.0530, tolerance=1e-4),
        ComparedNumber("J3 / J2 of k2", math.exp(-K2), printed=0.9074, tolerance=1e-4),
        ComparedNumber(
            "J1 / J2 of Eq. 6.1", float(moments[0] / moments[1]), printed=1.0322, tolerance=0.5e-4
        ),
        ComparedNumber(
            "J3 / J2 of Eq. 6.1", float(moments[2] / moments[1]), printed=0.8596, tolerance=0.5e-4
        ),
    ]
    return ItemResult(
        rows,
        {"ratios": _ratios_figure(moments)},
        note="k1 and k2 are rounded in print: with the half unit of both, Eq. 6.19 is compared to one unit of its last digit.",
    )


def make_geometric_inertia() -> ItemResult:
    """The estimated inertia in the geometric axes, and scaled."""
    J = estimated_inertia()
    slip = "The printed off-diagonal entries have the wrong sign: R J R' with the printed R of Eq. 6.22 gives -0.0227."
    rows = [
        ComparedNumber("J xx", float(J[0, 0]), printed=1.0494, tolerance=0.5e-4),
        ComparedNumber("J zz", float(J[2, 2]), printed=0.9110, tolerance=1.5e-4),
        ComparedNumber("J xz", float(J[0, 2]), printed=0.0227, tolerance=0.5e-4, why=slip),
        ComparedNumber("J xz, size", abs(float(J[0, 2])), printed=0.0227, tolerance=0.5e-4),
        ComparedNumber("s J xx", SCALE * float(J[0, 0]), printed=2.46e-2, unit="kg m^2", tolerance=0.5e-4),
        ComparedNumber("s J zz", SCALE * float(J[2, 2]), printed=2.13e-2, unit="kg m^2", tolerance=0.5e-4),
        ComparedNumber(
            "s J xz, size", SCALE * abs(float(J[0, 2])), printed=5.31e-4, unit="kg m^2", tolerance=1e-6
        ),
    ]
    return ItemResult(
        rows,
        {"entries": _entries_figure(J)},
        note=f"{slip} Entries are compared within the rounding of k1, k2 and the angle too.",
    )


def _axes_figure(moments: Float[np.ndarray, "3"], R: Float[np.ndarray, "3 3"]) -> Figure:
    """Eslinger's principal axes in the geometric ones, printed and ours."""
    figure = Figure(figsize=(9.0, 3.8), layout="constrained")
    bars, panel = figure.subplots(1, 2)
    places = np.arange(3)
    bars.bar(places - 0.18, [1e3 * each for each in PRINTED_MOMENTS], 0.34, color=ORANGE, label="printed")
    bars.bar(places + 0.18, 1e3 * moments, 0.34, color=BLUE, label="ours")
    bars.set_xticks(places, ["major", "intermediate", "minor"])
    bars.set_ylabel("principal moment [g m^2]")
    bars.set_ylim(bottom=18.0)
    bars.legend(frameon=False)
    for k, colour in enumerate(AXIS_COLOURS):
        panel.annotate("", xy=R[:2, k], xytext=(0, 0), arrowprops={"arrowstyle": "->", "color": colour})
        panel.plot(*np.array(PRINTED_AXES)[:2, k], "o", color=colour, markerfacecolor="none", markersize=9)
        panel.plot([], [], color=colour, label=f"principal axis {k + 1}")
    panel.plot([], [], "o", color=BLACK, markerfacecolor="none", label="printed")
    panel.set(
        xlabel="x of the geometric axes", ylabel="y", xlim=(-0.4, 1.1), ylim=(-0.4, 1.1), aspect="equal"
    )
    panel.legend(frameon=False, fontsize="small")
    for axes, title in ((bars, "moments of Eq. 6.3"), (panel, "axes of Eq. 6.4, seen along z")):
        axes.set_title(title, loc="left", fontsize="medium")
        tidy(axes)
    return figure


def _ratios_figure(moments: Float[np.ndarray, "3"]) -> Figure:
    """Both inertias by their ratios, with the limit of rigid bodies."""
    figure = Figure(figsize=(6.0, 4.6), layout="constrained")
    axes = figure.subplots()
    low = np.linspace(0.6, 1.0, 50)
    axes.fill_between(
        1.0 + 0.0 * low + low, low, 0.55, color=GREY, alpha=0.3, label="no rigid body: J1 > J2 + J3"
    )
    axes.plot(moments[0] / moments[1], moments[2] / moments[1], "s", color=RED, label="Eslinger's (Eq. 6.1)")
    axes.plot(math.exp(K1), math.exp(-K2), "o", color=BLUE, label="estimated (Eqs 6.16 to 6.20)")
    axes.plot(1.0, 1.0, "+", color=BLACK, markersize=12, label="sphere")
    axes.set(xlabel="J1 / J2", ylabel="J3 / J2", xlim=(0.98, 1.8), ylim=(0.7, 1.05))
    axes.set_title("ratios of the principal moments", loc="left", fontsize="medium")
    axes.legend(frameon=False, fontsize="small")
    tidy(axes)
    return figure


def _entries_figure(J: Float[np.ndarray, "3 3"]) -> Figure:
    """Entries of the inertia in geometric axes over the middle moment: Eslinger's, printed, and ours."""
    figure = Figure(figsize=(6.6, 4.0), layout="constrained")
    axes = figure.subplots()
    entries = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
    places = np.arange(len(entries))
    eslinger = ESLINGER / SCALE
    for shift, colour, name, values in (
        (-0.27, RED, "Eslinger's", [eslinger[i, j] for i, j in entries]),
        (0.0, ORANGE, "estimated, printed", [1.0494, 1.0, 0.9110, 0.0, 0.0227, 0.0]),
        (0.27, BLUE, "estimated, ours", [J[i, j] for i, j in entries]),
    ):
        axes.bar(places + shift, values, 0.25, color=colour, label=name)
    axes.axhline(0.0, color=BLACK, linewidth=0.8)
    axes.set_yscale("symlog", linthresh=0.01)
    axes.set_xticks(places, [f"{'xyz'[i]}{'xyz'[j]}" for i, j in entries])
    axes.set_ylabel("entry of J over the middle moment [-]")
    axes.set_title("inertia in the geometric axes", loc="left", fontsize="medium")
    axes.legend(frameon=False, fontsize="small")
    tidy(axes)
    return figure


REFERENCE_INERTIA: Final = (
    tweddle_item(
        "Equation 6.6",
        "with 6.1 to 6.5, section 6.2.2",
        "Principal axes of Eslinger's inertia",
        make_reference_axes,
    ),
    tweddle_item("Equation 6.20", "with 6.16 to 6.19, section 6.5.2", "Ratios of the moments", make_ratios),
    tweddle_item(
        "Equation 6.27",
        "with 6.21 to 6.26, section 6.5.2",
        "Estimated inertia in geometric axes",
        make_geometric_inertia,
    ),
)


SAMPLES: Final = 20_000
"""Points of the known shape."""
BEGIN: Final = math.radians(8.0)
"""From the true rotation, about an axis at random: the thesis begins by hand."""
REACH: Final = 0.02
"""m, of matches at first."""


def make_alignment(pairs: int = PAIRS) -> ItemResult:
    """The model's vertices on the known shape, and the inertia in the axes of that."""
    found, generator = rendered_recording(pairs), np.random.default_rng(22)
    model, body = found.reconstruction.model, found.evaluation.body
    known = surface_cloud(found.mesh, SAMPLES, generator)
    source = facet_cloud(TriangleMesh(model.vertices, model.triangles))
    true = true_rotation(found)
    direction = generator.normal(size=3)
    begin = matrix_from_rotation_vector(BEGIN * direction / np.linalg.norm(direction)) @ true
    aligned = registered(source, known, begin, found.true_center, REACH)
    J = aligned.rotation @ np.diag(body.principal_moments / body.principal_moments[1]) @ aligned.rotation.T
    assert found.truth.principal_moments is not None
    moments = np.sort(found.truth.principal_moments)
    J_true = true @ np.diag(moments / moments[1]) @ true.T
    _, angle = axis_and_angle(aligned.rotation.T @ true)
    limit = found.bounded_body
    axes_bound = None if limit is None else math.degrees(math.sqrt(float(np.trace(limit.principal_axes_cov))))
    center_std = None if limit is None else limit.center_of_mass_std
    center_bound = None if center_std is None else 1e3 * float(np.linalg.norm(center_std))
    moments_bound = (
        None if limit is None else float(limit.principal_moments_std.max() / limit.principal_moments[1])
    )
    stated = math.degrees(math.sqrt(float(np.trace(body.principal_axes_cov))))
    moments_std = float(body.principal_moments_std.max() / body.principal_moments[1])
    rows = [
        ComparedNumber(
            "distance of the model from the shape, root mean square",
            1e3 * aligned.residual_std,
            expected=(0.0, 1.5),
            unit="mm",
            bound="no bound: a surface from disparities",
            why=f"a pixel of the disparity is {1e3 * _depth_of_pixel(found):.2g} mm of depth",
        ),
        ComparedNumber(
            "principal axes found by the alignment off the true ones",
            math.degrees(abs(angle)),
            expected=(0.0, 3.0),
            unit="deg",
            bound=bound_cell(axes_bound),
            why=f"axes of nearly equal moments are not certain: the smoother states {stated:.2g} deg",
        ),
        ComparedNumber(
            "centre of mass in the axes of the shape, error",
            1e3 * float(np.linalg.norm(aligned.translation - found.true_center)),
            expected=(0.0, 3.0),
            unit="mm",
            bound=bound_cell(center_bound),
            why=f"a pixel of the disparity is {1e3 * _depth_of_pixel(found):.2g} mm of depth, and windows round edges",
        ),
        ComparedNumber(
            "inertia in the axes of the shape, largest error of an entry over the middle moment",
            float(np.abs(J - J_true).max()),
            expected=(0.0, 0.03),
            bound=bound_cell(moments_bound),
            why=f"the motion determines the moments to {moments_std:.2g} only",
        ),
    ]
    note = (
        f"{RENDERED} The shape that was rendered takes the place of the satellite's drawing; printed of the thesis' own, which is "
        "lost, is a rotation by 9.094 deg about y (Eq. 6.25)."
    )
    moved = source.points @ aligned.rotation.T + aligned.translation
    return ItemResult(rows, {"alignment": slices_figure(known.points, moved)}, note=note)


def _depth_of_pixel(found: RenderedRecording) -> float:
    """Depth by which a pixel of the disparity moves a point at the distance of the body, m: z^2 / (f b)."""
    z = float(np.median(found.evaluation.trajectory.position[:, 2]))
    return z**2 / (found.rig.left.intrinsics[0] * found.rig.baseline_m)


def true_rotation(found: RenderedRecording) -> Float[np.ndarray, "3 3"]:
    """From the model's axes to those of the shape: the true principal axes in the order and with the signs of the estimated ones.

    Parameters
    ----------
    found : RenderedRecording
        With its estimate and its truth.

    Returns
    -------
    (3, 3) float array
        Rotation matrix.
    """
    truth = found.truth
    assert truth.principal_axes_g is not None
    assert truth.principal_moments is not None
    order = np.argsort(truth.principal_moments)
    signs = np.sign(
        np.einsum("ki,ki->k", truth.principal_axes_g[order], found.evaluation.body.principal_axes_g)
    )
    return (found.true_axes[order] * signs[:, np.newaxis]).T


ALIGNED_MODEL: Final[Item] = tweddle_item(
    "Figure 6-22",
    "section 6.5.2",
    "Dense model aligned to the known shape",
    make_alignment,
    5.0,
    partial(make_alignment, FEW_PAIRS),
)
