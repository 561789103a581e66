"""Table rows of the share of calibration errors in standard deviations."""

import math
from typing import Final

from spinfilters.evaluation.table_row import DEGREE, Column, TableRow

PARTS_CAPTION: Final = (
    "random / calibration: parts of the standard deviation after the last epoch, whose squares add up; the second is what the "
    "calibration's own uncertainty adds. If it is exact, as of a simulation of your own, state in the settings' table "
    "[calibration] that the deviations named above are 0."
)


def parts_row(name: str, quantity: str, unit_in_si: float = 1.0, component: int | None = None) -> TableRow:
    """Random and calibration part of a standard deviation: of one component, or the length of all."""

    def cell(column: Column) -> str | None:
        """A cell of the table."""
        if column.evaluation.history.calibration is None:
            return None
        part = column.evaluation.deviation_parts.get(quantity)
        if part is None:
            return None
        both = (part.random, part.calibration)
        sizes = [math.hypot(*each) if component is None else float(each[component]) for each in both]
        return " / ".join(f"{size / unit_in_si:.2g}" for size in sizes)

    return TableRow(name, cell)


LATEST_ROWS: Final = tuple(
    parts_row(f"{name}: random / calibration [{unit}]", quantity, scale)
    for name, quantity, unit, scale in (
        ("position", "position_m", "mm", 1e-3),
        ("attitude", "attitude_rad", "deg", DEGREE),
        ("velocity", "velocity_m_s", "mm/s", 1e-3),
        ("rate", "rate_rad_s", "deg/s", DEGREE),
        ("centre of mass", "center_of_mass_m", "mm", 1e-3),
    )
)
"""Of the latest state and the centre of mass in g."""
