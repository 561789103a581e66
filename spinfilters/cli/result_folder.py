"""Folders of commands that write results and no run."""

from pathlib import Path

from spinfilters.errors import InputError


def refuse_other_results(folder: Path, command: str, result_file: str) -> None:
    """InputError for a folder that holds something else than this command's results."""
    if folder.is_dir() and any(folder.iterdir()) and not (folder / result_file).is_file():
        raise InputError(f"{folder}: is not empty and no result of {command}; choose another folder with -o")
