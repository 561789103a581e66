"""Values stated by users: ranges of numbers, arguments of commands and functions, units and clock of a recording."""

import math
from dataclasses import dataclass, fields
from typing import Annotated, Any, Final

from spinfilters.core.errors import InputError
from spinfilters.io.input_file import value_text


class FieldNote:
    """Note in the annotation of a record's field: a range, an argument, a group of arguments, or a key of a study file.

    Each kind of note is found under its own name, and is None of the other kinds.
    """

    @property
    def range(self) -> "NumberRange | None":
        """Range of the field's numbers."""
        return None

    @property
    def argument(self) -> "Argument | None":
        """How users give the field."""
        return None

    @property
    def group(self) -> "ArgumentGroup | None":
        """How users give the fields of the record in the field."""
        return None

    @property
    def study_key(self) -> "StudyKey | None":
        """Place of the field in a study file."""
        return None


@dataclass(frozen=True)
class NumberRange(FieldNote):
    """Range of finite numbers, optionally with zero apart from it.

    Attributes
    ----------
    unit : str
        For messages, may be empty.
    zero : bool
        Whether 0 is allowed too.
    whole : bool
        Whether only whole numbers are.
    """

    smallest: float
    largest: float
    unit: str = ""
    zero: bool = False
    whole: bool = False

    @property
    def range(self) -> "NumberRange":
        """Itself."""
        return self

    def __contains__(self, value: object) -> bool:
        """Whether a value is a number of the range, NumPy's among them; truth values are none."""
        value = plain_number(value)
        if isinstance(value, bool) or not isinstance(value, int | float):
            return False
        if self.whole and not isinstance(value, int):
            return False
        return self.smallest <= value <= self.largest or (self.zero and value == 0)

    def __str__(self) -> str:
        kind = "a whole number" if self.whole else "a number"
        zero = "0 or " if self.zero and self.smallest > 0 else ""
        return f"{zero}{kind} from {self.smallest:.6g} to {self.largest:.6g} {self.unit}".rstrip()

    def require(self, name: str, value: object) -> None:
        """Raise InputError, which names what it is, its value and the range, for a value outside."""
        if value not in self:
            raise InputError(f"{name} is {value_text(value)}; give {self}")

    def __get_pydantic_core_schema__(self, _source: object, _handler: object) -> Any:
        """Pydantic validation of a field by its annotated range; Booleans and text are refused."""
        from pydantic_core import core_schema  # only settings need it

        number = core_schema.int_schema(strict=True) if self.whole else core_schema.float_schema(strict=True)
        plain = core_schema.no_info_before_validator_function(plain_number, number)
        return core_schema.no_info_after_validator_function(self._check_value, plain)

    def __get_pydantic_json_schema__(self, core: Any, handler: Any) -> dict[str, Any]:
        """JSON Schema of a number of the range."""
        limits = {"minimum": self.smallest, "maximum": self.largest}
        if not self.zero or self.smallest <= 0:
            return {**handler(core), **limits}
        return {"anyOf": [{**handler(core), **limits}, {"const": 0}]}

    def _check_value(self, value: float) -> float:
        if value not in self:
            raise ValueError(f"give {self}")
        return value

    def parsed(self, text: str) -> float | int:
        """Number parsed from a text.

        Raises
        ------
        ValueError
            The text is no number of the range, with what to give.
        """
        try:
            value: float | int = int(text) if self.whole else float(text)
        except ValueError:
            value = math.nan
        if value not in self:
            raise ValueError(f"{value_text(text)} is not allowed; give {self}")
        return value


def plain_number(value: object) -> Any:
    """Number or truth value of Python for a NumPy scalar or array without axes, anything else as it is."""
    if getattr(value, "ndim", None) != 0 or not hasattr(value, "item"):
        return value
    item: Any = value.item()  # pyright: ignore[reportAttributeAccessIssue]
    return item if getattr(item, "ndim", None) is None else float(item)  # long double has no Python number


@dataclass(frozen=True)
class Argument(FieldNote):
    """How users give a field of a record.

    Attributes
    ----------
    help : str
        What it is, with its unit; the default is added to it.
    name : str
        By which Python and the parsed arguments know it; empty for the name of the field.
    flag : str
        On the command line; empty for ``--name``.
    short : str
        Second, short flag, such as ``-o``.
    metavar : str or tuple[str, ...]
        Of the value or values in the help; empty for the name in capitals.
    positional : bool
        Whether the command line takes it by its place, without a flag.
    cure : str
        What to give where a value is refused; empty where the type or range says it.
    bare : float or None
        Value of a name alone, in a field of numbers by name; None where each name needs a number.
    """

    help: str
    name: str = ""
    flag: str = ""
    short: str = ""
    metavar: str | tuple[str, ...] = ""
    positional: bool = False
    cure: str = ""
    bare: float | None = None

    @property
    def argument(self) -> "Argument":
        """Itself."""
        return self


@dataclass(frozen=True)
class ArgumentGroup(FieldNote):
    """A record in a field of another: its arguments are given as if they were the other's own.

    Attributes
    ----------
    title : str
        Above its arguments in the help; empty to list them with the others.
    only : tuple[str, ...]
        Names of the fields that are given; empty for all. The others keep their defaults.
    """

    title: str = ""
    only: tuple[str, ...] = ()

    @property
    def group(self) -> "ArgumentGroup":
        """Itself."""
        return self


@dataclass(frozen=True)
class StudyKey(FieldNote):
    """Place of a field in a study file.

    Attributes
    ----------
    table : str
        Factor whose tables have it.
    key : str
        Empty for the name of the field.
    allowed : NumberRange or None
        Range of its number there; None of several numbers, whose type has it, and of words.
    """

    table: str
    key: str = ""
    allowed: NumberRange | None = None

    @property
    def study_key(self) -> "StudyKey":
        """Itself."""
        return self


LENGTH: Final = NumberRange(-1e9, 1e9, "m")
SPEED: Final = NumberRange(-1e9, 1e9, "m/s")
RATE: Final = NumberRange(-1e4, 1e4, "rad/s")
"""Of a component of a body rate: a hundred times what gyros measure."""
PIXEL: Final = NumberRange(-1e7, 1e7, "px")
SAMPLING_RATE: Final = NumberRange(1e-6, 1e6, "Hz")
RATE_UNITS: Final[dict[str, float]] = {
    "rad/s": 1.0,
    "mrad/s": 1e-3,
    "deg/s": math.pi / 180.0,
    "mdeg/s": math.pi / 180e3,
    "rpm": math.pi / 30.0,
}
"""rad/s in a unit of body rate."""
LENGTH_UNITS: Final[dict[str, float]] = {"m": 1.0, "cm": 1e-2, "mm": 1e-3}
"""Metres in a unit of length."""
CLOCK_UNITS: Final[dict[str, float]] = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
"""Seconds in a unit of time."""


def to_state(name: str, value: str) -> str:
    """How users state a `ReadingOptions` field, for a message: as an option of a command and as an argument of Python."""
    return f"--{name} {value} (Python: {name}=...)"


@dataclass(frozen=True)
class ReadingOptions:
    """Statements about a recording; None where its file states them.

    Attributes
    ----------
    unit : str or None
        Of body rates, a key of `RATE_UNITS`; of positions, a key of `LENGTH_UNITS`.
    clock : str or None
        Unit of time stamps, a key of `CLOCK_UNITS`.
    rate : float or None
        Samples a second, Hz, in place of a clock.
    topic : str or None
        Of a ROS bag; or body of a table, segment of an Xsens MVN, sensor of a table of several.
    columns : str or None
        Names of the columns of a table, with commas, in place of its header; ``-`` leaves one out.
    rig : str or None
        Folder with the calibration of the cameras of a bag, as ``spinfilters calibrate`` writes it.

    Raises
    ------
    InputError
        An unknown unit, a rate out of its range.
    """

    unit: Annotated[
        str | None,
        Argument(
            f"of body rates: {', '.join(RATE_UNITS)}; of positions: {', '.join(LENGTH_UNITS)}",
            metavar="UNIT",
            cure='the unit of body rates, such as "deg/s", or of positions, such as "mm"',
        ),
    ] = None
    clock: Annotated[
        str | None,
        Argument(
            f"of time stamps: {', '.join(CLOCK_UNITS)}",
            metavar="UNIT",
            cure='the unit of time stamps, such as "ms"',
        ),
    ] = None
    rate: Annotated[
        float | None, SAMPLING_RATE, Argument("samples a second, instead of a clock", metavar="HZ")
    ] = None
    topic: Annotated[
        str | None,
        Argument(
            "one of several: topic of a ROS bag (of images two with a comma, left first), or body of a table",
            metavar="NAME",
            cure="the name of a topic",
        ),
    ] = None

    columns: Annotated[
        str | None,
        Argument(
            "columns of a table without a header, such as t,x,y,z; - leaves one out",
            metavar="NAMES",
            cure='names of columns with commas, such as "t,x,y,z"',
        ),
    ] = None
    rig: Annotated[
        str | None,
        Argument(
            "calibration of the images in a ROS bag without camera_info: folder with cam0 and cam1, of calibrate",
            metavar="FOLDER",
            cure="the folder of a calibration",
        ),
    ] = None

    def __post_init__(self) -> None:
        for name, units in (("unit", {**RATE_UNITS, **LENGTH_UNITS}), ("clock", CLOCK_UNITS)):
            value = getattr(self, name)
            if value is not None and value not in units:
                raise InputError(f"{name} {value_text(value)} is unknown; give {', '.join(units)}")
        if self.rate is not None:
            SAMPLING_RATE.require("rate", self.rate)
        if self.rate is not None and self.clock is not None:
            raise InputError("a stated rate replaces the clock; state no unit of the clock")

    @property
    def column_names(self) -> tuple[str, ...]:
        """Stated names of the columns; empty where the table has its own."""
        return () if self.columns is None else tuple(name.strip() for name in self.columns.split(","))

    @property
    def stated(self) -> tuple[str, ...]:
        """Names of the options that are stated."""
        return tuple(each.name for each in fields(self) if getattr(self, each.name) is not None)

    def require_only(self, allowed: tuple[str, ...], words: str) -> None:
        """Raise InputError for a statement that a format has no use for.

        Parameters
        ----------
        allowed : tuple[str, ...]
            Names of statements that can be used.
        words : str
            What the format is called.
        """
        for name in self.stated:
            if name not in allowed:
                raise InputError(f"{name} does not apply to {words}; leave it out")


NOTHING_STATED: Final = ReadingOptions()
