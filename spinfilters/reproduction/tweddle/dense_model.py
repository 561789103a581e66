"""Figures 6-29 and 6-30: the dense model in principal axes, and its animation beside the images (section 6.6).

The images are lost: a satellite with texture is rendered, tracked, smoothed and reconstructed by the commands' own functions.
"""

from functools import partial
from typing import Final

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d import Axes3D
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from spinfilters.lidar.mesh import TriangleMesh
from spinfilters.plots.scene import equal_scales, viewer_direction
from spinfilters.reproduction.item import ComparedNumber, Item, ItemResult, tweddle_item
from spinfilters.reproduction.tweddle.aligned_model import true_rotation
from spinfilters.reproduction.tweddle.rendered_recording import (
    FEW_PAIRS,
    PAIRS,
    RENDERED,
    rendered_recording,
)


def make_model(pairs: int = PAIRS) -> ItemResult:
    """Figure 6-29: the model from two sides, in its own grey values."""
    found = rendered_recording(pairs)
    model = found.reconstruction.model
    extents: Float[np.ndarray, " 3"] = model.dimensions.extents
    # the rendered body along the estimated axes, whose rotation to its own frame is that of the alignment
    true = np.ptp(found.mesh.vertices @ true_rotation(found), axis=0)
    area, whole = (
        float(np.linalg.norm(each.area_vectors, axis=1).sum())
        for each in (TriangleMesh(model.vertices, model.triangles), found.mesh)
    )
    rows = [
        ComparedNumber(
            f"extent along the {name} axis over the true one",
            float(extent / size),
            expected=(0.9, 1.1),
            bound="no bound: a surface from disparities",
            why=f"the model has {area / whole:.0%} of the body's surface: what no camera saw is missing",
        )
        for name, extent, size in zip(("minor", "intermediate", "major"), extents, true, strict=True)
    ]
    figure = Figure(figsize=(10.0, 5.2), layout="constrained")
    surface = TriangleMesh(model.vertices, model.triangles)
    shade = model.grey[model.triangles].mean(axis=1) / 255.0
    for number, (elevation, azimuth, title) in enumerate(
        ((20.0, -60.0, "from the front"), (20.0, 120.0, "from behind")), start=1
    ):
        axes = figure.add_subplot(1, 2, number, projection="3d")
        assert isinstance(axes, Axes3D)
        axes.view_init(elevation, azimuth)
        # the inside of what no camera closed is dark; one collection sorts all triangles by depth
        light = np.where(surface.normals @ viewer_direction(axes) > 0, 1.0, 0.25)
        grey = np.repeat(np.clip(light * shade, 0.0, 1.0)[:, np.newaxis], 3, axis=1).tolist()
        corners = (100.0 * surface.corners).tolist()
        axes.add_collection3d(Poly3DCollection(corners, facecolors=grey, edgecolors=grey, linewidths=0.3))
        axes.set(xlabel="minor [cm]", ylabel="intermediate [cm]", zlabel="major [cm]")
        equal_scales(axes, 100.0 * model.vertices)
        axes.text2D(0.08, 0.93, title, transform=axes.transAxes, fontsize="large")
    return ItemResult(rows, {"model": figure}, note=RENDERED)


def make_animation(pairs: int = PAIRS) -> ItemResult:
    """Figure 6-30: image and model at the estimated pose, at three times."""
    found = rendered_recording(pairs)
    frames = found.frames
    trajectory = found.evaluation.trajectory
    turned = float(np.degrees(np.mean(np.linalg.norm(trajectory.rate_i, axis=1)) * np.ptp(trajectory.time)))
    chosen = [frames[k] for k in np.linspace(0, len(frames) - 1, 3).astype(int)]
    likeness = []
    for frame in frames:
        width = (frame.shape[1] - 2) // 2
        image, drawn = frame[:, :width].astype(float), frame[:, -width:].astype(float)
        seen = drawn > 0
        if seen.sum() > 100:
            likeness.append(float(np.corrcoef(image[seen], drawn[seen])[0, 1]))
    rows = [
        ComparedNumber(
            "correlation of image and drawn model, median over the frames",
            float(np.median(likeness)),
            expected=(0.7, 1.0),
            bound="no estimate: pictures",
            why=f"the sun stays while the body turns by {turned:.0f} deg, and the model keeps the light that it was seen in",
        ),
        ComparedNumber("frames of the animation", float(len(frames)), expected=(3.0, np.inf)),
    ]
    figure = Figure(figsize=(8.0, 9.4), layout="constrained")
    for number, (axes, frame) in enumerate(zip(figure.subplots(3, 1), chosen, strict=True), start=1):
        axes.imshow(frame, cmap="gray", vmin=0, vmax=255)
        axes.set_title(f"left image and model, frame {number} of 3", loc="left", fontsize="medium")
        axes.set_axis_off()
    return ItemResult(rows, {"animation": figure}, note=RENDERED)


DENSE_MODEL: Final[tuple[Item, ...]] = (
    tweddle_item(
        "Figure 6-29",
        "section 6.6",
        "Dense model in principal axes",
        make_model,
        5.0,
        partial(make_model, FEW_PAIRS),
    ),
    tweddle_item(
        "Figure 6-30",
        "section 6.6",
        "Animation of the dense model",
        make_animation,
        3.0,
        partial(make_animation, FEW_PAIRS),
    ),
)
