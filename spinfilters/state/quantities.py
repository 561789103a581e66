"""Quantities of an estimate of which a verdict says whether they hold."""

from typing import Final

POSITION: Final = "position"
ATTITUDE: Final = "attitude"
VELOCITY: Final = "velocity"
RATE: Final = "rate"
MOMENTS: Final = "moments"
AXES: Final = "axes"
CENTRE: Final = "center_of_mass"

QUANTITIES: Final = (POSITION, ATTITUDE, VELOCITY, RATE, MOMENTS, AXES, CENTRE)
"""Position of the centre of mass, attitude, velocity, body rate, principal moments and axes, centre of mass in the body."""
LABELS: Final = {name: name for name in QUANTITIES} | {CENTRE: "centre of mass"}
"""As texts call them."""
ALL: Final = frozenset(QUANTITIES)
NOTHING: Final[frozenset[str]] = frozenset()
BODY: Final = frozenset({MOMENTS, AXES})
ROTATION: Final = frozenset({ATTITUDE, RATE, MOMENTS, AXES})
TRANSLATION: Final = frozenset({POSITION, VELOCITY, CENTRE})

OF_BLOCKS: Final = {
    "t": frozenset({POSITION}),
    "a": frozenset({ATTITUDE}),
    "v": frozenset({VELOCITY}),
    "w": frozenset({RATE}),
    "c": frozenset({CENTRE, POSITION}),
    "s": BODY,
}
"""Quantities that rest on a block of the state; other blocks are results of their own."""
