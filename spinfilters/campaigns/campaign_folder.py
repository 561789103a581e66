"""Folder of a campaign: its study, its provenance and its rows."""

import json
import platform
from collections.abc import Collection
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final

from spinfilters.campaigns.rows_folder import ROWS
from spinfilters.campaigns.study import Study, read_study
from spinfilters.core.errors import InputError
from spinfilters.io.input_file import path_text, read_settings_text
from spinfilters.io.output_files import write_json, write_toml
from spinfilters.run.provenance import git_commit

STUDY_FILE: Final = "campaign.toml"
BEGUN_FILE: Final = "campaign.json"
SCHEMA: Final = 1


def open_folder(folder: Path, study: Study, resume: bool) -> None:
    """Create or resume a campaign's folder, holding its lock.

    Raises
    ------
    InputError
        It holds something else, another study, or rows although the campaign is not resumed.
    """
    held = [
        path.name
        for path in folder.iterdir()
        if path.name not in (".lock",) and not path.name.endswith(".part")
    ]
    if held:
        _require_same(folder, study)
        if not resume and any((folder / ROWS).glob("*")):
            raise InputError(
                f"{path_text(folder)}: holds rows of this study; give --resume to continue, or another folder with -o"
            )
    if not (folder / BEGUN_FILE).exists():
        write_json(folder / BEGUN_FILE, begun(study))


def keep_study(folder: Path, study: Study, done: Collection[int]) -> None:
    """Write the study into the folder of its rows.

    InputError: there are rows of more seeds than it has.
    """
    if done and (last := max(done)) >= len(study):
        seeds = study.run(last).seed + 1
        raise InputError(
            f"{path_text(folder)}: holds runs of {seeds} seeds, study.seeds is {study.options.seeds}; give at least {seeds}, "
            "or another folder with -o"
        )
    write_toml(folder / STUDY_FILE, dict(study.document))


def begun(study: Study) -> dict[str, Any]:
    """Provenance of a campaign: commit, machine, date."""
    return {
        "schema": SCHEMA,
        "study": study.name,
        "fingerprint": study.fingerprint,
        "begun": datetime.now(UTC).isoformat(timespec="seconds"),
        "commit": git_commit() or "not a checkout",
        "machine": machine(),
    }


def machine() -> str:
    """This machine's processor and system in one line."""
    lines = Path("/proc/cpuinfo")
    model = ""
    if lines.exists():
        models = (
            line.split(":", 1)[1].strip()
            for line in lines.read_text().splitlines()
            if line.startswith("model name")
        )
        model = next(models, "")
    return f"{model or platform.machine()}, {platform.system()} {platform.release()}"


def read_folder(folder: Path) -> tuple[Study, dict[str, Any]]:
    """A campaign's study and its provenance.

    Raises
    ------
    InputError
        No folder of a campaign, or a damaged one.
    """
    if not (folder / STUDY_FILE).is_file() or not (folder / BEGUN_FILE).is_file():
        raise InputError(
            f"{path_text(folder)}: is no campaign's folder; give one made by 'spinfilters campaign'"
        )
    return read_study(folder / STUDY_FILE), _read_provenance(folder)


def _read_provenance(folder: Path) -> dict[str, Any]:
    """Provenance of a campaign's begin. InputError: damaged, or of another version."""
    try:
        document = json.loads(read_settings_text(folder / BEGUN_FILE))
    except (ValueError, RecursionError):
        document = None
    if not isinstance(document, dict) or document.get("schema") != SCHEMA:
        raise InputError(
            f"{path_text(folder / BEGUN_FILE)}: is damaged or of another version; run the campaign again"
        )
    return document


def _require_same(folder: Path, study: Study) -> None:
    if not (folder / BEGUN_FILE).exists():
        raise InputError(
            f"{path_text(folder)}: is not empty and no campaign's folder; choose another folder with -o"
        )
    if _read_provenance(folder).get("fingerprint") != study.fingerprint:
        raise InputError(
            f"{path_text(folder)}: holds another study than {study.name!r}; choose another folder with -o"
        )
