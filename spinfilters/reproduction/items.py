"""Every table and figure of the sources that a command makes, in the order of the sources."""

from typing import Final

from spinfilters.core.errors import InputError
from spinfilters.reproduction.decoust.parameter_influence import PARAMETER_INFLUENCE
from spinfilters.reproduction.decoust.processed_clouds import PROCESSED_CLOUDS
from spinfilters.reproduction.decoust.simulated_scans import SIMULATED_SCANS, STL_READER
from spinfilters.reproduction.decoust.snapshots import SNAPSHOTS
from spinfilters.reproduction.item import Item
from spinfilters.reproduction.tweddle.camera_checkout import CAMERA_CHECKOUT
from spinfilters.reproduction.tweddle.comparative_studies import COMPARATIVE_STUDIES
from spinfilters.reproduction.tweddle.final_deviations import FINAL_DEVIATIONS
from spinfilters.reproduction.tweddle.inertia_races import INERTIA_RACES
from spinfilters.reproduction.tweddle.mapped_body import DENSE_MODEL, MAPPED_BODY
from spinfilters.reproduction.tweddle.metrology_comparison import METROLOGY_COMPARISON
from spinfilters.reproduction.tweddle.metrology_courses import METROLOGY_COURSES
from spinfilters.reproduction.tweddle.noise_and_charts import (
    CONDITIONING,
    INERTIA_OBSERVABILITY,
    NOISE_AND_CHARTS,
)
from spinfilters.reproduction.tweddle.reference_inertia import ALIGNED_MODEL, REFERENCE_INERTIA
from spinfilters.reproduction.tweddle.settling_estimates import CONVERGENCE
from spinfilters.reproduction.tweddle.spinning_bodies import POLHODES, SPIN_THRESHOLDS
from spinfilters.reproduction.tweddle.stereo_rig import STEREO_PICTURES, STEREO_RIG
from spinfilters.reproduction.tweddle.time_lapse import TIME_LAPSES

ITEMS: Final[tuple[Item, ...]] = (
    SPIN_THRESHOLDS,
    *POLHODES,
    *STEREO_PICTURES,
    INERTIA_OBSERVABILITY,
    *NOISE_AND_CHARTS,
    *CONDITIONING,
    STEREO_RIG,
    *CAMERA_CHECKOUT,
    *METROLOGY_COURSES,
    *REFERENCE_INERTIA,
    *INERTIA_RACES,
    *METROLOGY_COMPARISON,
    *TIME_LAPSES,
    ALIGNED_MODEL,
    *MAPPED_BODY,
    *DENSE_MODEL,
    *CONVERGENCE,
    FINAL_DEVIATIONS,
    *COMPARATIVE_STUDIES,
    *SIMULATED_SCANS,
    *PARAMETER_INFLUENCE,
    *PROCESSED_CLOUDS,
    *SNAPSHOTS,
    STL_READER,
)


def chosen_items(names: tuple[str, ...]) -> tuple[Item, ...]:
    """Items of the given names, in the order of the sources; a beginning of a name selects all that begin so.

    Parameters
    ----------
    names : tuple of str
        Names or beginnings of names, such as ``tweddle`` or ``decoust-figure-4``; ``all``, or none, for all.

    Raises
    ------
    InputError
        A name that is the beginning of no item.
    """
    wanted = set()
    for name in names or ("all",):
        found = {item.name for item in ITEMS if name == "all" or item.name == name}
        found = found or {item.name for item in ITEMS if item.name.startswith(name)}
        if not found:
            raise InputError(
                f"{name}: no table or figure has this name; `spinfilters reproduce list` names them"
            )
        wanted |= found
    return tuple(item for item in ITEMS if item.name in wanted)
