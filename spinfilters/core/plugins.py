"""Plug-ins: entries that installed distributions add to a registry through entry points.

A registry names its own members in a tuple of one module, and adds those of others when it is asked for them::

    OWN = (ATTITUDE, GYRO, POSE)

    def all_sensors() -> tuple[Sensor, ...]:
        return (*OWN, *installed_plugins("spinfilters.sensors", Sensor))

A layer below such a tuple that needs its members, as files need the formats of all sensors, gets them by `members_above`.
"""

from collections.abc import Callable, Iterable
from enum import EnumType
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
        An entry point that cannot be imported, is not of the kind, or has an attribute of another type than the kind states;
        the text names it. Entry points that cannot be read.
    """
    from importlib import metadata  # here: the package imports this module first, and metadata is slow

    try:
        points = metadata.entry_points(group=group)
    except Exception as error:  # of a file that is none of ours
        raise _malformed(group, error) from error
    return tuple(_load_entry_point(group, kind, point) for point in points)


_MEMBERS: dict[str, Callable[[], tuple[object, ...]]] = {}


def bind_members(group: str, members: Callable[[], tuple[object, ...]]) -> None:
    """Register where the package's own members of a group are defined.

    The top of the package does so (`spinfilters`), which knows the modules above the layers that ask.

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
    return (*_own_members(_MEMBERS[group], kind), *installed_plugins(group, kind))


@cache
def _own_members(members: Callable[[], tuple[object, ...]], kind: type[Entry]) -> tuple[Entry, ...]:
    """Members of the package, imported and looked at once: commands ask for them thousands of times."""
    own = members()
    assert all(isinstance(entry, kind) for entry in own)
    return own  # pyright: ignore[reportReturnType]


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


def require_made(value: object, kind: type[Entry], what: str) -> Entry:
    """A value that an entry of a registry made, which may be a plug-in's.

    Parameters
    ----------
    value : object
        The value.
    kind : type
        Class that it must be an instance of.
    what : str
        What made it, for the message: "reader 'mine'".

    Raises
    ------
    InputError
        A value of another type.
    """
    if not isinstance(value, kind):
        raise InputError(
            f"the {what} made {type(value).__name__}, not {kind.__name__}; mend or uninstall its plug-in"
        )
    return value


def require_file_name(name: object, what: str) -> None:
    """Refuse a name that would not be that of a file in the folder of a run.

    Parameters
    ----------
    name : object
        The name.
    what : str
        Whose it is, for the message.

    Raises
    ------
    InputError
        No text, an empty one, or one with a separator of folders.
    """
    if not _is_file_name(name):
        raise InputError(
            f"the {what} has the name {name!r:.40}, which is no name of a file; mend or uninstall its plug-in"
        )


def plugin_in(error: BaseException) -> str | None:
    """The plug-in whose code was running when an error was raised, with what it raised; None where there was none.

    Parameters
    ----------
    error : BaseException
        An error with its traceback.
    """
    trace = error.__traceback__
    while trace is not None:
        top = str(trace.tb_frame.f_globals.get("__name__", "")).partition(".")[0]
        if top in _MODULES:
            return f"{_MODULES[top]} failed: {_text_of(error)}"
        trace = trace.tb_next
    return None


def _load_entry_point(group: str, kind: type[Entry], point: "EntryPoint") -> Entry:
    """The object that an entry point names."""
    where = f"plug-in {point.name!r} ({point.value}) of the group {group}"
    try:
        entry = point.load()
        wrong = "" if isinstance(entry, kind) else f"is {type(entry).__name__}, not a {kind.__name__}"
        wrong = wrong or _wrong_attribute(entry, kind)
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # another author's module may raise anything, an exit among it
        raise InputError(f"{where} cannot be loaded: {_text_of(error)}; mend or uninstall it") from error
    if wrong:
        raise InputError(f"{where} {wrong}; mend or uninstall it")
    _MODULES[point.value.partition(":")[0].partition(".")[0].strip()] = where
    return entry


_MODULES: dict[str, str] = {}
"""What loaded plug-ins are called in messages, by the topmost package of their modules."""


def _wrong_attribute(entry: object, kind: type) -> str:
    """What is wrong with an attribute for which the class of the entry states a plain type; empty if nothing is."""
    for name, stated in _stated_types(kind).items():
        if not hasattr(entry, name):
            return f"has no {name}"
        value = getattr(entry, name)
        if not isinstance(value, (float, int) if stated is float else stated):
            return f"has the {name} {value!r:.40}, which is not of type {stated.__name__}"
    if "name" in _stated_types(kind):
        name: object = getattr(entry, "name", None)
        return "" if _is_file_name(name) else f"has the name {name!r:.40}, which is no name of a file"
    return ""


def _is_file_name(name: object) -> bool:
    """Whether a name can be that of a file or a folder of a run."""
    return isinstance(name, str) and name.isprintable() and bool(name.strip(". ")) and not {*"/\\"} & {*name}


def _stated_types(kind: type) -> dict[str, type]:
    """Attributes whose annotation in a class or its bases is a class itself, by name."""
    from inspect import get_annotations  # of plug-ins only: every command would load it first

    found: dict[str, type] = {}
    for each in reversed(kind.__mro__):
        found |= {
            name: stated for name, stated in get_annotations(each).items() if type(stated) in {type, EnumType}
        }
    return found


def _text_of(error: BaseException) -> str:
    """Type and text of any error in one line of bounded length."""
    try:
        text = " ".join(str(error)[:500].split())
    except Exception:  # its own text fails, too
        text = ""
    return f"{type(error).__name__}: {text:.120}" if text else type(error).__name__


def _malformed(group: str, error: Exception) -> InputError:
    """The refusal of entry points that cannot be read, which names the distribution that has them."""
    from importlib import metadata

    for each in metadata.distributions():
        try:
            tuple(each.entry_points)
        except Exception:
            return InputError(
                f"entry_points.txt of the installed {each.name} cannot be read ({_text_of(error)}); mend or uninstall it"
            )
    return InputError(
        f"the entry points {group} cannot be read ({_text_of(error)}); mend or uninstall what was installed last"
    )
