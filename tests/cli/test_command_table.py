"""The table of commands: records of arguments make parser, help, checks and the page of all commands."""

import inspect
import sys
from dataclasses import MISSING, dataclass, field, fields
from pathlib import Path
from types import ModuleType
from typing import Annotated, Any, Literal

import pytest
from contracts.plugin import program_of

import spinfilters
from spinfilters.api.arguments import CampaignArguments, ObserveArguments, RunArguments
from spinfilters.cli.command import Command
from spinfilters.cli.commands import COMMANDS, ListedCommand
from spinfilters.cli.commands_page import main as write_page
from spinfilters.cli.commands_page import page
from spinfilters.cli.main import main
from spinfilters.io.argument_fields import given_fields
from spinfilters.io.stated_values import Argument, ArgumentGroup, NumberRange, ReadingOptions
from spinfilters.simulation.scenario_record import Scenario

DOCS = Path(__file__).parents[2] / "docs"
PROGRAM = program_of(DOCS / "how-to" / "add-a-command.md")


def run_with(command: Command[Any], monkeypatch: pytest.MonkeyPatch, *words: str) -> int:
    """Exit code of a command that was added to the table."""
    module = ModuleType(command.name)
    module.__dict__["COMMAND"] = command
    monkeypatch.setitem(sys.modules, command.name, module)
    listed = ListedCommand(command.name, "study", "added by a test", command.name)
    monkeypatch.setattr("spinfilters.cli.main.COMMANDS", (*COMMANDS, listed))
    try:
        return main([command.name, *words])
    except SystemExit as ended:
        return int(ended.code or 0)


@pytest.fixture
def turn(monkeypatch: pytest.MonkeyPatch) -> Command[Any]:
    """The command of the how-to page."""
    module = ModuleType("turn")
    monkeypatch.setitem(sys.modules, "turn", module)
    exec(PROGRAM, module.__dict__)
    return module.COMMAND


def test_a_command_of_one_file_runs_with_its_defaults(
    turn: Command[Any], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_with(turn, monkeypatch, "10") == 0
    assert capsys.readouterr().out == "30 deg between epochs\n"
    assert run_with(turn, monkeypatch, "10", "--interval", "1", "--unit", "rad") == 0
    assert "1.047 rad" in capsys.readouterr().out


def test_its_help_tells_defaults_and_its_refusals_the_range(
    turn: Command[Any], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_with(turn, monkeypatch, "--help") == 0
    assert "seconds between epochs (default 0.5)" in capsys.readouterr().out
    for words in (("-1",), ("nan",), ("10", "--interval", "0"), ("10", "--unit", "grad"), (), ("10", "20")):
        assert run_with(turn, monkeypatch, *words) == 2
        said = capsys.readouterr().err
        assert said.count("\n") == 1
        assert "Traceback" not in said
    assert run_with(turn, monkeypatch, "10", "--interval", "0") == 2
    assert "give a number from 1e-06 to 100000 s" in capsys.readouterr().err


@dataclass(frozen=True, kw_only=True)
class EveryKind:
    """An argument of each kind of field."""

    place: Annotated[str, Argument("by its place", positional=True, metavar="PLACE")]
    many: Annotated[tuple[str, ...], Argument("more of them", positional=True, metavar="MORE")]
    count: Annotated[int, NumberRange(1, 9, whole=True), Argument("how many", name="number")] = 3
    axes: Annotated[tuple[Literal["x", "y"], ...], Argument("some")] = ("x",)
    vector: Annotated[tuple[float, float], NumberRange(-1, 1), Argument("two")] = (0.0, 0.5)
    windows: Annotated[tuple[tuple[float, float], ...], NumberRange(0, 9), Argument("pairs")] = ()
    sizes: Annotated[
        tuple[tuple[str, float], ...], Argument("by name", flag="--size", bare=1.0, cure="a number")
    ] = ()
    steps: Annotated[tuple[tuple[str, float], ...], Argument("by name", flag="--step", cure="seconds")] = ()
    ready: Annotated[bool, Argument("a switch")] = False
    limit: Annotated[float | None, NumberRange(0, 1), Argument("or none")] = None
    hidden: int = 7
    reading: Annotated[ReadingOptions, ArgumentGroup("a group", only=("unit",))] = field(
        default_factory=ReadingOptions
    )


def parsed(monkeypatch: pytest.MonkeyPatch, *words: str) -> EveryKind | None:
    """The record that a command line makes; None of one that is refused."""
    made: list[EveryKind] = []

    def keep(options: EveryKind) -> int:
        made.append(options)
        return 0

    code = run_with(Command("every", EveryKind, keep), monkeypatch, *words)
    assert code == (0 if made else 2)
    return made[0] if made else None


def test_what_is_left_out_has_the_default_of_its_field(monkeypatch: pytest.MonkeyPatch) -> None:
    assert parsed(monkeypatch, "a", "b", "c") == EveryKind(place="a", many=("b", "c"))


def test_each_kind_of_field_takes_its_values(monkeypatch: pytest.MonkeyPatch) -> None:
    words = "a b --number 5 --axes x y --vector 1 -1 --windows 1 2 --windows 3 4 --size lever 0.1 --size missing --step gyro 0.5"
    found = parsed(monkeypatch, *words.split(), "--ready", "--limit", "0.25", "--unit", "deg/s")
    assert found == EveryKind(
        place="a",
        many=("b",),
        count=5,
        axes=("x", "y"),
        vector=(1.0, -1.0),
        windows=((1.0, 2.0), (3.0, 4.0)),
        sizes=(("lever", 0.1), ("missing", 1.0)),
        steps=(("gyro", 0.5),),
        ready=True,
        limit=0.25,
        reading=ReadingOptions(unit="deg/s"),
    )


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("a", "MORE"),
        ("a b --number 0", "--number: '0' is not allowed; give a whole number from 1 to 9"),
        ("a b --vector 1", "expected 2 arguments"),
        ("a b --vector 1 2", "give a number from -1 to 1"),
        ("a b --axes z", "invalid choice: 'z'"),
        ("a b --size lever x", "--size lever 'x': give a number"),
        ("a b --size lever 1 2", "give one number; repeat the option"),
        ("a b --size lever 1 --size lever 2", "--size lever is given twice; give it once"),
        ("a b --step gyro x", "--step gyro 'x': give seconds"),
        ("a b --unit furlong", "unit 'furlong' is unknown"),
        ("a b --clock ms", "--clock is not for this command; leave it out"),
        ("a b --hidden 3", "--hidden is not for this command; leave it out"),
    ],
)
def test_what_a_field_does_not_take_is_refused_in_one_line(
    words: str, said: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert parsed(monkeypatch, *words.split()) is None
    complaint = capsys.readouterr().err
    assert said in complaint
    assert complaint.count("\n") == 1


def every_command() -> list[Command[Any]]:
    """All commands, actions of groups among them."""
    found: list[Command[Any]] = []
    for listed in COMMANDS:
        found += [command for _, command in listed.load().parts]
    return found


@pytest.mark.parametrize("listed", COMMANDS, ids=lambda listed: listed.name)
def test_the_table_names_each_command_as_its_file_does(listed: ListedCommand) -> None:
    assert listed.load().name == listed.name
    assert listed.help


@pytest.mark.parametrize("command", every_command(), ids=lambda command: command.name)
def test_names_of_arguments_are_unique_and_each_has_a_help(command: Command[Any]) -> None:
    given = command.fields
    names = [each.name for each in given]
    assert len(set(names)) == len(names)
    assert all(each.argument.help for each in given)


PYTHON: dict[str, tuple[type, set[str]]] = {
    "simulate": (Scenario, {"gyro_bias", "noise", "inspector_errors", "beside"}),
    "observe": (ObserveArguments, {"sensors"}),
    "compare": (RunArguments, set()),
    "campaign": (CampaignArguments, set()),
    "load": (ReadingOptions, set()),
}
"""Functions, their records, and arguments which Python leaves out as None or takes as one text."""


@pytest.mark.parametrize("name", PYTHON)
def test_a_python_function_has_the_arguments_and_defaults_of_its_record(name: str) -> None:
    record, written_otherwise = PYTHON[name]
    parameters = inspect.signature(getattr(spinfilters, name)).parameters
    for each in given_fields(record):
        assert each.name in parameters
        assert each.name in written_otherwise or parameters[each.name].default == each.default


@pytest.mark.parametrize("name", [*PYTHON, "load_run", "save"])
def test_its_docstring_has_a_row_for_each_argument(name: str) -> None:
    function = getattr(spinfilters, name)
    lines = (inspect.getdoc(function) or "").splitlines()
    rows = {line.split(" : ")[0] for line in lines if " : " in line and not line.startswith(" ")}
    assert rows == set(inspect.signature(function).parameters)


def test_the_page_of_all_commands_is_that_of_the_records(tmp_path: Path) -> None:
    """Made anew by ``python -m spinfilters.cli.commands_page docs/reference/commands.md``."""
    assert write_page([str(tmp_path / "commands.md")]) == 0
    assert (tmp_path / "commands.md").read_text() == page()
    assert (DOCS / "reference" / "commands.md").read_text() == page()


def test_every_field_of_a_scenario_is_described() -> None:
    text = Scenario.__doc__ or ""
    assert not [each.name for each in fields(Scenario) if each.name not in text]
    assert all(
        each.default is not MISSING or each.default_factory is not MISSING for each in fields(Scenario)
    )
