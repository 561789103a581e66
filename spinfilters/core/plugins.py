"""Plug-ins: entries that installed distributions add to a registry through entry points.

A registry names its own members in a tuple of one module, and adds those of others when it is asked for them::

    OWN = (ATTITUDE, GYRO, POSE)

    def all_sensors() -> tuple[Sensor, ...]:
        return (*OWN, *installed_plugins("spinfilters.sensors", Sensor))

A layer below such a tuple that needs its members, as files need the formats of all sensors, gets them by `members_above`.
"""

from collections.abc import Callable, Iterable
from functools import cache
from typing import TYPE_CHECKING, Protocol, TypeVar

from spinfilters.core.errors import InputError

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint


class NamedEntry(Protocol):
    """Entry of a registry that has a name."""

    @property
    def name(self) -> str:
        """Its name, which no other entry has."""
        ...


class OrderedEntry(NamedEntry, Protocol):
    """Entry of a registry with a name and a place in the order."""

    @property
    def order(self) -> int:
        """Its place: entries are sorted by it."""
        ...


Entry = TypeVar("Entry")
Narrower = TypeVar("Narrower")
Named = TypeVar("Named", bound=NamedEntry)
Ordered = TypeVar("Ordered", bound=OrderedEntry)


@cache
def installed_plugins(group: str, kind: type[Entry]) -> tuple[Entry, ...]:
    """Entries that installed distributions register, loaded at the first call.

    Tests that install a plug-in call ``installed_plugins.cache_clear()`` before and after.

    Parameters
    ----------
    group : str
        Name of the entry points, such as "spinfilters.sensors".
    kind : type
        Class that every entry is an instance of.

    Raises
    ------
    InputError
        An entry point that cannot be imported, or is not of the kind; the text names it.
    """
    from importlib import metadata  # here: the package imports this module first, and metadata is slow

    return tuple(_loaded(group, kind, point) for point in metadata.entry_points(group=group))


_MEMBERS: dict[str, Callable[[], tuple[object, ...]]] = {}


def bind_members(group: str, members: Callable[[], tuple[object, ...]]) -> None:
    """Register where the package's own members of a group are defined.

    The top of the package does so (`spinfilters.registries`), which knows the modules above the layers that ask.

    Parameters
    ----------
    group : str
        Name of the entry points of the same kind.
    members : callable
        Gives the members, and imports them when it is called for the first time.
    """
    _MEMBERS[group] = members


def members_above(group: str, kind: type[Entry]) -> tuple[Entry, ...]:
    """The package's own members of a group, then those of installed distributions.

    Parameters
    ----------
    group : str
        Name of the group, bound by `bind_members`.
    kind : type
        Class that every entry is an instance of.

    Raises
    ------
    InputError
        As `installed_plugins`.
    """
    own = _MEMBERS[group]()
    assert all(isinstance(entry, kind) for entry in own)
    return (*own, *installed_plugins(group, kind))  # pyright: ignore[reportReturnType]


def entries_of_kind(entries: Iterable[object], kind: type[Narrower]) -> tuple[Narrower, ...]:
    """Entries, as the kind that a layer above knows them by.

    Raises
    ------
    InputError
        One that is not of that kind: a plug-in that only a layer below can use.
    """
    found = []
    for entry in entries:
        if not isinstance(entry, kind):
            raise InputError(
                f"the registered {type(entry).__name__} is no {kind.__name__}; mend or uninstall it"
            )
        found.append(entry)
    return tuple(found)


def entries_by_name(entries: Iterable[Named], what: str) -> dict[str, Named]:
    """Entries by name, in the order given.

    Parameters
    ----------
    entries : iterable
        Members of a registry; sort them by their ``order`` first, where they have one.
    what : str
        What an entry is, for the message: "estimator".

    Raises
    ------
    InputError
        A name that two entries have.
    """
    found: dict[str, Named] = {}
    for entry in entries:
        if entry.name in found:
            raise InputError(f"{what} {entry.name!r} is registered twice; uninstall one of the plug-ins")
        found[entry.name] = entry
    return found


def in_order(entries: Iterable[Ordered]) -> list[Ordered]:
    """Entries sorted by their ``order``; those of equal order stay as they are."""
    return sorted(entries, key=lambda entry: entry.order)


def _loaded(group: str, kind: type[Entry], point: "EntryPoint") -> Entry:
    """The object that an entry point names."""
    where = f"plug-in {point.name!r} ({point.value}) of the group {group}"
    try:
        entry = point.load()
    except Exception as error:  # a stranger's module may raise anything
        why = " ".join(f"{type(error).__name__}: {error}".split())
        raise InputError(f"{where} cannot be loaded: {why[:120]}; mend or uninstall it") from error
    if not isinstance(entry, kind):
        raise InputError(f"{where} is {type(entry).__name__}, not a {kind.__name__}; mend or uninstall it")
    return entry
