"""Arguments of every command that takes settings: a file of them, and single ones. Nothing heavy is imported here."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

from spinfilters.io.stated_values import Argument

if TYPE_CHECKING:
    from spinfilters.settings.run_settings import Settings

OWN_SETTINGS: Final = "spinfilters.toml"
"""Settings file of the folder in which a command runs, taken where ``--config`` names no other."""


@dataclass(frozen=True, kw_only=True)
class SettingsArguments:
    """Settings of a command, from a file and one by one."""

    config: Annotated[
        str | None,
        Argument(
            "TOML file with settings, in place of ./spinfilters.toml, such as config.toml of another run; tweddle: those of "
            "section 6.4 of Tweddle (2013)",
            metavar="FILE",
        ),
    ] = None
    set: Annotated[
        tuple[tuple[str], ...],
        Argument(
            "one setting, such as sensors.pixel_std=0.5; has precedence over all others; may be repeated",
            metavar="KEY=VALUE",
        ),
    ] = ()

    @property
    def file(self) -> Path | None:
        """The settings file: the given one, else that of the current folder, if any."""
        if self.config is not None:
            return Path(self.config)
        return Path(OWN_SETTINGS) if Path(OWN_SETTINGS).is_file() else None

    def of_file(self) -> "Settings":
        """Settings of the file, defaults where there is none. InputError: a file that cannot be used."""
        from spinfilters.settings.run_settings import Settings, read_settings

        file = self.file
        return Settings() if file is None else read_settings(file)

    def changed(self, settings: "Settings") -> "Settings":
        """Settings with those that are given one by one. InputError: no setting, or one that cannot be."""
        from spinfilters.settings.run_settings import with_keys

        return with_keys(settings, [text for (text,) in self.set]) if self.set else settings

    def read(self) -> "Settings":
        """Settings of the file, changed by those given one by one. InputError: as both."""
        return self.changed(self.of_file())
