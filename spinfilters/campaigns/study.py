"""Study: a validated table of factors times seeds, and the JSON Schema of its file.

A factor is a table of levels; cells are combinations of levels. Where a number may
stand, `{ log_uniform = [0.2, 4.0] }` is drawn per seed: a seed draws the same share of every range of that number,
whatever the cell, so that cells are compared on the same draws.
"""

import hashlib
import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field, fields, replace
from functools import cached_property
from glob import glob
from itertools import product
from pathlib import Path
from typing import Annotated, Any, Final, Literal, get_type_hints

import numpy as np

from spinfilters.campaigns.recording_factors import (
    FACTORS,
    BeliefFactor,
    BodyFactor,
    FaultFactor,
    MotionFactor,
    NoiseFactor,
    RecordingFactors,
    SensorFactor,
    require_frames,
)
from spinfilters.core.errors import InputError
from spinfilters.io.input_file import path_text, read_toml, value_text
from spinfilters.io.stated_values import NumberRange
from spinfilters.run.readers import recordings_in
from spinfilters.settings.run_settings import Settings, settings_from
from spinfilters.settings.setting_validation import validated
from spinfilters.settings.settings_schema import DIALECT, record_schema, settings_schema

LOG_UNIFORM: Final = "log_uniform"
INNER_TABLES: Final = ("sensors", "beside")
"""Tables within a table of factors, here of noise."""


@dataclass(frozen=True)
class DrawnNumber:
    """A number of a table of factors, by its limits."""

    table: str
    key: str
    smallest: float
    largest: float

    def at(self, seeds: np.random.SeedSequence) -> float:
        """Value drawn by the generator of a seed."""
        own = np.random.SeedSequence(
            seeds.entropy, spawn_key=(*seeds.spawn_key, *f"{self.table}.{self.key}".encode())
        )
        share = np.random.default_rng(own).random()
        return float(self.smallest * (self.largest / self.smallest) ** share)


def drawn_numbers(kind: str, table: Mapping[str, Any]) -> tuple[DrawnNumber, ...]:
    """Drawn numbers of a table of factors, but of unknown keys. InputError: limits that do not ascend."""
    found: list[DrawnNumber] = []
    known = {each.name for each in fields(get_type_hints(StudyFile)[kind])}
    for key, value in table.items():
        if isinstance(value, Mapping) and key in INNER_TABLES:
            inner = [
                _number(kind, name, number) for name, number in value.items() if isinstance(number, Mapping)
            ]
            found += [replace(each, key=f"{key}.{each.key}") for each in inner]
        elif isinstance(value, Mapping) and key in known:
            found.append(_number(kind, key, value))
    return tuple(found)


def with_draws(
    factors: RecordingFactors, drawn: tuple[DrawnNumber, ...], seeds: np.random.SeedSequence
) -> RecordingFactors:
    """Factors of one seed with its drawn values."""
    for number in drawn:
        table, value = getattr(factors, number.table), number.at(seeds)
        key, _, inner = number.key.partition(".")
        changed = {**getattr(table, key), inner: value} if inner else value
        factors = replace(factors, **{number.table: replace(table, **{key: changed})})
    return factors


def _number(kind: str, key: str, value: Mapping[str, Any]) -> DrawnNumber:
    limits = value.get(LOG_UNIFORM) if value.keys() == {LOG_UNIFORM} else None
    if not isinstance(limits, list) or not _ascend(limits):
        raise InputError(
            f"{kind}.{key} is {value_text(value)}; give a number, or {{ {LOG_UNIFORM} = [1.0, 2.0] }} with two positive ones that "
            "ascend, with decimal points"
        )
    return DrawnNumber(kind, key, *limits)


def _ascend(limits: list[Any]) -> bool:
    """Whether these are two positive numbers with a decimal point that ascend."""
    return len(limits) == 2 and all(isinstance(x, float) for x in limits) and 0 < limits[0] < limits[1]


MOST_RUNS: Final = 10_000_000
RECORDING: Final = "recording"
"""Factor whose levels are paths of data sets, in place of the factors of what is simulated."""
SIMULATED: Final = ("motion", "body", "sensor", "noise", "fault")
"""Factors of what is simulated."""
OPEN_KEYS: Final = ("seeds", "description", "time_limit_s")
"""Options that may change when a campaign is resumed: no run depends on them."""


@dataclass(frozen=True)
class StudyOptions:
    """The table ``[study]``.

    Attributes
    ----------
    name : str
        Of the study.
    seeds : int
        Runs of every cell.
    root_seed : int
        Of all randomness.
    initialisation : Literal['data', 'drawn']
        "data" as in a comparison, or "drawn": every estimator starts from a belief drawn around the truth.
    bound : Literal['run', 'motion', 'none']
        The Cramer-Rao bound of every "run", that of the first seed of a "motion", or "none".
    epochs : Literal['own', 'common']
        Epochs of errors and NEES: an estimator's "own", which a smoother has from the first one on, or those that filters and
        smoothers have in "common", after the filters' initialisation.
    time_limit_s : float
        Of one run; one that takes longer is ended, with a row that says so.
    """

    name: str
    seeds: Annotated[int, NumberRange(1, MOST_RUNS, whole=True)]
    description: str = ""
    root_seed: Annotated[int, NumberRange(0, 10**18, whole=True)] = 0
    initialisation: Literal["data", "drawn"] = "data"
    bound: Literal["run", "motion", "none"] = "run"
    epochs: Literal["own", "common"] = "own"
    time_limit_s: Annotated[float, NumberRange(1e-3, 1e6, "s")] = 600.0


MOST_CELLS: Final = 10_000
LONGEST_LEVEL: Final = 120
BASE: Final = "base"
"""The level whose table every other level of a factor begins from; that of factors that do not vary."""


@dataclass(frozen=True)
class Cell:
    """One combination of levels.

    Attributes
    ----------
    levels : Mapping[str, str]
        Of every factor, as text: the columns of its rows.
    settings : Settings
        With the cell's estimator alone.
    recording : RecordingFactors
        With the smallest of what is drawn.
    drawn : tuple[DrawnNumber, ...]
        Numbers of it that every seed draws.
    own_recording : str
        Path of a data set that is read in place of a simulated recording; empty of one that is simulated.
    """

    levels: Mapping[str, str]
    recording: RecordingFactors
    belief: BeliefFactor
    settings: Settings
    drawn: tuple[DrawnNumber, ...] = ()
    own_recording: str = ""

    def recording_of(self, seeds: np.random.SeedSequence) -> RecordingFactors:
        """Factors of the recording of a seed."""
        return with_draws(self.recording, self.drawn, seeds)

    @property
    def estimator(self) -> str:
        """Name of the estimator."""
        return self.settings.estimators[0]


def study_options(document: Mapping[str, Any]) -> StudyOptions:
    """The options of a parsed study file.

    InputError: no table [study], no name, no seeds, an unknown or unusable key.
    """
    table = document.get("study")
    if not isinstance(table, Mapping):
        raise InputError("has no table [study]; give one with a name and the number of seeds")
    for key, example in (("name", 'name = "known map"'), ("seeds", "seeds = 100")):
        if key not in table:
            raise InputError(f"study.{key} is missing; give it in [study], such as {example}")
    given = validated(StudyFile, {"study": dict(table)})["study"]
    if not given.name.strip() or not given.name.isprintable() or len(given.name) > 200:
        raise InputError(f"study.name is {value_text(given.name)}; give one line of at most 200 characters")
    return given


@dataclass(frozen=True)
class StudyFile:
    """Tables that are checked as dataclasses."""

    study: StudyOptions
    motion: MotionFactor = field(default_factory=MotionFactor)
    body: BodyFactor = field(default_factory=BodyFactor)
    sensor: SensorFactor = field(default_factory=SensorFactor)
    noise: NoiseFactor = field(default_factory=NoiseFactor)
    fault: FaultFactor = field(default_factory=FaultFactor)
    belief: BeliefFactor = field(default_factory=BeliefFactor)


_TABLES: Final = tuple(each.name for each in fields(StudyFile) if each.name != "study")


def check_tables(document: Mapping[str, Any]) -> None:
    """Require that every table is known and holds tables of levels."""
    if RECORDING in _levels(document):
        unused = next((name for name in document if name in SIMULATED), None)
        unused = unused or next((n for n in document["factors"] if n.split(".")[0] in SIMULATED), None)
        if unused is not None:
            raise InputError(
                f"{unused} is of simulated recordings, and factors.recording names data sets; leave one of them out"
            )
    known = ("study", "factors", *(name for name in FACTORS if name != "estimator"))
    for key, table in document.items():
        if key not in known:
            raise InputError(f"unknown table {value_text(key)}; known are {', '.join(known)}")
        if not isinstance(table, Mapping):
            raise InputError(f"{key} is {value_text(table)}; it must be a table [{key}]")
        if key in ("study", "factors"):
            continue
        for level, values in table.items():
            if not isinstance(values, Mapping):
                raise InputError(
                    f"{key}.{value_text(level)[1:-1]} is {value_text(values)}; give it in a level such as [{key}.{BASE}]"
                )
            used = level == BASE or level in _levels(document).get(key, ())
            if not used:
                raise InputError(
                    f"level {value_text(level)} of {key} is not used; list it under [factors], or call it {BASE} "
                    f'(a name with a dot: [{key}."1.5"])'
                )


def _levels(document: Mapping[str, Any]) -> dict[str, list[Any]]:
    """Levels of every factor in the order of `FACTORS`, factors of single keys before the estimator."""
    table = document.get("factors")
    if not isinstance(table, Mapping) or "estimator" not in table:
        raise InputError('factors.estimator is missing; give it in [factors], such as estimator = ["mekf"]')
    found: dict[str, list[Any]] = {}
    for name, levels in table.items():
        kind = name.split(".")[0]
        if (kind not in FACTORS and name != RECORDING) or (kind == "estimator" and name != kind):
            raise InputError(
                f"unknown factor {value_text(name)}; known are {', '.join((RECORDING, *FACTORS))}, "
                'and single keys such as "noise.pixel_std"'
            )
        _check_levels(name, levels)
        found[name] = levels
    simulated = {name: found.get(name, [BASE]) for name in FACTORS[:-1]}
    if RECORDING in found:
        ordered = {RECORDING: found[RECORDING]} | {name: simulated[name] for name in ("belief", "settings")}
    else:
        ordered = simulated
    single = {name: levels for name, levels in found.items() if "." in name}
    return ordered | single | {"estimator": found["estimator"]}


def _check_levels(name: str, levels: Any) -> None:
    """A list of distinct levels.

    Names where each has a table, values of a single key otherwise.
    """
    if not isinstance(levels, list) or not levels:
        raise InputError(f"factor {value_text(name)} is {value_text(levels)}; give a list of levels")
    if ("." not in name or name == RECORDING) and not all(isinstance(level, str) for level in levels):
        cure = "such as mekf" if name in ("estimator", RECORDING) else f"each with a table [{name}.NAME]"
        raise InputError(f"factor {name} has the levels {value_text(levels)}; give names, {cure}")
    texts = [_text(level) for level in levels]
    odd = next((text for text in texts if not text.isprintable() or not 0 < len(text) <= LONGEST_LEVEL), None)
    if odd is not None:
        raise InputError(
            f"factor {name} has the level {value_text(odd)}; give one line of at most {LONGEST_LEVEL} characters"
        )
    if len(set(texts)) < len(texts):
        raise InputError(
            f"factor {value_text(name)} names a level twice in {value_text(levels)}; name each once"
        )


def _text(level: Any) -> str:
    """A level as its column has it."""
    return level if isinstance(level, str) else json.dumps(level)


def cells_of(document: Mapping[str, Any]) -> Iterator[Cell]:
    """Every combination of levels, checked.

    InputError: a level, key or value that is unknown or unusable; too many cells.
    """
    levels = _levels(document)
    count = math.prod(len(each) for each in levels.values())
    if count > MOST_CELLS:
        raise InputError(f"the factors make {count} cells; give at most {MOST_CELLS}")
    made = _TableMaker(document)
    for combination in product(*levels.values()):
        yield made.cell(dict(zip(levels, combination, strict=True)))


class _TableMaker:
    """Checked tables of levels; the same level is checked once."""

    def __init__(self, document: Mapping[str, Any]) -> None:
        self._document = document
        self._made: dict[str, Any] = {}

    def cell(self, levels: Mapping[str, Any]) -> Cell:
        """The cell of a combination of levels."""
        parts = {kind: self._part(kind, levels) for kind in (*_TABLES, "settings")}
        drawn = tuple(number for part in parts.values() for number in part.drawn)
        tables = {kind: part.table for kind, part in parts.items()}
        settings = replace(tables.pop("settings"), estimators=(levels["estimator"],))
        belief = tables.pop("belief")
        recording = RecordingFactors(**tables)
        text = {name: _text(level) for name, level in levels.items()}
        if RECORDING in levels:
            return Cell(text, recording, belief, settings, (), levels[RECORDING])
        key = "scenario" + str(recording)
        if key not in self._made:
            self._made[key] = recording.scenario  # refuses what cannot be simulated
        return Cell(text, recording, belief, settings, drawn)

    def _part(self, kind: str, levels: Mapping[str, Any]) -> "_Part":
        tables = self._document.get(kind, {})
        level = levels.get(kind, BASE)
        if level != BASE and level not in tables:
            raise InputError(f"level {value_text(level)} of {kind} has no table; give [{kind}.{level}]")
        merged = _merge_tables(tables.get(BASE, {}), tables.get(level, {}))
        for name, value in levels.items():
            if name.startswith(f"{kind}."):
                merged = _merge_tables(merged, _nested(name.split(".")[1:], value))
        key = kind + json.dumps(merged, sort_keys=True)
        if key not in self._made:
            self._made[key] = self._check_table(kind, merged)
        return self._made[key]

    def _check_table(self, kind: str, table: dict[str, Any]) -> "_Part":
        if kind != "settings":
            drawn = () if kind == "belief" else drawn_numbers(kind, table)
            for number in drawn:
                _ = validated(StudyFile, {kind: _nested(number.key.split("."), number.largest)})
            fixed: dict[str, Any] = table
            for number in drawn:
                key, _, inner = number.key.partition(".")
                smallest = {**fixed[key], inner: number.smallest} if inner else number.smallest
                fixed = fixed | {key: smallest}
            return _Part(validated(StudyFile, {kind: fixed})[kind], drawn)
        if "estimators" in table:
            raise InputError("settings.estimators is given by the factor estimator; leave it out")
        return _Part(settings_from(table, "settings"))


@dataclass(frozen=True)
class _Part:
    """A checked table of a level, and what is drawn of it.

    Drawn values stand in the table with the smallest of their range.
    """

    table: Any
    drawn: tuple[DrawnNumber, ...] = ()


def with_recordings(document: Mapping[str, Any]) -> Mapping[str, Any]:
    """The document with the data sets that a folder or a pattern such as ``tosses/*.csv`` names, each by itself.

    Raises
    ------
    InputError
        A path or pattern that names none.
    """
    factors = document.get("factors")
    if not isinstance(factors, Mapping) or RECORDING not in factors:
        return document
    listed = factors[RECORDING]
    paths = [listed] if isinstance(listed, str) else listed
    if not isinstance(paths, list) or not all(isinstance(path, str) and path for path in paths):
        raise InputError(f"factors.{RECORDING} is {value_text(listed)}; give a path, or a list of paths")
    found = [each for path in paths for each in _recordings_of(path)]
    return {**document, "factors": {**factors, RECORDING: list(dict.fromkeys(found))}}


def _recordings_of(path: str) -> list[str]:
    """Paths that one entry names: itself, those of a pattern, or those in a folder that is no data set itself."""
    if any(mark in path for mark in "*?["):
        found = sorted(glob(path))
    else:
        found = [str(each) for each in recordings_in(Path(path))] or ([path] if Path(path).exists() else [])
    if not found:
        raise InputError(f"factors.{RECORDING}: {value_text(path)} names no data set; check the path")
    return found


def _merge_tables(first: Mapping[str, Any], second: Mapping[str, Any]) -> dict[str, Any]:
    """Tables with those of the second in place of the first's, key by key."""
    merged = dict(first)
    for key, value in second.items():
        inner = merged.get(key)
        if isinstance(inner, Mapping) and isinstance(value, Mapping):
            merged[key] = _merge_tables(inner, value)
        else:
            merged[key] = value
    return merged


def _nested(keys: list[str], value: Any) -> dict[str, Any]:
    """A value in tables of tables."""
    for key in reversed(keys):
        value = {key: value}
    return value


@dataclass(frozen=True)
class CampaignRun:
    """One run: its number, its cell's number and its seed's."""

    index: int
    cell: int
    seed: int


@dataclass(frozen=True, eq=False)
class Study:
    """A checked study.

    Attributes
    ----------
    document : Mapping[str, Any]
        As plain tables, from which any process makes the same study.
    """

    options: StudyOptions
    cells: tuple[Cell, ...]
    document: Mapping[str, Any] = field(repr=False)

    @property
    def name(self) -> str:
        """Name of the study."""
        return self.options.name

    def __len__(self) -> int:
        """Number of runs."""
        return len(self.cells) * self.options.seeds

    def run(self, index: int) -> CampaignRun:
        """Run of this number; runs are ordered by seed, then by cell."""
        seed, cell = divmod(index, len(self.cells))
        return CampaignRun(index, cell, seed)

    @property
    def estimators(self) -> int:
        """Number of consecutive runs that share recording and settings."""
        return len({cell.estimator for cell in self.cells})

    @cached_property
    def fingerprint(self) -> str:
        """Digest of everything that a run depends on."""
        kept = {key: value for key, value in asdict(self.options).items() if key not in OPEN_KEYS}
        if kept["epochs"] == "own":  # an option that earlier studies do not have
            del kept["epochs"]
        text = json.dumps([kept, {k: v for k, v in self.document.items() if k != "study"}], sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:24]

    @property
    def levels(self) -> list[Mapping[str, str]]:
        """Levels of the factors, of every cell."""
        return [cell.levels for cell in self.cells]

    @property
    def columns(self) -> list[str]:
        """Names of the factors."""
        return list(self.cells[0].levels)

    @property
    def varied(self) -> list[str]:
        """Names of the factors with more than one level."""
        return [name for name in self.columns if len({cell.levels[name] for cell in self.cells}) > 1]


def read_study(path: Path) -> Study:
    """Study of a TOML file.

    Raises
    ------
    InputError
        Missing, not TOML, an unknown table, factor, level or key, a value of another type or out of its
        range, no seeds.
    """
    return study_from(read_toml(path), path_text(path))


def study_from(document: Mapping[str, Any], source: str) -> Study:
    """Study of parsed TOML; ``source`` names it in errors. Errors: `read_study`."""
    try:
        options = study_options(document)
        document = with_recordings(document)
        check_tables(document)
        cells = tuple(cells_of(document))
        own = any(cell.own_recording for cell in cells)
        if own and options.initialisation == "data" and options.seeds > 1:
            raise InputError(
                "nothing of own recordings is drawn, so that all seeds are one run; give seeds = 1 and more recordings, or "
                'initialisation = "drawn", which draws beliefs about the truth of each (truth.csv)'
            )
        if options.initialisation == "drawn" and not own:
            for cell in cells:
                require_frames(cell.recording.sensor)
        if len(cells) * options.seeds > MOST_RUNS:
            raise InputError(
                f"{len(cells)} cells times {options.seeds} seeds are more than {MOST_RUNS} runs; give fewer"
            )
        return Study(options, cells, json.loads(json.dumps(document)))
    except InputError as error:
        raise InputError(f"{source}: {error}") from None
    except (TypeError, ValueError) as error:  # dates and the like, which JSON has not
        raise InputError(
            f"{source}: holds a value that no factor takes ({error}); give numbers and texts"
        ) from None


DRAWN: Final[dict[str, Any]] = {
    "type": "object",
    "description": "A number that every seed draws, uniform in its logarithm between two limits.",
    "properties": {LOG_UNIFORM: {"type": "array", "items": {"type": "number"}, "minItems": 2, "maxItems": 2}},
    "required": [LOG_UNIFORM],
    "additionalProperties": False,
}


def study_schema() -> dict[str, Any]:
    """JSON Schema of a study file; every factor's table holds levels, each with the keys of the factor."""
    hints = get_type_hints(StudyFile)
    tables = {each.name: record_schema(hints[each.name]) for each in fields(StudyFile)}
    levels = {"type": "array", "minItems": 1}
    settings = {key: value for key, value in settings_schema().items() if key != "$schema"}
    settings["properties"] = {k: v for k, v in settings["properties"].items() if k != "estimators"}
    definitions = settings.pop("$defs")
    properties: dict[str, Any] = {
        "study": tables.pop("study"),
        "factors": {
            "type": "object",
            "required": ["estimator"],
            "properties": dict.fromkeys((RECORDING, *FACTORS), levels) | {RECORDING: {}},
            "patternProperties": {rf"^({'|'.join(FACTORS)})\.": levels},
            "additionalProperties": False,
        },
    }
    for name, table in (*tables.items(), ("settings", settings)):
        definitions |= table.pop("$defs", {})
        if name not in ("settings", "belief"):
            held = table["properties"]
            table["properties"] = {key: _or_drawn(schema) for key, schema in held.items()}
        properties[name] = {
            "type": "object",
            "description": f"Levels of the factor {name}; the others begin from {BASE}.",
            "additionalProperties": table,
        }
    return {
        "$schema": DIALECT,
        "title": "Study of spinfilters",
        "type": "object",
        "required": ["study", "factors"],
        "properties": properties,
        "additionalProperties": False,
        "$defs": definitions,
    }


def _or_drawn(schema: dict[str, Any]) -> dict[str, Any]:
    """Schema of a key that every seed may draw; of a table, each of its numbers may be."""
    if isinstance(inner := schema.get("additionalProperties"), dict):
        return {**schema, "additionalProperties": {"anyOf": [inner, DRAWN]}}
    return {"anyOf": [schema, DRAWN]}
