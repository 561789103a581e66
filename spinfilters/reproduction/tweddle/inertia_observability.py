"""Equations 3.11 to 3.15: what three rates determine of the principal moments (section 3.3, Listing B.3)."""

from typing import Final

import casadi as ca
import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from observability import analyse
from spinfilters.plots.style import BLACK, BLUE, ORANGE, tidy
from spinfilters.reproduction.item import ComparedNumber, ItemResult, tweddle_item

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
