"""Study: a validated table of factors times seeds."""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

from spinfilters.campaigns.factor_table import Cell, cells_of, check_tables, study_options
from spinfilters.campaigns.initial_belief import require_frames
from spinfilters.campaigns.study_options import MOST_RUNS, OPEN_KEYS, StudyOptions
from spinfilters.data.input_file import path_text, read_toml
from spinfilters.errors import InputError


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
    document: as plain tables, from which any process makes the same study.
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
    InputError: missing, not TOML, an unknown table, factor, level or key, a value of another type or out of its range, no seeds.
    """
    return study_from(read_toml(path), path_text(path))


def study_from(document: Mapping[str, Any], source: str) -> Study:
    """Study of parsed TOML; ``source`` names it in errors. Errors: `read_study`."""
    try:
        options = study_options(document)
        check_tables(document)
        cells = tuple(cells_of(document))
        if options.initialisation == "drawn":
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
