"""Conditions of a comparison: map, noise, seed, and whether the truth contradicts itself."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Final

import numpy as np
from jaxtyping import Bool, Float, Int

from spinfilters.core.attitude_conversions import angle_between, integrate_gyro, inverse, multiply
from spinfilters.evaluation.epoch_spans import clock_text
from spinfilters.filters.noise_levels import VarianceComponent
from spinfilters.inference.identified_noise import smallest_level
from spinfilters.inference.setup import Setup
from spinfilters.io.consider_parameter import ConsideredDeviation
from spinfilters.io.disturbances import DENSITIES
from spinfilters.io.measurement_log import MeasurementStream
from spinfilters.io.sensor_format import sensor_format
from spinfilters.io.truth import Truth
from spinfilters.models.sensor_registry import sensor_of
from spinfilters.verdict.calibration_errors import enlarged_words

WINDOW: Final = 1.0
"""Rad of turn after which attitudes and rates start together again, so that a gyro's bias does not add up."""
LARGEST_STEP: Final = 1.0
"""Rad between two rows, above which rates at the rows alone do not determine the rotation."""
TOLD: Final = 0.8
"""Share of all turning that must be in steps no larger: of a body that is seen too rarely nothing is said."""
DEGREES: Final = (55.0, 60.0)
"""Ratio of a rate to the turn that is seen, within which the rate is in degrees; steps too long to be resolved do not matter."""
APART: Final = 0.25
"""Rad within a window, which a quarter of all turning must exceed: rates wrong by a third; optical noise is a tenth of it."""
SHARE: Final = 0.5
"""Of the extent of a path, that the path of its velocities is off by: neither sign nor unit nor axes can be right."""
NOISE: Final = 10.0
"""Times the noise of positions and of summed velocities, below which nothing is said."""
FEWEST: Final = 5
"""Rows."""


def contradictions(truth: Truth) -> list[str]:
    """One sentence for each contradiction of a truth with itself.

    None for one that does not contradict, or is too short to decide.
    """
    with np.errstate(all="ignore"):  # numbers beyond all bounds are no reason to stop
        return [*_of_rotation(truth), *_of_translation(truth)]


def _of_rotation(truth: Truth) -> Iterator[str]:
    if len(truth.time) <= FEWEST:
        return
    if _is_in_degrees(truth):
        yield _sentence("its rates are 57 times too large for its attitudes, as if they were in degrees")
        return
    apart = _typically_apart(truth)
    if apart is not None and apart > APART:
        yield _sentence(f"its rates contradict its attitudes ({apart:.2g} rad apart within a radian)")


def _of_translation(truth: Truth) -> Iterator[str]:
    dt, velocity = np.diff(truth.time), truth.velocity
    if len(dt) < FEWEST:
        return
    steps = (velocity[1:] + velocity[:-1]) / 2 * dt[:, None]
    carried = np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)])
    off, extent = _spread(truth.center_of_mass - carried), max(map(_spread, (truth.center_of_mass, carried)))
    summed = _noise(velocity) * np.sqrt(len(dt)) * float(np.median(dt))
    rounding = float(np.finfo(np.float64).eps * np.abs(truth.center_of_mass).max())
    if off > SHARE * extent and off > NOISE * (_noise(truth.center_of_mass) + summed + rounding):
        yield _sentence(
            f"its velocities contradict the path of its centre of mass ({off:.2g} m apart on a path of {extent:.2g} m)"
        )


def _sentence(why: str) -> str:
    return f"THE TRUTH CONTRADICTS ITSELF: {why}. Errors relative to it mean little."


def _is_in_degrees(truth: Truth) -> bool:
    turn, seen = _turns(truth)
    moved = np.minimum(turn, seen) > 0
    ratio = turn[moved] / seen[moved]
    return len(ratio) > FEWEST and DEGREES[0] < np.median(ratio) < DEGREES[1]


def _turns(truth: Truth) -> tuple[Float[np.ndarray, " j"], Float[np.ndarray, " j"]]:
    """Rotations of every step by the rates and by the attitudes, rad."""
    rates, q = truth.rate_i, truth.q_ig
    by_rates = np.linalg.norm(rates[1:] + rates[:-1], axis=1) / 2 * np.diff(truth.time)
    return by_rates, angle_between(q[1:], q[:-1])


def _typically_apart(truth: Truth) -> float | None:
    """Third quartile of the angle between turns by attitudes and rates, rad.

    All turning counts; None where there are too few rows. What rates leave open between two rows, by their second differences, is
    taken off.
    """
    turn, seen = _turns(truth)
    told, weight = turn <= LARGEST_STEP, np.maximum(turn, seen)
    if np.count_nonzero(told) < FEWEST or not weight[told].sum() > TOLD * weight.sum():
        return None
    begin, end = _windows(turn, told), 1 + np.flatnonzero(told)
    curved = np.linalg.norm(np.diff(truth.rate_i, n=2, axis=0), axis=1)
    left = np.maximum(np.append(curved, 0.0), np.append(0.0, curved)) * np.diff(truth.time) / 2
    open_still = np.append(0.0, np.cumsum(left))
    apart = _angles_apart(truth, begin, end) - (open_still[end] - open_still[begin])
    order = np.argsort(apart)
    summed = np.cumsum(weight[told][order])
    return float(apart[order][np.searchsorted(summed, 0.75 * summed[-1])])


def _windows(turn: Float[np.ndarray, " j"], told: Bool[np.ndarray, " j"]) -> Int[np.ndarray, " n"]:
    """First row of the window of every step whose rotation is known; ``turn`` (rad) is that of each step."""
    done = np.cumsum(np.where(told, turn, 0.0))
    window = np.floor((done - np.where(told, turn, 0.0)) / WINDOW)
    begins = (np.diff(window, prepend=-1.0) != 0) | (np.diff(told, prepend=False) != 0)
    return np.maximum.accumulate(np.where(begins, np.arange(len(turn)), 0))[told]


def _angles_apart(
    truth: Truth, begin: Int[np.ndarray, " n"], end: Int[np.ndarray, " n"]
) -> Float[np.ndarray, " n"]:
    """Angles between the turns from row to row by the attitudes and by the rates, rad."""
    back = integrate_gyro(
        truth.time, -truth.rate_i, np.array([0.0, 0.0, 0.0, 1.0])
    )  # inverse of the turn so far
    by_rates = multiply(inverse(back[end]), back[begin])
    return angle_between(by_rates, multiply(truth.q_ig[end], inverse(truth.q_ig[begin])))


def _spread(path: Float[np.ndarray, "n 3"]) -> float:
    """Median distance from the middle of a path, m."""
    return float(np.median(np.linalg.norm(path - np.median(path, axis=0), axis=1)))


def _noise(values: Float[np.ndarray, "n 3"]) -> float:
    """Standard deviation of white noise, at most, by second differences, whose variance is six times its own."""
    return float(np.median(np.linalg.norm(np.diff(values, n=2, axis=0), axis=1)) / np.sqrt(18.0) / 0.9)


STATED, IDENTIFIED, PRIOR = "stated", "identified", "prior"
ROUNDING = 1 + 1e-6
MOST_LINES, LONGEST = 8, 240
"""Of sentences that are read from a file."""


@dataclass(frozen=True)
class StatedNoise:
    """One number of the noise with its unit, and where it comes from.

    Attributes
    ----------
    label : str
        What it is called in a sentence.
    source : str
        `STATED`, `IDENTIFIED`, or `PRIOR` where the data only bound it, or nothing.
    std : float or None
        Of an identified value.
    upper : float or None
        Bound on one that cannot be distinguished from zero.
    smallest : float
        Level below which none is identified; 0 of what has no such bound.
    """

    name: str
    label: str
    value: float
    unit: str
    source: str = STATED
    std: float | None = None
    upper: float | None = None
    smallest: float = 0.0

    @property
    def is_absent(self) -> bool:
        """Whether the measurements show no noise at all, as those of a simulation without it."""
        return self.source == PRIOR and self.upper is not None and self.value <= ROUNDING * self.smallest

    @property
    def document(self) -> dict[str, Any]:
        """The noise as summary.json holds it."""
        return {**self.level, "unit": self.unit}

    @property
    def level(self) -> dict[str, Any]:
        """Value, deviation, upper bound and source."""
        return {"value": self.value, "std": self.std, "upper": self.upper, "source": self.source}

    def identified(self, found: Sequence[VarianceComponent]) -> "StatedNoise":
        """The noise as identified, where it is among these."""
        own = next((each for each in found if each.name == self.name), None)
        if own is None:
            return self
        if own.told:
            return replace(self, value=own.value, source=IDENTIFIED, std=own.std, upper=None)
        return replace(self, value=own.value, source=PRIOR, std=None, upper=own.upper)

    @property
    def words(self) -> str:
        """Label, value with its deviation or bound, unit and source."""
        unit = "" if self.unit == "1" else f" {self.unit}"
        if self.upper is not None:
            return f"{self.label} below {self.upper:.2g}{unit}"
        deviation = "" if self.std is None else f" +- {self.std:.1g}"
        found = {IDENTIFIED: " (identified)", PRIOR: " (assumed)", STATED: ""}
        return f"{self.label} {self.value:.3g}{deviation}{unit}{found[self.source]}"


@dataclass(frozen=True)
class Conditions:
    """Conditions under which the numbers of a run hold.

    Attributes
    ----------
    map : str or None
        "known" or "unknown", None where no landmark is seen.
    landmarks : int or None
        Of a known map.
    sensors, disturbances : tuple[StatedNoise, ...]
        Their noise.
    seed : int or None
        Of a simulated data set.
    contradictions : tuple[str, ...]
        Sentences on how the truth contradicts itself.
    calibration : tuple[ConsideredDeviation, ...]
        Deviations that are considered.
    belief_at : float or None
        Time of the stated belief that estimators begin from, s; None where first epochs are smoothed.
    """

    map: str | None
    landmarks: int | None
    sensors: tuple[StatedNoise, ...]
    disturbances: tuple[StatedNoise, ...]
    seed: int | None
    contradictions: tuple[str, ...] = ()
    calibration: tuple[ConsideredDeviation, ...] = ()
    belief_at: float | None = None

    @cached_property
    def sentences(self) -> list[str]:
        """Conditions in words.

        The map and the seed, then the noise, then what is wrong with the truth.
        """
        known = "" if self.landmarks is None else f" ({self.landmarks} landmarks)"
        first = [] if self.map is None else [f"Map {self.map}{known}."]
        first += [] if self.seed is None else [f"Seed {self.seed}."]
        noise = f"Noise: {_list_noise(self.sensors)}; disturbances: {_list_noise(self.disturbances)}."
        counted = [_describe_parameter(each) for each in self.calibration if each.std > 0]
        calibration = [f"Deviations include errors of {', '.join(counted)}."] if counted else []
        assumed = [each.parameter.name for each in self.calibration if each.std > 0 and each.source == PRIOR]
        grown = enlarged_words(self.calibration)
        if grown:
            calibration.append(f"Those of {', '.join(grown)} are larger if the residuals allow it.")
        if assumed:
            keys = ", ".join(f"{name} = 0" for name in assumed)
            calibration.append(
                f"If the calibration is exact (a simulation of your own), state [calibration] {keys}."
            )
        absent = [_describe_assumed_noise(each) for each in self.sensors if each.is_absent]
        if self.belief_at is not None:
            first.append(
                f"Every estimator starts from the stated belief at t = {clock_text(self.belief_at)} s; "
                "no first epochs are smoothed. It holds before the measurements of that epoch, which all of them use."
            )
        return [*([" ".join(first)] if first else []), noise, *absent, *calibration, *self.contradictions]

    @property
    def document(self) -> dict[str, Any]:
        """The conditions as summary.json holds them."""
        noise = (*self.sensors, *self.disturbances)
        return {
            "map": self.map,
            "landmarks_known": self.landmarks,
            "seed": self.seed,
            "noise": {each.name: each.document for each in noise},
            "calibration": {
                each.parameter.name: {"value": each.std, "unit": each.parameter.unit, "source": each.source}
                for each in self.calibration
            },
            "truth_contradictions": list(self.contradictions),
            "sentences": self.sentences,
        }


def conditions_of(setup: Setup) -> Conditions:
    """Conditions of a prepared data set."""
    dataset, known = setup.dataset, setup.dataset.known_map
    sees = any(sensor_format(sensor).has_landmarks for sensor in dataset.log.sensors)
    seen = None if not sees else "unknown" if known is None else "known"
    sensors = tuple(noise for stream in setup.log.streams for noise in _sensor_noise(stream, setup))
    seed = dataset.options.notes.get("seed")
    return Conditions(
        seen,
        None if seen is None or known is None else len(known.ids),
        sensors,
        tuple(_disturbances(setup)),
        seed if isinstance(seed, int) and not isinstance(seed, bool) else None,
        () if dataset.truth is None else tuple(contradictions(dataset.truth)),
        setup.calibration,
        setup.end_of_initialisation if setup.is_given else None,
    )


def told_sentences(document: dict[str, Any]) -> list[str]:
    """Sentences on the conditions in a summary.json; none where it lacks them."""
    told = document.get("conditions")
    lines = told.get("sentences") if isinstance(told, dict) else None
    if not isinstance(lines, list):
        return []
    return [line[:LONGEST] for line in lines[:MOST_LINES] if isinstance(line, str) and line.isprintable()]


def _sensor_noise(stream: MeasurementStream, setup: Setup) -> Iterator[StatedNoise]:
    """Value of every noise option of the sensor.

    Rows with covariances have their median; what is zero is left out.
    """
    for option in sensor_format(stream.sensor).noise:
        value = setup.noise.values[option.name]
        if stream.covariance is not None and option.components is not None:
            rows = np.array(option.components)
            # median over all rows of the deviation along an axis, from the diagonals of these components' blocks
            variances = np.einsum("nii->ni", stream.covariance[:, rows[:, None], rows])
            value = float(np.sqrt(np.median(variances)))
        if value > 0:
            own = stream.covariance is not None and option.components is not None
            source = STATED if own else _source(option.name, setup)
            smallest, unit = smallest_level(option.name), option.allowed.unit or "1"
            noise = StatedNoise(option.name, option.words, value, unit, source, smallest=smallest)
            yield noise.identified(setup.identified)


def _disturbances(setup: Setup) -> Iterator[StatedNoise]:
    for name, psd in setup.process.noise.densities.items():
        each = DENSITIES[name]
        if each.block in setup.process.layout.blocks:
            stated = StatedNoise(name, each.name, psd, each.allowed.unit, _source(name, setup))
            yield stated.identified(setup.identified)


def _source(name: str, setup: Setup) -> str:
    """Source of a noise level that is not among those identified."""
    if name not in setup.unstated:
        return STATED
    if setup.gyro_noise is None:
        return PRIOR
    by_rates = {sensor_of(stream.sensor).identified_option for stream in setup.dataset.log.streams}
    return IDENTIFIED if name in by_rates else PRIOR


def _describe_parameter(considered: ConsideredDeviation) -> str:
    """Name and deviation of a parameter in words."""
    parameter, std = considered.parameter, considered.std
    size = f"{100 * std:.2g} %" if parameter.unit == "1" else f"{std:.2g} {parameter.unit}"
    return f"{parameter.words} {size}{' (assumed)' if considered.source == PRIOR else ''}"


def _describe_assumed_noise(noise: StatedNoise) -> str:
    """Sentence on the noise that is assumed of a sensor without any, and how to state another."""
    return (
        f"No noise is seen in the {noise.label} (a simulation without noise?): {noise.value:.1g} {noise.unit} is assumed, and NIS "
        f"is below one; state sensors.{noise.name} for another."
    )


def _list_noise(noise: tuple[StatedNoise, ...]) -> str:
    return ", ".join(each.words for each in noise)
