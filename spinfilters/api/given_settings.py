"""Settings as callers give them: a record, a mapping of its keys, or the path of a settings file."""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from spinfilters.io.argument_checks import one_of
from spinfilters.settings.run_settings import Settings, read_settings, settings_from

AnySettings = Settings | Mapping[str, Any] | str | os.PathLike[str]
"""What `chosen_settings` takes."""
SETTINGS_GIVEN: Final = one_of(
    Settings, Mapping, path_of="a settings file", cure="Settings, a mapping of tables, or a path"
)
"""Check of an argument of that kind."""


def chosen_settings(settings: AnySettings) -> Settings:
    """The settings that are given, read and checked.

    Parameters
    ----------
    settings : Settings, Mapping, str or os.PathLike
        The record, keys such as ``{"sensors": {"pixel_std": 0.5}}``, or a TOML file.

    Returns
    -------
    Settings
        All of them; keys that are not given have their defaults.

    Raises
    ------
    InputError
        A file that cannot be read, an unknown key, a value out of its range.
    """
    if isinstance(settings, Settings):
        return settings
    if isinstance(settings, Mapping):
        return settings_from(settings, "settings")
    return read_settings(Path(settings))
