"""The table ``bound`` of a model's file: the numbers of a flight, its recording, and the manoeuvres to compare."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Final

import casadi as ca
import numpy as np
from jaxtyping import Float

from observability.model import CLOCK, FROM_FILE, experiments_of, model_of_text, require_inputs
from observability.model_bound import ModelBound, bound_of, gain_table
from observability.model_experiment import Course, Experiment, Progress, no_progress
from observability.model_text import exact_number, formula
from spinfilters.core.compiled import Compiled
from spinfilters.core.errors import InputError
from spinfilters.io.text_table import read_csv

NUMBERS: Final = ("values", "noise", "priors", "process_noise")
KEYS: Final = ("duration", "interval", "recording", "trajectory", *NUMBERS, "manoeuvres")
TIMES: Final = ("time_s", "time", "t")
"""Names of the column of time."""
MOST_TIMES: Final = 100_000


@dataclass(frozen=True)
class StatedBound:
    """Everything that a model's file asks about its bound.

    Attributes
    ----------
    flights : Mapping[str, Experiment]
        Experiments with the same parameters by name, in order; each knows the parameters from those before.
    manoeuvres : Mapping[str, Mapping[str, Course]]
        By name other known inputs of the last flight.
    """

    flights: Mapping[str, Experiment]
    manoeuvres: Mapping[str, Mapping[str, Course]]

    @cached_property
    def bounds(self) -> dict[str, ModelBound]:
        """After each flight."""
        return {name: bound_of(each) for name, each in self.flights.items()}

    @property
    def last(self) -> ModelBound:
        """After all of them."""
        return list(self.bounds.values())[-1]

    @cached_property
    def gains(self) -> dict[str, dict[str, float]]:
        """Standard deviations without over those with each sensor and manoeuvre, by unknown."""
        return gain_table(self.last, self.manoeuvres)

    @property
    def sentences(self) -> list[str]:
        """The whole text."""
        return [*[line for each in self.bounds.values() for line in each.sentences], *self.gain_sentences]

    @property
    def gain_sentences(self) -> list[str]:
        """A line for each sensor and manoeuvre."""
        lines = ["Gain, standard deviation without over with it:"]
        for name, row in self.gains.items():
            told = ", ".join(
                f"{unknown} {gain:.3g}" if 0 < gain < np.inf else f"{unknown} ({'alone' if gain else 'lost'})"
                for unknown, gain in sorted(row.items(), key=lambda each: -each[1])
                if abs(np.log(max(gain, 1e-300))) > np.log(1.05)
            )
            lines.append(f"  {name:20} {told or 'nothing'}")
        return lines

    def document(self) -> dict[str, Any]:
        """The bound for JSON; what is infinite is null."""
        return {
            "experiments": {name: each.document() for name, each in self.bounds.items()},
            "gains": {
                name: {unknown: gain if np.isfinite(gain) else None for unknown, gain in row.items()}
                for name, row in self.gains.items()
            },
        }


def stated_bound(
    document: Mapping[str, Any], name: str, folder: Path, progress: Progress = no_progress
) -> StatedBound | None:
    """Flights and manoeuvres of the tables ``bound`` of a model's document; None without such a table.

    Parameters
    ----------
    document : Mapping
        As of `observability.model.model_of_text`, with a table ``bound``.
    name : str
        For titles and complaints.
    folder : Path
        Of the file, from which names of recordings count.
    progress : Progress
        Called while the bound is computed, which happens when it is asked for.

    Raises
    ------
    InputError
        One line with the name and the cure.
    """
    several = "experiments" in document
    documents = experiments_of(document, name) if several else {"": document}
    flights: dict[str, Experiment] = {}
    manoeuvres: Mapping[str, Mapping[str, Course]] = {}
    for each, own in documents.items():
        if "bound" not in own:
            continue
        title = f"{name}, {each}" if several else name
        section = _Section(own, title, folder, several)
        before = list(flights.values())[-1] if flights else None
        flights[each] = section.experiment(before, progress)
        manoeuvres = section.manoeuvres()
    return StatedBound(flights, manoeuvres) if flights else None


class _Section:
    """One table ``bound`` with the model that it belongs to."""

    def __init__(self, document: Mapping[str, Any], name: str, folder: Path, is_one_of_several: bool) -> None:
        self._name, self._folder, self._is_one_of_several = name, folder, is_one_of_several
        self._section: Mapping[str, Any] = _mapping(document["bound"], f"{name}: bound")
        foreign = [key for key in self._section if key not in KEYS]
        if foreign:
            raise InputError(f"{name}: bound has {foreign[0]!r}, which is unknown; use {', '.join(KEYS)}")
        self._courses = _mapping(document.get("courses", {}), f"{name}: courses")
        self._model = model_of_text({key: value for key, value in document.items() if key != "courses"}, name)

    def experiment(self, before: Experiment | None, progress: Progress) -> Experiment:
        """The flight."""
        numbers = {key: self._numbers(key) for key in NUMBERS}
        values = self._known_values() | numbers.pop("values")
        trajectory = {name: self._column(name) for name in self._trajectory}
        return Experiment(
            self._model,
            values,
            self._times,
            **numbers,
            inputs=self._inputs(self._courses),
            every=self._model.every,
            trajectory=trajectory,
            after=before,
            progress=progress,
        )

    def manoeuvres(self) -> dict[str, dict[str, Course]]:
        """Other inputs, by the name of the manoeuvre."""
        found = {}
        for name, courses in _mapping(
            self._section.get("manoeuvres", {}), f"{self._name}: manoeuvres"
        ).items():
            where = f"{self._name}: manoeuvre {name}"
            table = _mapping(courses, where)
            foreign = [each for each in table if each not in self._model.inputs]
            if foreign:
                raise InputError(
                    f"{where} names {foreign[0]!r}, which is no input; use {', '.join(self._model.inputs) or 'none'}"
                )
            found[name] = {each: self._course(each, text) for each, text in table.items()}
        return found

    def _known_values(self) -> dict[str, float]:
        """Of the point."""
        return {name: float(value) for name, value in self._model.point.items()}

    def _numbers(self, key: str) -> dict[str, float]:
        table = _mapping(self._section.get(key, {}), f"{self._name}: {key}")
        return {
            name: float(exact_number(value, f"{self._name}: {key} of {name}"))
            for name, value in table.items()
        }

    @cached_property
    def _times(self) -> Float[np.ndarray, " t"]:
        if "recording" in self._section:
            twice = [key for key in ("duration", "interval") if key in self._section]
            if twice:
                raise InputError(
                    f"{self._name}: bound has {twice[0]} with a recording, which has its own times; leave it out{self._other_keys}"
                )
            return self._read_recorded[0]
        duration, interval = (self._positive(key) for key in ("duration", "interval"))
        count = int(duration / interval + 1.5)
        if not 2 <= count <= MOST_TIMES:
            raise InputError(
                f"{self._name}: bound has {count} times; choose duration and interval for 2 to {MOST_TIMES}"
            )
        return interval * np.arange(count)

    @property
    def _other_keys(self) -> str:
        """End of a complaint: where to state a key that other experiments need."""
        return (
            ", or give it to each experiment that has no recording, as [experiments.NAME.bound]"
            if self._is_one_of_several
            else ""
        )

    def _positive(self, key: str) -> float:
        default = 1 if key == "interval" and self._model.discrete else None
        if self._section.get(key, default) is None:
            raise InputError(f"{self._name}: bound has no {key}; give it in s, or a recording")
        number = float(exact_number(self._section.get(key, default), f"{self._name}: {key}"))
        if not number > 0:
            raise InputError(f"{self._name}: {key} is {number:g}; give a positive number")
        return number

    @cached_property
    def _read_recorded(self) -> tuple[Float[np.ndarray, " t"], dict[str, Float[np.ndarray, " t"]]]:
        return _read_table(self._folder / str(self._section["recording"]))

    @property
    def _trajectory(self) -> list[str]:
        names = self._section.get("trajectory", [])
        if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
            raise InputError(
                f"{self._name}: trajectory is {names!r}; give a list of states that the recording has as columns"
            )
        if names and "recording" not in self._section:
            raise InputError(f"{self._name}: trajectory needs a recording; give its file")
        return names

    def _column(self, name: str) -> Float[np.ndarray, " t"]:
        _, columns = self._read_recorded
        if name not in columns:
            raise InputError(
                f"{self._name}: the recording has no column {name!r}; it has {', '.join(columns)}"
            )
        return columns[name]

    def _inputs(self, courses: Mapping[str, Any]) -> dict[str, Course]:
        require_inputs(self._name, courses, self._model.inputs)
        found: dict[str, Course] = {}
        for name in self._model.inputs:
            if name in courses:
                found[name] = self._course(name, courses[name])
            elif "recording" in self._section:
                found[name] = self._column(name)
            else:
                raise InputError(
                    f'{self._name}: the input {name!r} has no course; give courses a formula of t, a number, or "from FILE"'
                )
        return found

    def _course(self, name: str, text: Any) -> Course:
        """From a number, a formula of the time or a file."""
        if match := FROM_FILE.fullmatch(str(text)):
            times, columns = _read_table(self._folder / match[1])
            if name not in columns:
                raise InputError(
                    f"{self._name}: {match[1]} has no column {name!r}; it has {', '.join(columns)}"
                )
            if times[0] > self._times[0] or times[-1] < self._times[-1]:
                raise InputError(
                    f"{self._name}: {match[1]} covers {times[0]:g} to {times[-1]:g} s of {self._times[0]:g} to "
                    f"{self._times[-1]:g} s; give a longer file or a shorter duration"
                )
            return np.interp(self._times, times, columns[name])
        return FormulaOfTime(text, f"{self._name}: the course of {name}")


class FormulaOfTime:
    """A function of the time t from its formula, of one time or of many."""

    def __init__(self, text: Any, where: str) -> None:
        clock = ca.SX.sym(CLOCK)
        self._function = Compiled.interpreted(
            ca.Function("course", [clock], [formula(text, {CLOCK: clock}, where)])
        )

    def __call__(self, time: float) -> float:
        """At one time."""
        return float(self.at_times(np.array([time]))[0])

    def at_times(self, times: Float[np.ndarray, " t"]) -> Float[np.ndarray, " t"]:
        """At many."""
        return self._function(times[:, np.newaxis])[0][:, 0]


def _read_table(path: Path) -> tuple[Float[np.ndarray, " t"], dict[str, Float[np.ndarray, " t"]]]:
    """Times and the other columns of a table."""
    table = read_csv(path)
    columns = dict(zip(table.names, table.values.T, strict=True))
    found = [name for name in TIMES if name in columns]
    if not found:
        raise InputError(f"{path} has no column of time; name one {', '.join(TIMES)}")
    return columns.pop(found[0]), columns


def _mapping(value: Any, where: str) -> Mapping[str, Any]:
    if not isinstance(value, Mapping):
        raise InputError(f"{where} is {value!r}; give a table")
    return value
