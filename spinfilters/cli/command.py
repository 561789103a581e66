"""A command of ``spinfilters``: its record of arguments, the parser that is made from it, and the function that runs it.

Nothing heavy is imported here, so that help and refusals are quick.
"""

import argparse
from collections.abc import Callable, Iterable
from dataclasses import MISSING, dataclass
from typing import Annotated, Any, Final, Generic, TypeVar

from spinfilters.cli.common_options import FigureOptions, PrintingOptions, common_options
from spinfilters.io.argument_fields import GivenField, given_fields, numbers_by_name, record_from
from spinfilters.io.stated_values import Argument, NumberRange

R = TypeVar("R")
VERBOSE: Final = "print warnings of numbers, the trace of an unexpected error, time and memory"
"""Of every command."""
Panels = Annotated[bool, Argument("one panel a file, cut out of its figure")]
"""Of commands that print figures."""
PrintWidth = Annotated[
    float | None,
    NumberRange(20.0, 1000.0, "mm"),
    Argument("width of a printed figure or panel, mm: 84 for a column, 174 for two", metavar="MM"),
]
"""Of commands that print figures."""


@dataclass(frozen=True)
class Command(Generic[R]):
    """A command.

    Attributes
    ----------
    name : str
        On the command line.
    arguments : type
        Record of its arguments, each an annotated field (`spinfilters.io.stated_values.Argument`).
    run : Callable[[record], int]
        Takes the record and returns the exit code. It imports what it needs when it is called: a refused argument needs nothing.
    description : str
        Above the arguments in its own help.
    help : str
        One line in the list of actions; of a command that is no action, the table of commands has it.
    common : type or None
        Options that it shares with others (`spinfilters.cli.common_options`); None for a command that only prints.
    """

    name: str
    arguments: type[R]
    run: Callable[[R], int]
    description: str = ""
    help: str = ""
    common: type[PrintingOptions] | None = None

    @property
    def parts(self) -> "tuple[tuple[str, Command[Any]], ...]":
        """The command alone, with the word that calls it."""
        return ((self.name, self),)

    @property
    def fields(self) -> tuple[GivenField, ...]:
        """Its own arguments, then those that it shares with others."""
        shared = () if self.common is None else given_fields(self.common)
        return (*given_fields(self.arguments), *shared)

    def fill(self, parser: Any) -> None:
        """Add the description, the arguments and what runs it to a parser."""
        parser.description = self.description or None
        add_arguments(parser, self.fields)
        parser.add_argument("-v", "--verbose", action="store_true", help=VERBOSE)
        parser.required = {}
        for each in self.fields:
            if each.default is MISSING:
                # argparse calls an argument so in its messages
                name = f"{each.argument.short}/{each.flag}" if each.argument.short else each.flag
                parser.required[name] = f"{each.usage} ({each.argument.help})"
        flags = [each for action in parser._actions for each in action.option_strings]  # pyright: ignore[reportAttributeAccessIssue]
        parser.set_defaults(command=self, flags=tuple(flags))

    def run_parsed(self, options: argparse.Namespace) -> int:
        """Run it with parsed arguments. InputError: an argument that cannot be used."""
        arguments = arguments_from(self.arguments, options)
        shared = arguments_from(self.common, options) if self.common is not None else PrintingOptions()
        with common_options(FigureOptions(**vars(shared))):
            return self.run(arguments)


@dataclass(frozen=True)
class CommandGroup:
    """Commands under one name, such as ``lidar scan`` and ``lidar needed``.

    Attributes
    ----------
    default : str
        Name of the action where the first word names none; empty where one has to be named.
    """

    name: str
    actions: tuple[Command[Any], ...]
    default: str = ""
    description: str = ""

    @property
    def parts(self) -> tuple[tuple[str, Command[Any]], ...]:
        """The actions of the group, each with the words that call it."""
        return tuple((f"{self.name} {action.name}", action) for action in self.actions)

    def fill(self, parser: Any) -> None:
        """Add the description and the parsers of all actions to a parser."""
        parser.description = self.description or None
        actions = parser.add_subparsers(title="actions", required=True, metavar="ACTION")
        for action in self.actions:
            action.fill(actions.add_parser(action.name, help=action.help))
        parser.actions, parser.default_action = tuple(action.name for action in self.actions), self.default


def add_arguments(parser: argparse.ArgumentParser, given: Iterable[GivenField]) -> None:
    """Add an argument for each of some given fields, in their order."""
    groups: dict[str, Any] = {"": parser}
    for field in given:
        if field.group not in groups:
            groups[field.group] = parser.add_argument_group(field.group)
        flags, options = _argparse_options(field)
        groups[field.group].add_argument(*flags, **options)


def _argparse_options(field: GivenField) -> tuple[tuple[str, ...], dict[str, Any]]:
    """Flags and keywords of a field's ``add_argument``."""
    argument, required = field.argument, field.default is MISSING
    options: dict[str, Any] = {"help": field.help.replace("%", "%%")}
    if argument.positional:
        flags: tuple[str, ...] = (field.name,)
        options |= {} if required or field.count == 0 else {"nargs": "?"}
    else:
        flags = (argument.short, field.flag) if argument.short else (field.flag,)
        options |= {"dest": field.name, "required": required}
    if field.kind is bool:
        del options["required"]
        return flags, {**options, "action": "store_true"}
    options["default"] = None if required else field.default
    options |= {"metavar": argument.metavar} if argument.metavar else {}
    if field.is_named:
        return flags, {
            **options,
            "default": None,
            "nargs": 2 if argument.bare is None else "+",
            "action": "append",
        }
    if field.count is not None:
        options["nargs"] = field.count or "+"
    if field.is_repeated:
        options |= {"action": "append", "default": None}
    if field.choices is not None:
        options |= {"choices": field.choices, "type": type(field.choices[0])}
    elif field.allowed is not None:
        options["type"] = number(field.allowed)
    return flags, options


def arguments_from(record: type[R], options: argparse.Namespace) -> R:
    """Record of parsed arguments. InputError: one that the record refuses."""
    values: dict[str, Any] = {}
    for field in given_fields(record):
        value = getattr(options, field.name)
        if field.is_named:
            value = numbers_by_name(field, value or ())
        elif isinstance(value, list):
            value = tuple(tuple(each) if isinstance(each, list) else each for each in value)
        if value is not None or field.is_optional:
            values[field.name] = value
    return record_from(record, values)


def number(allowed: NumberRange) -> Callable[[str], float | int]:
    """Argument parser for numbers within a range."""

    def parsed(text: str) -> float | int:
        """The number, in its range."""
        try:
            return allowed.parsed(text)
        except ValueError as error:
            raise argparse.ArgumentTypeError(str(error)) from None

    return parsed
