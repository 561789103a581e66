"""What a comparison was made under: the map, the noise that the estimators are told, the seed, a truth that belongs together."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from spinfilters.data.measurement_log import MeasurementStream
from spinfilters.data.sensor_format import sensor_format
from spinfilters.evaluation.truth_consistency import contradictions
from spinfilters.pipeline.setup import Setup
from spinfilters.sensors.registry import sensor_of

STATED, IDENTIFIED, PRIOR = "stated", "identified", "prior"
FORCE_UNIT, TORQUE_UNIT = "(m/s^2)^2/Hz", "(rad/s^2)^2/Hz"
MOST_LINES, LONGEST = 4, 200
"""Of sentences that are read from a file."""


@dataclass(frozen=True)
class StatedNoise:
    """One number of the noise with its unit, and where it comes from.

    Attributes
    ----------
    label: what it is called in a sentence.   source: `STATED`, `IDENTIFIED`, or `PRIOR` where the data only bound it, or nothing.
    std: of an identified value.
    """

    name: str
    label: str
    value: float
    unit: str
    source: str = STATED
    std: float | None = None

    @property
    def document(self) -> dict[str, Any]:
        """As summary.json holds it."""
        return {"value": self.value, "unit": self.unit, "std": self.std, "source": self.source}


@dataclass(frozen=True)
class Conditions:
    """See the module.

    Attributes
    ----------
    map: "known" or "unknown", None where no landmark is seen.   landmarks: of a known map.
    sensors, disturbances: their noise.   seed: of a simulated data set.
    contradictions: sentences on how the truth contradicts itself.
    """

    map: str | None
    landmarks: int | None
    sensors: tuple[StatedNoise, ...]
    disturbances: tuple[StatedNoise, ...]
    seed: int | None
    contradictions: tuple[str, ...] = ()

    @property
    def sentences(self) -> list[str]:
        """In words: the map and the seed, then the noise, then what is wrong with the truth."""
        known = "" if self.landmarks is None else f" ({self.landmarks} landmarks)"
        first = [] if self.map is None else [f"Map {self.map}{known}."]
        first += [] if self.seed is None else [f"Seed {self.seed}."]
        noise = f"Noise: {_listed(self.sensors)}; disturbances: {_listed(self.disturbances)}."
        return [*([" ".join(first)] if first else []), noise, *self.contradictions]

    @property
    def document(self) -> dict[str, Any]:
        """As summary.json holds it."""
        noise = (*self.sensors, *self.disturbances)
        return {
            "map": self.map,
            "landmarks_known": self.landmarks,
            "seed": self.seed,
            "noise": {each.name: each.document for each in noise},
            "truth_contradictions": list(self.contradictions),
            "sentences": self.sentences,
        }


def conditions_of(setup: Setup) -> Conditions:
    """Of a prepared data set."""
    dataset, known = setup.dataset, setup.dataset.known_map
    sees = any(sensor_format(sensor).has_landmarks for sensor in dataset.log.sensors)
    seen = None if not sees else "unknown" if known is None else "known"
    sensors = tuple(noise for stream in dataset.log.streams for noise in _sensor_noise(stream, setup))
    seed = dataset.options.notes.get("seed")
    return Conditions(
        seen,
        None if seen is None or known is None else len(known.ids),
        sensors,
        tuple(_disturbances(setup)),
        seed if isinstance(seed, int) and not isinstance(seed, bool) else None,
        () if dataset.truth is None else tuple(contradictions(dataset.truth)),
    )


def told_sentences(document: dict[str, Any]) -> list[str]:
    """The sentences that a summary.json tells; none where it does not."""
    told = document.get("conditions")
    lines = told.get("sentences") if isinstance(told, dict) else None
    if not isinstance(lines, list):
        return []
    return [line[:LONGEST] for line in lines[:MOST_LINES] if isinstance(line, str) and line.isprintable()]


def _sensor_noise(stream: MeasurementStream, setup: Setup) -> Iterator[StatedNoise]:
    """What every option of the sensor is, of rows with covariances their median; what is zero is left out."""
    for option in sensor_format(stream.sensor).noise:
        value = setup.noise.values[option.name]
        if stream.covariance is not None and option.components is not None:
            rows = np.array(option.components)
            value = _median_std(stream.covariance[:, rows[:, None], rows])
        if value > 0:
            own = stream.covariance is not None and option.components is not None
            source, std = (STATED, None) if own else _source(option.name, setup)
            yield StatedNoise(option.name, option.words, value, option.allowed.unit or "1", source, std)


def _disturbances(setup: Setup) -> Iterator[StatedNoise]:
    noise = setup.process.noise
    if setup.process.layout.translates:
        yield StatedNoise("force_psd", "force", noise.force_psd, FORCE_UNIT, *_source("force_psd", setup))
    yield StatedNoise("torque_psd", "torque", noise.torque_psd, TORQUE_UNIT, *_source("torque_psd", setup))


def _source(name: str, setup: Setup) -> tuple[str, float | None]:
    """Where a noise level comes from, and its standard deviation if the data tell it."""
    found = next((each for each in setup.identified if each.name == name), None)
    if found is not None:
        return (IDENTIFIED, found.std) if found.told else (PRIOR, None)
    if name not in setup.unstated:
        return STATED, None
    by_rates = setup.gyro_noise is not None and name in _identified_options(setup)
    return (IDENTIFIED if by_rates else PRIOR), None


def _identified_options(setup: Setup) -> set[str | None]:
    """Options of rate sensors of unknown error."""
    return {sensor_of(stream.sensor).identified_option for stream in setup.dataset.log.streams}


def _median_std(covariance: np.ndarray) -> float:
    """Median over all rows of the standard deviation along an axis."""
    return float(np.sqrt(np.median(np.einsum("nii->ni", covariance))))


def _listed(noise: tuple[StatedNoise, ...]) -> str:
    found = {IDENTIFIED: " (identified)", PRIOR: " (assumed)", STATED: ""}
    return ", ".join(
        f"{n.label} {n.value:.3g}{'' if n.unit == '1' else f' {n.unit}'}{found[n.source]}" for n in noise
    )
