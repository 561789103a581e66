"""``spinfilters observe MODEL.toml``: what the outputs of a user's own equations determine."""

import argparse
from pathlib import Path

from observability import analyse_file
from spinfilters.api.analysis import OBSERVE
from spinfilters.cli.console import wide_console
from spinfilters.core.errors import InputError
from spinfilters.io.output_files import output_folder, refuse_foreign, write_json, write_text

MOTION_OPTIONS = ("torque", "manoeuvre", "known_map", "study")
"""Options of a tumbling body that a model has no use for."""


def observe_model(options: argparse.Namespace) -> int:
    """Analyse a model's file, write text and JSON, print the text."""
    useless = [name for name in MOTION_OPTIONS if getattr(options, name)]
    if useless:
        raise InputError(
            f"--{useless[0].replace('_', '-')} is of a tumbling body; leave it out, a model's file holds all of its equations"
        )
    folder = Path(options.output)
    refuse_foreign(folder, OBSERVE)
    found = analyse_file(options.model)
    with output_folder(folder, OBSERVE) as place:
        write_text(place / "observe.txt", f"{found}\n")
        write_json(place / "observe.json", found.document())
    wide_console().print(f"{found}\nwritten to {folder}", highlight=False, markup=False, soft_wrap=True)
    return 0
