"""The command ``spinfilters``: arguments, exit codes, one-line error messages."""

import argparse
import io
import logging
import os
import re
import sys
import time
import traceback
import warnings
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final, NoReturn

from spinfilters import __version__
from spinfilters.cli.commands import COMMANDS, ListedCommand
from spinfilters.cli.common_options import prints_text
from spinfilters.cli.interrupts import INTERRUPTED, noted_interrupts
from spinfilters.core.errors import SpinfiltersError
from spinfilters.core.plugins import plugin_in
from spinfilters.io.input_file import nearest_text, printable, value_text

EXIT_OK, EXIT_BAD_INPUT = 0, 2
PACKAGES: Final[tuple[str, ...]] = ("spinfilters", "observability")
"""Those whose lines an unexpected error names."""
LONGEST_COMPLAINT: Final[int] = 500
"""Characters of a complaint: a longer one loses its middle."""
LONGEST_WORD: Final[int] = 120
"""A longer path or untrusted value loses its middle, so that the sentence about it stays whole."""
DEBUG: Final[str] = "SPINFILTERS_DEBUG"
"""Environment variable with which an unexpected error shows its whole trace."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command.

    Returns the exit code: 0, or 2 for anything that the user can mend.
    """
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ.setdefault(name, "1")  # before NumPy loads: threads only slow matrices this small
    os.environ["MPLBACKEND"] = "agg"  # pictures are files here, whatever a notebook or a desktop has set
    if isinstance(sys.stdout, io.TextIOWrapper):  # a file name need not be text that the terminal has
        sys.stdout.reconfigure(errors="backslashreplace")
    with noted_interrupts() as pressed:
        try:
            options = parser().parse_args(arguments)
        except KeyboardInterrupt:
            return _complain(INTERRUPTED)
        code = _run(options, pressed)
    if pressed and code == EXIT_OK:
        _complain("interrupted when all was done: nothing is missing")
    return code


def _run(options: argparse.Namespace, pressed: Sequence[int]) -> int:
    """Run a parsed command; an error becomes one line.

    Parameters
    ----------
    pressed : Sequence[int]
        Not empty once Ctrl-C was pressed.
    """
    begun, is_verbose = time.time(), getattr(options, "verbose", False)
    try:
        _set_logging()
        with warnings.catch_warnings():
            # of numbers that are not finite: a status reports them; whoever asks for warnings (-W, -v) has asked before
            warnings.filterwarnings(
                "default" if is_verbose else "ignore", category=RuntimeWarning, append=True
            )
            code = options.command.run_parsed(options)
            if is_verbose:
                _say_what_it_took(begun)
            return code
    except SpinfiltersError as error:
        return _complain(str(error))
    except KeyboardInterrupt:
        return _complain(_of_interrupt(options, begun))
    except BrokenPipeError:
        return EXIT_BAD_INPUT
    except SystemExit as stop:  # of a plug-in; ours end commands before they run
        if (plugin := plugin_in(stop)) is None:
            raise
        return _complain_of_plugin(plugin)
    except OSError as error:
        if plugin := plugin_in(error):
            return _complain_of_plugin(plugin)
        name = f"{error.filename}: " if error.filename else ""
        return _complain(
            f"{name}{error.strerror or error}; free space or choose another folder, then run again"
        )
    except MemoryError:
        return _complain("out of memory; give a shorter recording or close other programs")
    except Exception as error:  # the last resort: what comes here is a fault of this program
        if pressed:  # a library that is interrupted while it loads may call it an error of its own
            return _complain(_of_interrupt(options, begun))
        if is_verbose or os.environ.get(DEBUG):
            raise
        if plugin := plugin_in(error):
            return _complain_of_plugin(plugin)
        return _complain(
            f"unexpected {type(error).__name__} in {_place(error)}; this is a fault of spinfilters: please report it "
            f"with what {DEBUG}=1 shows"
        )


def _complain_of_plugin(what: str) -> int:
    return _complain(f"{what}; mend or uninstall it")


def _say_what_it_took(begun: float) -> None:
    """Time by the clock, processor time and memory of a command that is done, on standard error."""
    import resource
    from importlib.metadata import version

    kilobyte = 1024.0 if sys.platform == "darwin" else 1.0  # there the largest size is counted in bytes
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024 / kilobyte
    packages = ", ".join(f"{name} {version(name)}" for name in ("numpy", "scipy", "casadi"))
    print(
        f"spinfilters {__version__}, Python {sys.version.split()[0]}, {packages}: {time.time() - begun:.2f} s by the clock, "
        f"{time.process_time():.2f} s of processor time, at most {memory:.0f} MB of memory",
        file=sys.stderr,
    )


def _of_interrupt(options: argparse.Namespace, begun: float) -> str:
    output = options.output if hasattr(options, "resume") else None
    if output is not None and _has_finished(Path(output), begun):
        return "interrupted; finished parts are kept, and the same command with --resume continues"
    return INTERRUPTED


def _has_finished(folder: Path, begun: float) -> bool:
    """Whether a command that began then left a result in a folder: what an older run left there is not its own."""
    if not folder.is_dir():
        return False
    from spinfilters.run.run_folder import CONFIG_FILE
    from spinfilters.run.run_lock import LOCK_FILE

    times = []
    for path in folder.rglob("*"):
        with suppress(OSError):  # removed meanwhile
            if path.is_file() and path.name not in {CONFIG_FILE, LOCK_FILE}:
                times.append(path.stat().st_mtime)
    return max(times, default=0.0) >= begun


def _set_logging() -> None:
    # of a home that cannot be written we say so ourselves, and matplotlib does without
    logging.getLogger("matplotlib").setLevel(logging.ERROR)
    compiling = logging.getLogger("spinfilters.compile")
    compiling.setLevel(logging.INFO)
    if not compiling.handlers:
        compiling.addHandler(_CompileNotice())


class _CompileNotice(logging.Handler):
    """Note before the first library is built, or where none can be."""

    told = False

    def emit(self, record: logging.LogRecord) -> None:
        """Print warnings, and once a note that models are compiled."""
        if record.levelno >= logging.WARNING:
            _complain(record.getMessage())
        elif not _CompileNotice.told and prints_text():
            _CompileNotice.told = True
            print("spinfilters: compiling the models for this machine, once ...", file=sys.stderr)


def _complain(text: str) -> int:
    """Say it in one printable line of bounded length."""
    line = " ".join(
        _without_middle(word, LONGEST_WORD) for word in printable(" ".join(text.split())).split(" ")
    )
    print(f"spinfilters: {_without_middle(line, LONGEST_COMPLAINT)}", file=sys.stderr)
    return EXIT_BAD_INPUT


def _without_middle(text: str, longest: int) -> str:
    half = longest // 2
    return text if len(text) <= longest else f"{text[:half]} ... {text[-half:]}"


def _place(error: BaseException) -> str:
    """File, line and function of the innermost frame of the package."""
    frames = traceback.extract_tb(error.__traceback__)
    root = Path(__file__).parents[2]
    own = [f for f in frames if any(Path(f.filename).is_relative_to(root / name) for name in PACKAGES)]
    frame = (own or frames)[-1]
    path = Path(frame.filename)
    return f"{path.relative_to(root) if own else path.name}:{frame.lineno} {frame.name}"


class _Parser(argparse.ArgumentParser):
    """An argument parser whose complaint is one line, and which may take a first word that names no action as its default's."""

    listed: ListedCommand | None = None
    """The command whose arguments are added when it is parsed; None once they are there."""
    actions: tuple[str, ...] = ()
    default_action: str = ""
    _words: tuple[str, ...] = ()
    required: Mapping[str, str] = MappingProxyType({})
    """How to give each required argument, by the name that argparse has for it."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **{"allow_abbrev": False, **kwargs})

    def parse_known_args(  # pyright: ignore[reportIncompatibleMethodOverride]
        self, args: Sequence[str] | None = None, namespace: Any = None
    ) -> tuple[argparse.Namespace, list[str]]:
        """Parse, with the default action where the first word is none."""
        if self.listed is not None:
            listed, self.listed = self.listed, None
            listed.load().fill(self)
        words = sys.argv[1:] if args is None else list(args)
        if self.default_action and words and words[0] not in (*self.actions, "-h", "--help"):
            words = [self.default_action, *words]
        self._words = tuple(words)
        return super().parse_known_args(words, namespace)

    def parse_args(  # pyright: ignore[reportIncompatibleMethodOverride]
        self, args: Sequence[str] | None = None, namespace: Any = None
    ) -> argparse.Namespace:
        """Parse all arguments, and name the first that a command does not take."""
        options, rest = self.parse_known_args(args, namespace)
        if rest:
            what = "is not for this command" if rest[0].startswith("-") else "is one argument too many"
            meant = nearest_text(rest[0].split("=", 1)[0], getattr(options, "flags", ()))
            self.error(f"{rest[0]} {what}; {meant or 'leave it out'}")
        return options

    def error(self, message: str) -> NoReturn:
        """End the command with one line on wrong arguments, exit code 2."""
        unknown = re.search(r"invalid choice: '([^']*)'.*\(choose from (.*)\)", message)
        if unknown is not None:
            known = [word.strip(" '\"") for word in unknown[2].split(",")]
            if meant := nearest_text(unknown[1], known):
                message = f"{value_text(unknown[1])} is unknown; {meant}"
        start, required, names = message.partition("required: ")
        if required and (
            misspelled := self._misspelled()
        ):  # what is missing may have been given under another name
            message = misspelled
        elif required:
            message = (
                f"{start}{required}{', '.join(self.required.get(name, name) for name in names.split(', '))}"
            )
        raise SystemExit(_complain(f"{message}; see '{self.prog} --help'"))

    def _misspelled(self) -> str:
        """The first given option that is unknown and near to a known one; empty where there is none."""
        known = [flag for action in self._actions for flag in action.option_strings]
        for word in self._words:
            flag = word.split("=", 1)[0]
            if flag.startswith("--") and flag not in known and (meant := nearest_text(flag, known)):
                return f"{flag} is not for this command; {meant}"
        return ""


def parser() -> argparse.ArgumentParser:
    """Parser of all commands."""
    parser = _Parser(
        prog="spinfilters",
        description="How does that unknown object spin?",
        epilog=_grouped_commands(),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("-V", "--version", action="version", version=f"spinfilters {__version__}")
    subparsers = parser.add_subparsers(
        title="commands",
        required=True,
        metavar="COMMAND",
        help="one of those below; COMMAND --help has its options",
    )
    for listed in COMMANDS:
        subparsers.add_parser(listed.name).listed = listed
    return parser


def _grouped_commands() -> str:
    """Commands with their lines of help, by what they are for."""
    lines: list[str] = []
    for group in dict.fromkeys(listed.group for listed in COMMANDS):
        named = (listed for listed in COMMANDS if listed.group == group)
        lines += [f"{group}:", *(f"  {listed.name:<13}{listed.help}" for listed in named), ""]
    return "\n".join(lines)


if __name__ == "__main__":
    raise SystemExit(main())
