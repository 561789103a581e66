"""Bounds of derived quantities and of blocks."""

from functools import cache

import casadi as ca
import numpy as np
from jaxtyping import Float

from observability.bounds.cramer_rao import Bound
from observability.bounds.reference_trajectory import ReferenceTrajectory
from spinfilters.attitude.expressions import rotate
from spinfilters.dynamics.mass_distribution import inertia, inertia_matrix
from spinfilters.state.layout import StateLayout
from spinfilters.symbolic.compiled import Compiled
from spinfilters.symbolic.working_time import building

BLOCK_NAMES = {
    "a": ("attitude", "rad"),
    "v": ("velocity", "m/s"),
    "w": ("body rate", "rad/s"),
    "c": ("centre of mass in g", "m"),
}
WEAK_NAMES = {name: words for name, (words, _) in BLOCK_NAMES.items()} | {"s": "mass distribution"}
PLACE, MOMENTS = ("place of the centre of mass", "m"), ("inertia ratios", "1")
EACH_MOMENT = ("each moment, relative", "1")
"""Of J_xx, J_yy, J_zz, where a known torque gives the inertia a scale."""
Quantity = tuple[str, str]
"""A name and a unit."""
COMPONENTS = {
    **{block: tuple(f"{block}_{axis}" for axis in "xyz") for block in "tavwc"},
    "s": ("s_xx", "s_yy", "s_xy", "s_xz", "s_yz"),
    "d": ("d",),
}
"""Names of the components of an error; those of the mass distribution are entries of D."""


def bounded_quantities(
    bound: Bound, reference: ReferenceTrajectory
) -> dict[Quantity, Float[np.ndarray, " frames"]]:
    """Standard deviations (root mean square over components) of every quantity and frame, by (name, unit)."""
    found = {}
    jacobian = [quantity_jacobian(bound.layout, reference, frame) for frame in range(len(reference.time))]
    for name in jacobian[0]:
        roots = [
            np.sqrt(np.trace(slope[name] @ covariance @ slope[name].T) / len(slope[name]))
            for slope, covariance in zip(jacobian, bound.covariances, strict=True)
        ]
        found[name] = np.array(roots)
    return found


def quantity_jacobian(
    layout: StateLayout, reference: ReferenceTrajectory, frame: int
) -> dict[Quantity, Float[np.ndarray, "k e"]]:
    """Derivatives of every quantity by the error of the state and the flight's constants."""
    s = reference.states[0][layout.mean_slice("s")]  # a constant
    jacobian = _jacobian(layout, reference.states[frame])
    jacobian[MOMENTS] = _by_mass(layout, ratio_jacobian(s))
    if reference.constants:
        jacobian[EACH_MOMENT] = _by_mass(layout, _moment_jacobian(s))
    padded = {name: np.pad(rows, ((0, 0), (0, reference.constants))) for name, rows in jacobian.items()}
    if reference.constants:
        padded[EACH_MOMENT][:, layout.error_dim] = 1.0
    return padded


def _by_mass(layout: StateLayout, jacobian: Float[np.ndarray, "k 5"]) -> Float[np.ndarray, "k e"]:
    rows = np.zeros((len(jacobian), layout.error_dim))
    rows[:, layout.slice("s")] = jacobian
    return rows


def weak_direction_in_words(bound: Bound) -> str:
    """Main components of the least known direction, and its share of the prior."""
    direction, remains = bound.weak_direction
    order = np.argsort(-np.abs(direction))
    count = int(np.searchsorted(np.cumsum(direction[order] ** 2), 0.95)) + 1
    names = _component_names(bound.layout)
    parts = " ".join(f"{direction[k]:+.2f} {names[k]}" for k in order[:count])
    blocks = dict.fromkeys(names[k][0] for k in order[:count])
    meaning = ", ".join(f"{block}: {WEAK_NAMES[block]}" for block in blocks)
    frame = (
        "principal axes"
        if blocks.keys() <= set("awcs")
        else "velocities in camera axes, others in principal axes"
    )
    return f"{parts} in prior deviations ({meaning}; {frame}); {100 * remains:.3g} % of the prior's deviation remains"


def _component_names(layout: StateLayout) -> list[str]:
    return [name for block in layout.blocks for name in COMPONENTS[block]]


def _jacobian(
    layout: StateLayout, x: Float[np.ndarray, " m"]
) -> dict[tuple[str, str], Float[np.ndarray, "k e"]]:
    """Jacobian of all non-constant quantities and of blocks by the state's error."""
    eye = np.eye(layout.error_dim)
    jacobian = {
        quantity: eye[layout.slice(block)]
        for block, quantity in BLOCK_NAMES.items()
        if block in layout.blocks
    }
    if layout.translates:
        jacobian[PLACE] = _place(layout)(x)[0]
    return jacobian


def ratio_jacobian(s: Float[np.ndarray, " 5"]) -> Float[np.ndarray, "2 5"]:
    """Derivatives of J1/J3 and J2/J3 (moments ascending) by the error of the mass distribution."""
    moments, axes = np.linalg.eigh(inertia_matrix(s))
    changes = _inertia_jacobian()(s)[0].reshape(3, 3, 5)
    along = np.einsum("ik,ijd,jk->kd", axes, changes, axes)
    return (along[:2] - np.outer(moments[:2] / moments[2], along[2])) / moments[2]


def _moment_jacobian(s: Float[np.ndarray, " 5"]) -> Float[np.ndarray, "3 5"]:
    """Jacobian of the logarithms of J's diagonal by the mass distribution's error."""
    changes = _inertia_jacobian()(s)[0].reshape(3, 3, 5)
    return np.einsum("iid->id", changes) / np.diag(inertia_matrix(s))[:, np.newaxis]


@cache
@building()
def _place(layout: StateLayout) -> Compiled:
    x, d = ca.SX.sym("x", layout.mean_dim), ca.SX.sym("d", layout.error_dim)
    values = layout.unpack(layout.retract_expression(x, d))
    slope = ca.jacobian(values["t"] + rotate(values["q"], values["c"]), d)
    return Compiled.interpreted(ca.Function("place", [x], [ca.substitute(slope, d, ca.SX.zeros(*d.shape))]))


@cache
@building()
def _inertia_jacobian() -> Compiled:
    """s -> derivatives of J, flattened, by the multiplicative error."""
    layout = StateLayout(("a", "w", "s"))
    x, d = ca.SX.sym("x", layout.mean_dim), ca.SX.sym("d", layout.error_dim)
    moved = layout.unpack(layout.retract_expression(x, d))["s"]
    slope = ca.jacobian(ca.vec(inertia(moved)), d)[:, layout.slice("s")]
    at = ca.substitute(slope, d, ca.SX.zeros(*d.shape))
    s = ca.SX.sym("s", 5)
    point = ca.vertcat(ca.SX([0, 0, 0, 1, 0, 0, 0]), s)
    return Compiled.interpreted(ca.Function("inertia_slopes", [s], [ca.substitute(at, x, point)]))
