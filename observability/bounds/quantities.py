"""The bound of what people ask for: place of the centre of mass, inertia ratios, and the rest block by block."""

from functools import cache

import casadi as ca
import numpy as np
from jaxtyping import Float

from observability.bounds.cramer_rao import Bound
from observability.bounds.flight import Flight
from spinfilters.attitude.expressions import rotate
from spinfilters.dynamics.mass_distribution import inertia, inertia_matrix
from spinfilters.state.layout import StateLayout
from spinfilters.symbolic import Compiled

BLOCK_NAMES = {
    "a": ("attitude", "rad"),
    "v": ("velocity", "m/s"),
    "w": ("body rate", "rad/s"),
    "c": ("centre of mass in g", "m"),
}
WEAK_NAMES = {name: words for name, (words, _) in BLOCK_NAMES.items()} | {"s": "mass distribution"}
PLACE, MOMENTS = ("place of the centre of mass", "m"), ("inertia ratios", "1")


def bounded_quantities(bound: Bound, flight: Flight) -> dict[tuple[str, str], Float[np.ndarray, " frames"]]:
    """Standard deviations (root mean square over components) of every quantity and frame, by (name, unit)."""
    layout, found = bound.layout, {}
    ratios = np.zeros((2, layout.error_dim))
    ratios[:, layout.slice("s")] = ratio_slopes(flight.states[0][layout.mean_slice("s")])  # s is a constant
    slopes = [{**_slopes(layout, x), MOMENTS: ratios} for x in flight.states]
    for name in slopes[0]:
        roots = [
            np.sqrt(np.trace(slope[name] @ covariance @ slope[name].T) / len(slope[name]))
            for slope, covariance in zip(slopes, bound.covariances, strict=True)
        ]
        found[name] = np.array(roots)
    return found


def weak_direction_in_words(bound: Bound) -> str:
    """The components that make up nearly all of the least known direction, and what remains of the prior along it."""
    direction, remains = bound.weak_direction
    order = np.argsort(-np.abs(direction))
    count = int(np.searchsorted(np.cumsum(direction[order] ** 2), 0.95)) + 1
    names = _component_names(bound.layout)
    parts = " ".join(f"{direction[k]:+.2f} {names[k]}" for k in order[:count])
    blocks = dict.fromkeys(names[k][0] for k in order[:count])
    meaning = ", ".join(f"{block}: {WEAK_NAMES[block]}" for block in blocks)
    return f"{parts} in prior deviations ({meaning}); {100 * remains:.3g} % of the prior's deviation remains"


def _component_names(layout: StateLayout) -> list[str]:
    sizes = [(block, layout.slice(block)) for block in layout.blocks]
    return [f"{block}_{k + 1}" for block, where in sizes for k in range(where.stop - where.start)]


def _slopes(
    layout: StateLayout, x: Float[np.ndarray, " m"]
) -> dict[tuple[str, str], Float[np.ndarray, "k e"]]:
    """Derivatives by the error of the state of all quantities that are no constants, and of blocks."""
    eye = np.eye(layout.error_dim)
    slopes = {
        quantity: eye[layout.slice(block)]
        for block, quantity in BLOCK_NAMES.items()
        if block in layout.blocks
    }
    if "t" in layout.blocks:
        slopes[PLACE] = _place(layout)(x)[0]
    return slopes


def ratio_slopes(s: Float[np.ndarray, " 5"]) -> Float[np.ndarray, "2 5"]:
    """Derivatives of J1/J3 and J2/J3 (moments ascending) by the error of the mass distribution."""
    moments, axes = np.linalg.eigh(inertia_matrix(s))
    changes = _inertia_slopes()(s)[0].reshape(3, 3, 5)
    along = np.einsum("ik,ijd,jk->kd", axes, changes, axes)
    return (along[:2] - np.outer(moments[:2] / moments[2], along[2])) / moments[2]


@cache
def _place(layout: StateLayout) -> Compiled:
    x, d = ca.SX.sym("x", layout.mean_dim), ca.SX.sym("d", layout.error_dim)
    values = layout.unpack(layout.retract_expression(x, d))
    slope = ca.jacobian(values["t"] + rotate(values["q"], values["c"]), d)
    return Compiled.interpreted(ca.Function("place", [x], [ca.substitute(slope, d, ca.SX.zeros(*d.shape))]))


@cache
def _inertia_slopes() -> Compiled:
    """s -> derivatives of J, flattened, by the multiplicative error."""
    layout = StateLayout(("a", "w", "s"))
    x, d = ca.SX.sym("x", layout.mean_dim), ca.SX.sym("d", layout.error_dim)
    moved = layout.unpack(layout.retract_expression(x, d))["s"]
    slope = ca.jacobian(ca.vec(inertia(moved)), d)[:, layout.slice("s")]
    at = ca.substitute(slope, d, ca.SX.zeros(*d.shape))
    s = ca.SX.sym("s", 5)
    point = ca.vertcat(ca.SX([0, 0, 0, 1, 0, 0, 0]), s)
    return Compiled.interpreted(ca.Function("inertia_slopes", [s], [ca.substitute(at, x, point)]))
