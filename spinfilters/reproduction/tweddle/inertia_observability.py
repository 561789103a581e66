"""Equations 3.11 to 3.15: what three rates determine of the principal moments (section 3.3, Listing B.3)."""

from typing import Final

from observability import analyse
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
GENERIC: Final = {"wx": 2, "wy": 3, "wz": 5, "Jx": 7, "Jy": 6, "Jz": 4}


def make_rank() -> ItemResult:
    """Rank, order and null vector, and the special cases of the text."""
    found = analyse(EULER, name="Euler's equations")
    special = {
        "equal moments": GENERIC | {"Jx": 5, "Jy": 5, "Jz": 5},
        "spin about one principal axis": GENERIC | {"wx": 0, "wy": 0},
    }
    ranks = {name: analyse(EULER, name=name, at=point).rank for name, point in special.items()}
    is_scale = [str(each) for each in found.symmetries] == ["Jx -> e^ε Jx, Jy -> e^ε Jy, Jz -> e^ε Jz"]
    numbers = [
        ComparedNumber("variables", float(found.dimension), printed=6.0),
        ComparedNumber("rank of O", float(found.rank), printed=5.0),
        ComparedNumber("highest order of Lie derivatives needed", float(found.order), printed=1.0),
        ComparedNumber("the free direction scales all three moments alike", float(is_scale), printed=1.0),
        ComparedNumber(
            "rank with equal moments: said to be less",
            float(ranks["equal moments"]),
            expected=(0.0, 4.0),
            why="with rates about all three axes only the scale stays open: another ratio would bend the motion",
        ),
        ComparedNumber(
            "rank in a spin about one principal axis: less than 5",
            float(ranks["spin about one principal axis"]),
            expected=(0.0, 4.0),
        ),
    ]
    return ItemResult(
        numbers,
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
