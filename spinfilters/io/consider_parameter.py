"""Consider parameters: uncertain calibration taken as given (Schmidt 1966)."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from jaxtyping import Float

from spinfilters.core.errors import InputError
from spinfilters.core.plugins import in_order, members_above
from spinfilters.io.stated_values import NumberRange

Moved = Callable[[Any, Any, Any], tuple[Any, Any]]
"""Gives measured values and the parameters of a measurement, were the calibration larger by an error: CasADi expressions."""
Displaced = Callable[[Float[np.ndarray, " k"], Float[np.ndarray, "k 7"]], Float[np.ndarray, "k 6 m"]]
"""Displacement of a camera's known poses per unit of m errors, from times (k,) s and poses (k, 7)
(`spinfilters.core.camera_trajectory`)."""


@dataclass(frozen=True)
class ConsiderParameter:
    """One number of a calibration: a key of the tables [calibration] of settings and dataset.toml.

    Attributes
    ----------
    name : str
        The key of its standard deviation.
    words : str
        What it is called.
    allowed : NumberRange
        Range of the deviation, with its unit.
    default : float
        Deviation where none is stated.
    sensors : tuple[str, ...]
        That it is of, by name; none of the clock, by which all durations are scaled.
    size : int
        How many independent errors share the deviation.
    moved : Moved | None
        See `Moved`; None of the clock, and of an inspector.
    displaced : Displaced | None
        Of the known trajectory of a moving camera, see `Displaced`; None of anything else. What its errors leave
        in the residuals determines them, so that a run considers what is left of the deviation after that.
    block : str
        Of a state that estimates it, which need not consider it then; empty where none does.
    order : int
        Of tables.
    remark : str
        Further sentence of its help; "" for none.
    """

    name: str
    words: str
    allowed: NumberRange
    default: float
    sensors: tuple[str, ...] = ()
    size: int = 1
    moved: Moved | None = None
    displaced: Displaced | None = None
    block: str = ""
    order: int = 50
    remark: str = ""

    @property
    def unit(self) -> str:
        """Unit of the deviation; "1" of a relative one."""
        return self.allowed.unit if self.allowed.unit in UNITS else "1"

    @property
    def of_clock(self) -> bool:
        """Whether it scales all durations."""
        return self.moved is None and self.displaced is None

    def concerns(self, sensors: Iterable[str], inspector: bool = False) -> bool:
        """Whether it affects one of these sensors; the clock affects all, an inspector's only cameras that move."""
        if self.displaced is not None and not inspector:
            return False
        return not self.sensors or bool(set(self.sensors) & set(sensors))


@dataclass(frozen=True)
class ConsideredDeviation:
    """A consider parameter with its deviation, and whether that is stated.

    Attributes
    ----------
    source : str
        "stated" or "prior".
    """

    parameter: ConsiderParameter
    std: float
    source: str


UNITS: Final = ("px", "m", "m/min", "rad/min", "s")
"""Of deviations that are not relative."""


def consider_parameters() -> Mapping[str, ConsiderParameter]:
    """Consider parameters by name: our own, and those of the entry points ``spinfilters.calibration``.

    Raises
    ------
    InputError
        A plug-in that cannot be loaded, a repeated name.
    """
    found: dict[str, ConsiderParameter] = {}
    for each in in_order(members_above("spinfilters.calibration", ConsiderParameter)):
        if each.name in found:
            raise InputError(
                f"calibration parameter {each.name!r} is registered twice; uninstall one plug-in"
            )
        found[each.name] = each
    return found


def exact_calibration(sensors: Iterable[str], inspector: bool = False) -> dict[str, float]:
    """Deviations of a simulated calibration, which has no error, for `DatasetOptions.calibration`.

    Parameters
    ----------
    inspector : bool
        Whether there is a camera that moves, whose poses are exact, too.
    """
    names = tuple(sensors)
    return {name: 0.0 for name, each in consider_parameters().items() if each.concerns(names, inspector)}
