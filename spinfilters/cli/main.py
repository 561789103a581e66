"""The command ``spinfilters``: arguments, exit codes and one clear line for whatever goes wrong."""

import argparse
import io
import logging
import os
import sys
import traceback
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Final, NoReturn

from spinfilters import __version__
from spinfilters.api.argument_ranges import GYRO_BIAS, SECONDS_AHEAD, SEED
from spinfilters.cli.analyser_arguments import add_condition, add_motion, add_observe, number
from spinfilters.errors import SpinfiltersError
from spinfilters.logs.input_file import printable

EXIT_OK, EXIT_BAD_INPUT = 0, 2
PACKAGES: Final[tuple[str, ...]] = ("spinfilters", "observability")
"""Those whose lines an unexpected error names."""
LONGEST_COMPLAINT: Final[int] = 280
"""Characters of a complaint: of a longer one, which holds long names, the middle is left out."""
DEBUG: Final[str] = "SPINFILTERS_DEBUG"
"""Environment variable with which an unexpected error shows its whole trace."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command; returns the exit code: 0, or 2 for anything that the user can mend."""
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ.setdefault(name, "1")  # before NumPy loads: threads only slow matrices this small
    if isinstance(sys.stdout, io.TextIOWrapper):  # a file name need not be text that the terminal has
        sys.stdout.reconfigure(errors="backslashreplace")
    options = _parser().parse_args(arguments)
    # of a home that cannot be written we say so ourselves, and matplotlib does without
    logging.getLogger("matplotlib").setLevel(logging.ERROR)
    compiling = logging.getLogger("spinfilters.compile")
    compiling.setLevel(logging.INFO)
    if not compiling.handlers:
        compiling.addHandler(_CompileNotice())
    try:
        with warnings.catch_warnings():
            # of numbers that are not finite: a status tells of them; whoever asks for warnings (-W) has asked before
            warnings.filterwarnings("ignore", category=RuntimeWarning, append=True)
            return options.command(options)
    except SpinfiltersError as error:
        return _complain(str(error))
    except KeyboardInterrupt:
        return _complain(
            "interrupted; what was finished before is kept, compare with --resume goes on from it"
        )
    except BrokenPipeError:
        return EXIT_BAD_INPUT
    except OSError as error:
        name = f"{error.filename}: " if error.filename else ""
        return _complain(
            f"{name}{error.strerror or error}; free space or choose another folder, then run again"
        )
    except MemoryError:
        return _complain("out of memory; give a shorter recording or close other programs")
    except Exception as error:  # the last resort: what comes here is a fault of this program
        if os.environ.get(DEBUG):
            raise
        return _complain(
            f"unexpected {type(error).__name__} in {_place(error)}; this is a fault of spinfilters: please report it "
            f"with what {DEBUG}=1 shows"
        )


class _CompileNotice(logging.Handler):
    """One line before the first library is built, or where none can be."""

    told = False

    def emit(self, record: logging.LogRecord) -> None:
        if record.levelno >= logging.WARNING:
            _complain(record.getMessage())
        elif not _CompileNotice.told:
            _CompileNotice.told = True
            print("spinfilters: compiling the models for this machine, once ...", file=sys.stderr)


def _complain(text: str) -> int:
    """Say it in one printable line of bounded length."""
    line = printable(" ".join(text.split()))
    if len(line) > LONGEST_COMPLAINT:
        half = LONGEST_COMPLAINT // 2
        line = f"{line[:half]} ... {line[-half:]}"
    print(f"spinfilters: {line}", file=sys.stderr)
    return EXIT_BAD_INPUT


def _place(error: BaseException) -> str:
    """Where in this program it happened: file, line and function of the innermost frame that is its own."""
    frames = traceback.extract_tb(error.__traceback__)
    root = Path(__file__).parents[2]
    own = [f for f in frames if any(Path(f.filename).is_relative_to(root / name) for name in PACKAGES)]
    frame = (own or frames)[-1]
    path = Path(frame.filename)
    return f"{path.relative_to(root) if own else path.name}:{frame.lineno} {frame.name}"


class _Parser(argparse.ArgumentParser):
    """An argument parser whose complaint is one line."""

    def error(self, message: str) -> NoReturn:
        raise SystemExit(_complain(f"{message}; see '{self.prog} --help'"))


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(prog="spinfilters", description="How does that unknown object spin?")
    parser.add_argument("--version", action="version", version=f"spinfilters {__version__}")
    commands = parser.add_subparsers(title="commands", required=True, metavar="COMMAND")
    _add_compare(commands)
    _add_estimate(commands)
    _add_simulate(commands)
    add_observe(commands).set_defaults(command=_observe)
    add_condition(commands).set_defaults(command=_condition)
    plot = commands.add_parser("plot", help="draw the figures of a run folder again")
    plot.add_argument("run", metavar="RUN", help="folder made by compare or estimate")
    plot.set_defaults(command=_plot)
    doctor = commands.add_parser("doctor", help="print versions and check that everything works")
    doctor.set_defaults(command=_doctor)
    return parser


def _add_compare(commands: "argparse._SubParsersAction[_Parser]") -> None:
    compare = commands.add_parser(
        "compare",
        help="estimators side by side on one recording",
        description="Without DATASET the bundled example is simulated, the thesis' own problem: tracks of unknown landmarks on a "
        "SPHERES-like body at 10 rpm about its intermediate axis, 115 epochs at 0.5 s before a stereo camera of 1 px noise, with "
        "disturbances of 0.001 (m/s^2)/sqrt(Hz) and 0.001 (rad/s^2)/sqrt(Hz).",
    )
    compare.add_argument(
        "dataset", metavar="DATASET", nargs="?", help="data set folder, phyphox export, gyro .csv or TUM .tum"
    )
    compare.add_argument(
        "--estimators",
        metavar="A,B",
        help="mekf, ukf, smoother, filterpy-ekf, filterpy-ukf (default: mekf,ukf,smoother; all with --known-map)",
    )
    compare.add_argument("--seed", type=number(SEED), default=0, help="of the bundled example")
    compare.add_argument(
        "--known-map", action="store_true", help="of the bundled example: its landmarks are known"
    )
    _add_run_options(compare)
    compare.set_defaults(command=_compare)


def _add_estimate(commands: "argparse._SubParsersAction[_Parser]") -> None:
    estimate = commands.add_parser("estimate", help="one estimator on a recording")
    estimate.add_argument(
        "dataset", metavar="DATASET", help="data set folder, phyphox export, gyro .csv or TUM .tum"
    )
    estimate.add_argument(
        "--estimator",
        dest="estimators",
        default="ukf",
        metavar="NAME",
        help="mekf, ukf, smoother, filterpy-ekf or filterpy-ukf (default ukf)",
    )
    _add_run_options(estimate)
    estimate.set_defaults(command=_compare, seed=0, known_map=False)


def _add_run_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "-o", "--output", metavar="RUN", default="runs/latest", help="run folder (default runs/latest)"
    )
    parser.add_argument(
        "--resume",
        action="store_true",
        help="go on from what an interrupted run has left in RUN, to the same numbers; a finished one gets what it lacks",
    )
    parser.add_argument("--segment", metavar="N", help="segment of a phyphox recording, or 'all'")
    parser.add_argument("--drag", action="store_true", help="estimate an aerodynamic drag coefficient too")
    parser.add_argument(
        "--config", metavar="FILE", help="TOML file with settings, such as config.toml of another run"
    )
    parser.add_argument(
        "--predict",
        type=number(SECONDS_AHEAD),
        metavar="SECONDS",
        help="go on for so long after the last frame: <estimator>/prediction.csv and .npz, prediction.png",
    )
    parser.add_argument(
        "--convergence",
        action="store_true",
        help="show how the smoother's estimates settle on tracks without a map: convergence.png, smoother/convergence.npz",
    )


def _add_simulate(commands: "argparse._SubParsersAction[_Parser]") -> None:
    simulate = commands.add_parser(
        "simulate", help="write a simulated data set with truth, and a picture of it"
    )
    simulate.add_argument("-o", "--output", metavar="DATASET", required=True, help="folder of the data set")
    simulate.add_argument(
        "--kind", default="stereo-tracks", help="stereo-tracks, mono-tracks, pose, attitude or gyro"
    )
    simulate.add_argument("--seed", type=number(SEED), default=0)
    simulate.add_argument(
        "--known-map", action="store_true", help="write landmarks.csv, the map of the tracks"
    )
    simulate.add_argument(
        "--gyro-bias",
        type=number(GYRO_BIAS),
        nargs=3,
        metavar=("BX", "BY", "BZ"),
        help="constant error of the gyro's rates, axes g, rad/s (with --kind gyro)",
    )
    simulate.add_argument(
        "--inspector",
        default="static",
        metavar="static|circle",
        help="circle: the camera flies about the body, and inspector.tum says how",
    )
    add_motion(simulate)
    simulate.set_defaults(command=_simulate)


def _compare(options: argparse.Namespace) -> int:
    from spinfilters.cli.compare import compare

    return compare(options)


def _simulate(options: argparse.Namespace) -> int:
    from spinfilters.cli.simulate import simulate

    return simulate(options)


def _observe(options: argparse.Namespace) -> int:
    from spinfilters.cli.observe import observe

    return observe(options)


def _condition(options: argparse.Namespace) -> int:
    from spinfilters.cli.condition import condition

    return condition(options)


def _plot(options: argparse.Namespace) -> int:
    from spinfilters.cli.plot import plot

    return plot(options)


def _doctor(_: argparse.Namespace) -> int:
    from spinfilters.cli.doctor import doctor

    return doctor()


if __name__ == "__main__":
    raise SystemExit(main())
