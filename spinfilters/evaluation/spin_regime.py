"""Whether the target of a run tumbles or spins: its rate against the thresholds of missions (Tweddle 2013, section 1.2)."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from spinfilters.core.conventions import RPM
from spinfilters.core.spin_threshold import ORBITAL_EXPRESS, SPHERES, SpinRegime, spin_threshold
from spinfilters.evaluation.estimated_motion import estimated_rates
from spinfilters.evaluation.estimator_evaluation import Evaluation

MISSIONS: Final = {"SPHERES": SPHERES, "Orbital Express": ORBITAL_EXPRESS}
"""Of Table 1.1."""
AXES: Final = ("minor", "intermediate", "major")
WIDTH: Final = 3.0
"""Standard deviations from a limit, within which the regime is open."""
WORDS: Final = {SpinRegime.TUMBLING: "a tumble", SpinRegime.SPINNING: "a spin", None: "at the limit"}


@dataclass(frozen=True)
class SpinVerdict:
    """Rate of a target, and what it is to inspectors.

    Attributes
    ----------
    rate, std : float
        Median of |w| over the estimator's own epochs, and the standard deviation of |w| at the last of them, rad/s.
    axis : str
        Principal axis that most of the rate is about at the last epoch: minor, intermediate or major.
    regimes : mapping of str to SpinRegime or None
        By mission; None within three deviations of its limit.
    is_seen : bool
        Whether something measures where the body is, as an inspector does.
    """

    rate: float
    std: float
    axis: str
    regimes: Mapping[str, SpinRegime | None]
    is_seen: bool = True

    @property
    def sentence(self) -> str:
        """Rate and axis in words, and the regimes of a body that is seen from outside."""
        motion = f"{self.rate / RPM:.3g} +- {self.std / RPM:.2g} rpm, mostly about the {self.axis} axis"
        if not self.is_seen:
            return motion
        limits = {name: spin_threshold(mission).overall / RPM for name, mission in MISSIONS.items()}
        told = ", ".join(
            f"{WORDS[self.regimes[name]]} for one like {name} (limit {limit:.3g} rpm)"
            for name, limit in limits.items()
        )
        return f"{motion}; to an inspector that wants to follow it: {told}; spinfilters threshold has other missions"

    @property
    def document(self) -> dict[str, Any]:
        """The same as JSON."""
        regimes = {name: None if each is None else each.value for name, each in self.regimes.items()}
        return {"rate_rpm": self.rate / RPM, "std_rpm": self.std / RPM, "axis": self.axis, "regimes": regimes}


def spin_verdict(evaluation: Evaluation) -> SpinVerdict | None:
    """Whether the target of an estimate tumbles or spins for the missions of Table 1.1.

    Parameters
    ----------
    evaluation : Evaluation
        Of an estimator.

    Returns
    -------
    SpinVerdict or None
        None where the estimate has no finite rate, deviation or axes.
    """
    history = evaluation.history
    if not len(history.time):
        return None
    rates = estimated_rates(history)
    own = rates.rate[history.initialisation :] if history.initialisation < len(rates.rate) else rates.rate
    length = np.linalg.norm(own, axis=1)
    last, covariance = rates.rate[-1], rates.covariance
    axes = evaluation.body.principal_axes_g
    if covariance is None or not (np.isfinite(last).all() and np.isfinite(axes).all() and last.any()):
        return None
    direction = last / np.linalg.norm(last)
    variance = float(direction @ covariance[-1] @ direction)
    rate = float(np.median(length[np.isfinite(length)]))
    if not np.isfinite(variance):
        return None
    std = float(np.sqrt(max(variance, 0.0)))
    regimes = {}
    for name, mission in MISSIONS.items():
        limit = spin_threshold(mission)
        regimes[name] = None if abs(rate - limit.overall) < WIDTH * std else limit.regime(rate)
    axis = AXES[int(np.argmax(np.abs(axes @ direction)))]
    return SpinVerdict(rate, std, axis, regimes, history.layout.translates)
