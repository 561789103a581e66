"""Table 1.1: rates between tumbling and spinning targets of two missions (Eqs 1.1-1.12)."""

from typing import Final

from spinfilters.core.conventions import RPM
from spinfilters.core.spin_threshold import ORBITAL_EXPRESS, SPHERES, spin_threshold
from spinfilters.plots.free_rotation import spin_threshold_figure
from spinfilters.reproduction.item import ComparedNumber, ItemResult, tweddle_item

PRINTED: Final = {
    "SPHERES": (SPHERES, (2.20, 2.17, 2.17), 0.005),
    "Orbital Express": (ORBITAL_EXPRESS, (0.3020, 0.1164, 0.1164), 0.00005),
}
"""By mission: rates by thrust, by propellant and of both, rpm, and half a unit of the last digit."""


def make_table() -> ItemResult:
    """The table, and its rates over the distance of station keeping."""
    rows = []
    for name, (mission, printed, tolerance) in PRINTED.items():
        found = spin_threshold(mission)
        limits = {"thrust": found.force, "propellant": found.mass_fraction, "both": found.overall}
        rows += [
            ComparedNumber(
                f"{name}, limit by {limit}", value / RPM, printed=table, unit="rpm", tolerance=tolerance
            )
            for (limit, value), table in zip(limits.items(), printed, strict=True)
        ]
    missions = {name: mission for name, (mission, _, _) in PRINTED.items()}
    return ItemResult(
        rows,
        figures={"thresholds": spin_threshold_figure(missions)},
        note="The printed mass fraction 0.0056 of Orbital Express is rounded and would give 0.1169 rpm; the printed 0.1164 rpm "
        "belongs to 5 kg of 900 kg.",
    )


SPIN_THRESHOLDS: Final = tweddle_item(
    "Table 1.1",
    "section 1.2",
    "Rates between tumbling and spinning targets",
    make_table,
)
