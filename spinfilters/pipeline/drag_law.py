"""Law of the drag, chosen by the evidence of the first epochs.

Air brakes a body that turns fast with the square of its rate, |h| falls by exp(-d angle); viscous flow, eddy currents, and air
that streams past much faster than the surface turns brake with the rate itself, |h| falls by exp(-l t). Each law is a constant
of the state with its own prior. The marginal likelihood of the first epochs says which is likelier, and whether it is likelier
than none.
"""

from dataclasses import replace
from typing import Final

import numpy as np

from spinfilters.errors import InputError
from spinfilters.pipeline.acceleration_state import Make
from spinfilters.pipeline.log_evidence import cost_of_first_epochs
from spinfilters.pipeline.setup import Setup
from spinfilters.settings.run_settings import AUTO, LINEAR, QUADRATIC, Settings

LAWS: Final = (QUADRATIC, LINEAR)
"""Laws that are compared; the first is the plainer one where neither is likelier."""
WORTH: Final = 10.0
"""Fall of -2 ln evidence that a drag must bring to be told from none."""


def with_likelier_drag(make: Make, settings: Settings) -> Settings:
    """The settings with the likeliest law in place of "auto", false where the first epochs tell no drag."""
    if settings.process.drag != AUTO:
        return settings
    first = _setup(make, _with(settings, QUADRATIC), None)
    costs = {law: _cost(_setup(make, _with(settings, law), first)) for law in (False, *LAWS)}
    best = min(LAWS, key=costs.__getitem__)
    told = np.isfinite(costs[best]) and costs[best] < costs[False] - WORTH
    return replace(settings, process=replace(settings.process, drag=best if told else False))


def _with(settings: Settings, law: str | bool) -> Settings:
    """With a law, and with the acceleration that a sensor of places may need: it is decided later."""
    process = settings.process
    return replace(
        settings,
        process=replace(process, drag=law, gravity=True if process.gravity == AUTO else process.gravity),
    )


def _setup(make: Make, settings: Settings, beside: Setup | None) -> Setup | None:
    try:
        return make(settings, beside)
    except InputError:  # of which the caller's own setup tells
        return None


def _cost(setup: Setup | None) -> float:
    """-2 ln marginal likelihood of the first epochs, infinite without any."""
    return np.inf if setup is None else cost_of_first_epochs(setup)
