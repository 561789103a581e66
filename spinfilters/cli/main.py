"""The command ``spinfilters``: arguments, exit codes and one clear line for whatever goes wrong."""

import argparse
import logging
import math
import os
import sys
from collections.abc import Sequence
from typing import NoReturn

from spinfilters import __version__
from spinfilters.cli.analyser_arguments import add_condition, add_motion, add_observe
from spinfilters.errors import SpinfiltersError

EXIT_OK, EXIT_BAD_INPUT = 0, 2


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command; returns the exit code: 0, or 2 for anything that the user can mend."""
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ.setdefault(name, "1")  # before NumPy loads: threads only slow matrices this small
    options = _parser().parse_args(arguments)
    compiling = logging.getLogger("spinfilters.compile")
    compiling.setLevel(logging.INFO)
    if not compiling.handlers:
        compiling.addHandler(_CompileNotice())
    try:
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


class _CompileNotice(logging.Handler):
    """One line, before the first library is built."""

    told = False

    def emit(self, record: logging.LogRecord) -> None:
        if not _CompileNotice.told:
            _CompileNotice.told = True
            print("spinfilters: compiling the models for this machine, once ...", file=sys.stderr)


def _complain(text: str) -> int:
    print(f"spinfilters: {' '.join(text.split())}", file=sys.stderr)
    return EXIT_BAD_INPUT


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
        help="estimators side by side on identical measurements",
        description="Without DATASET the thesis' own scenario is simulated: a SPHERES-like body at 10 rpm about its "
        "intermediate axis, 115 frames at 0.5 s before a stereo camera.",
    )
    compare.add_argument(
        "dataset", metavar="DATASET", nargs="?", help="data set folder, phyphox export, gyro .csv or TUM .tum"
    )
    compare.add_argument(
        "--estimators",
        metavar="A,B",
        help="mekf, ukf, smoother, filterpy-ekf, filterpy-ukf (default: all; recordings: mekf,ukf,smoother)",
    )
    compare.add_argument("--seed", type=int, default=0, help="of the simulated default")
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
    estimate.set_defaults(command=_compare, seed=0)


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
        type=_positive,
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
    simulate.add_argument("--kind", default="stereo-tracks", help="stereo-tracks, pose or gyro")
    simulate.add_argument("--seed", type=int, default=0)
    add_motion(simulate)
    simulate.set_defaults(command=_simulate)


def _positive(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0 < value < math.inf:
        raise argparse.ArgumentTypeError(f"{text} is no positive finite number; give seconds, such as 10")
    return value


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
