"""The commands ``compare`` and ``estimate``."""

import argparse

from spinfilters.api.argument_ranges import SECONDS_AHEAD, SEED
from spinfilters.cli.command import Command, Subparsers, add_reading, number


def add_compare(commands: Subparsers) -> argparse.ArgumentParser:
    """Parser of ``spinfilters compare``."""
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
        help="mekf, ukf, smoother, smoother-latest, filterpy-ekf, filterpy-ukf, embedded, embedded-double "
        "(default: mekf,ukf,smoother; "
        "filterpy's too with --known-map)",
    )
    compare.add_argument("--seed", type=number(SEED), default=0, help="of the bundled example")
    compare.add_argument(
        "--known-map", action="store_true", help="of the bundled example: its landmarks are known"
    )
    _add_run_options(compare)
    return compare


def add_estimate(commands: Subparsers) -> argparse.ArgumentParser:
    """Parser of ``spinfilters estimate``."""
    estimate = commands.add_parser("estimate", help="one estimator on a recording")
    estimate.add_argument(
        "dataset", metavar="DATASET", help="data set folder, phyphox export, gyro .csv or TUM .tum"
    )
    estimate.add_argument(
        "--estimator",
        dest="estimators",
        default="ukf",
        metavar="NAME",
        help="mekf, ukf, smoother, smoother-latest, filterpy-ekf, filterpy-ukf, embedded or embedded-double (default ukf)",
    )
    _add_run_options(estimate)
    estimate.set_defaults(seed=0, known_map=False)
    return estimate


def _add_run_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "-o", "--output", metavar="RUN", default="runs/latest", help="run folder (default runs/latest)"
    )
    parser.add_argument(
        "--resume",
        action="store_true",
        help="go on from what an interrupted run has left in RUN, to the same numbers; a finished one gets what it lacks",
    )
    parser.add_argument(
        "--segment",
        metavar="N|START:END|all|auto",
        help="a segment by its number or by its times, s; all that are marked; or all free flights that are found",
    )
    parser.add_argument("--drag", action="store_true", help="estimate an aerodynamic drag coefficient too")
    parser.add_argument(
        "--drag-law",
        choices=("quadratic", "linear", "auto"),
        help="of --drag: torques quadratic in the rate (as --drag alone) or linear, or the likelier of both, if any",
    )
    parser.add_argument(
        "--verdict",
        choices=("full", "filter"),
        help="judge by all checks (full, the default), or by those alone that need no smoothed motion (filter): these take less "
        "time, and leave every estimate degraded at best",
    )
    parser.add_argument(
        "--config", metavar="FILE", help="TOML file with settings, such as config.toml of another run"
    )
    _add_optional_outputs(parser)
    add_reading(parser)


def _add_optional_outputs(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--predict",
        type=number(SECONDS_AHEAD),
        metavar="SECONDS",
        help="go on for so long after the last epoch: <estimator>/prediction.csv and .npz, prediction.png",
    )
    parser.add_argument(
        "--convergence",
        action="store_true",
        help="show how the smoother's estimates settle on tracks without a map: convergence.png, smoother/convergence.npz",
    )
    parser.add_argument(
        "--explain",
        action="store_true",
        help="test the models, and run again with the errors that are found where the state can hold them: explanations.json",
    )


def run_compare(options: argparse.Namespace) -> int:
    """Run the estimators, write the run folder, print the table."""
    from spinfilters.cli.compare_recording import compare

    return compare(options)


COMPARE, ESTIMATE = Command(add_compare, run_compare), Command(add_estimate, run_compare)
