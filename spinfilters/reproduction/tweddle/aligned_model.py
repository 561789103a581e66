"""Figure 6-22: the dense model aligned to a known shape, which gives its inertia in the axes of that (Eqs 6.21 to 6.27)."""

import math
from functools import partial
from typing import Final

import numpy as np
from jaxtyping import Float

from spinfilters.core.attitude_conversions import matrix_from_rotation_vector
from spinfilters.evaluation.reference_fit import axis_and_angle
from spinfilters.lidar.mesh import TriangleMesh
from spinfilters.lidar.registration import registered
from spinfilters.lidar.shape_alignment import facet_cloud, surface_cloud
from spinfilters.plots.reference_figures import slices_figure
from spinfilters.reproduction.item import ComparedNumber, Item, ItemResult, tweddle_item
from spinfilters.reproduction.tweddle.rendered_recording import (
    FEW_PAIRS,
    PAIRS,
    RENDERED,
    RenderedRecording,
    rendered_recording,
)
from spinfilters.reproduction.tweddle.simulated_recording import bound_cell

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
