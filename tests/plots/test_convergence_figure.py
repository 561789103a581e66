"""The picture of convergence: errors and standard deviations on one scale of colours, blank where nothing was estimated."""

from dataclasses import replace
from io import BytesIO

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.collections import QuadMesh

from spinfilters.plots.convergence import Convergence, ConvergingQuantity, convergence_figure
from tests.plots.run_samples import FRAMES, MOMENTS, full_runs

BODIES = full_runs().with_truth[0].bodies
DETERMINED = 7
"""The first solve that is trusted."""
SHRINKING = np.where(np.tri(FRAMES) > 0, 1.0 / (1.0 + np.arange(FRAMES))[:, np.newaxis], np.nan)


def found(known: bool) -> Convergence:
    """Two quantities that settle as one over the number of the solve."""
    quantities = [
        ConvergingQuantity(name, "mm", 2.0 * SHRINKING, SHRINKING) for name in ("position", "velocity")
    ]
    ratios = np.log([MOMENTS[2] / MOMENTS[1], MOMENTS[1] / MOMENTS[0]]) if known else None
    trusted, centre = np.arange(FRAMES) >= DETERMINED, np.zeros(3) if known else None
    return Convergence(BODIES.time, quantities, BODIES, trusted, known, ratios, centre)


def meshes(axes: Axes) -> list[QuadMesh]:
    """Surfaces in a panel."""
    return [each for each in axes.collections if isinstance(each, QuadMesh)]


@pytest.mark.parametrize("known", [True, False])
def test_error_and_deviation_share_colours_and_are_blank_above_the_diagonal(known: bool) -> None:
    figure = convergence_figure(found(known))
    figure.savefig(BytesIO(), dpi=40)
    surfaces = [mesh for axes in figure.axes if axes.get_title(loc="left") for mesh in meshes(axes)]
    assert len(surfaces) == 4
    for error, std in (surfaces[:2], surfaces[2:]):
        assert (error.norm.vmin, error.norm.vmax) == (std.norm.vmin, std.norm.vmax)
        for mesh in (error, std):
            values = np.ma.asarray(mesh.get_array()).reshape(FRAMES, FRAMES)
            assert (np.ma.getmaskarray(values) == np.isnan(SHRINKING).T).all()
    titles = " ".join(axes.get_title(loc="left") for axes in figure.axes)
    assert ("error" in titles) == known


def _hatched(shown: Convergence) -> list[list[tuple[float, float]]]:
    """Where each panel is hatched, in numbers of solves."""
    panels = [axes for axes in convergence_figure(shown).axes if axes.get_title(loc="left")]
    spans = [[each for each in axes.patches if each.get_hatch()] for axes in panels]
    return [[(each.get_x(), each.get_x() + each.get_width()) for each in span] for span in spans]  # pyright: ignore[reportAttributeAccessIssue]


def test_solves_that_are_not_trusted_are_hatched_in_every_panel() -> None:
    shown = found(True)
    hatched = _hatched(shown)
    assert len(hatched) == 9
    assert all(spans == [(0.5, DETERMINED + 0.5)] for spans in hatched)
    assert not any(_hatched(replace(shown, trusted=np.ones(FRAMES, dtype=bool))))


def test_first_solves_that_know_nothing_do_not_flatten_the_panel_of_the_inertia() -> None:
    std = BODIES.log_ratios_std.copy()
    std[:5] = 1e3
    figure = convergence_figure(replace(found(True), bodies=replace(BODIES, log_ratios_std=std)))
    (panel,) = (axes for axes in figure.axes if "k1" in axes.get_title(loc="left"))
    assert np.ptp(panel.get_ylim()) < 5.0


def test_surfaces_of_nothing_but_zeros_are_drawn() -> None:
    nothing = ConvergingQuantity("position", "mm", 0.0 * SHRINKING, 0.0 * SHRINKING)
    assert _drawn(replace(found(False), quantities=[nothing])) > 1000


def test_solves_that_determine_nothing_leave_gaps() -> None:
    std, surface = BODIES.log_ratios_std.copy(), SHRINKING.copy()
    std[:20], surface[:20] = np.nan, np.nan
    bodies = replace(BODIES, log_ratios_std=std)
    shown = replace(
        found(True), quantities=[ConvergingQuantity("position", "mm", SHRINKING, surface)], bodies=bodies
    )
    assert _drawn(shown) > 1000
    nothing = replace(bodies, log_ratios_std=np.full_like(std, np.nan))
    assert _drawn(replace(shown, bodies=nothing, true_ratios=None)) > 1000


def _drawn(shown: Convergence) -> int:
    """Bytes of its picture."""
    file = BytesIO()
    convergence_figure(shown).savefig(file, dpi=40)
    return file.tell()
