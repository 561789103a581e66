"""Registries filled by modules of a package and entry points.

Those of installed distributions.
"""

from dataclasses import dataclass
from functools import cached_property
from importlib import import_module, metadata
from pkgutil import iter_modules
from typing import Generic, Protocol, TypeVar

from spinfilters.errors import InputError


class OrderedEntry(Protocol):
    """Table entry with a name and a place in the order."""

    name: str
    order: int


Entry = TypeVar("Entry")
Narrower = TypeVar("Narrower")
Ordered = TypeVar("Ordered", bound=OrderedEntry)


@dataclass(frozen=True)
class PluginGroup(Generic[Entry]):
    """Entries of one kind, found when they are first asked for.

    Every module of ``package`` that has ``attribute``, an entry or a tuple of them, contributes it, in the order of module names;
    behind them so does every entry point of ``group``, which is called like the package where nobody says otherwise.
    A layer that only knows the kind ``kind`` thus meets the entries of layers
    above it, and those of distributions that did not exist when it was written.
    """

    package: str
    attribute: str
    kind: type[Entry]
    group: str = ""

    @cached_property
    def entries(self) -> tuple[Entry, ...]:
        """All entries.

        Raises
        ------
        InputError: an entry point that cannot be imported, or is not of the kind; the text names it.
        """
        return (*self._own(), *map(self._foreign, metadata.entry_points(group=self._group)))

    def entries_of(self, kind: type[Narrower]) -> tuple[Narrower, ...]:
        """All entries, as the kind that a layer above knows them by.

        Raises
        ------
        InputError: as `entries`; one that is not of that kind.
        """
        found = []
        for entry in self.entries:
            if not isinstance(entry, kind):
                raise InputError(
                    f"the registered {type(entry).__name__} is no {kind.__name__}; mend or uninstall it"
                )
            found.append(entry)
        return tuple(found)

    @property
    def _group(self) -> str:
        return self.group or self.package

    def reload(self) -> None:
        """Look for entries again: distributions may have come or gone."""
        self.__dict__.pop("entries", None)

    def _own(self) -> list[Entry]:
        names = sorted(module.name for module in iter_modules(import_module(self.package).__path__))
        modules = [import_module(f"{self.package}.{name}") for name in names]
        found = [vars(module)[self.attribute] for module in modules if self.attribute in vars(module)]
        return [entry for each in found for entry in (each if isinstance(each, tuple) else (each,))]

    def _foreign(self, point: metadata.EntryPoint) -> Entry:
        where = f"plug-in {point.name!r} ({point.value}) of the group {self._group}"
        try:
            entry = point.load()
        except Exception as error:  # a stranger's module may raise anything
            why = " ".join(f"{type(error).__name__}: {error}".split())
            raise InputError(f"{where} cannot be loaded: {why[:120]}; mend or uninstall it") from error
        if not isinstance(entry, self.kind):
            raise InputError(
                f"{where} is {type(entry).__name__}, not a {self.kind.__name__}; mend or uninstall it"
            )
        return entry


def by_name(group: PluginGroup[Ordered], what: str) -> dict[str, Ordered]:
    """Entries by name, in their order. InputError: as `PluginGroup.entries`; a name that stands twice.

    Parameters
    ----------
    what: an entry is, in words.
    """
    found: dict[str, Ordered] = {}
    for entry in sorted(group.entries, key=lambda entry: entry.order):
        if entry.name in found:
            raise InputError(f"{what} {entry.name!r} is registered twice; uninstall one of the plug-ins")
        found[entry.name] = entry
    return found
