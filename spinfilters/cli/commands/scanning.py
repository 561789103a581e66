"""The command ``lidar``."""

import argparse
from typing import Final

from spinfilters.api.argument_ranges import FRAMES, INTERVAL, RATE_RPM, SEED
from spinfilters.cli.command import Command, Subparsers, number
from spinfilters.io.stated_values import LENGTH, NumberRange

ANGLE: Final = NumberRange(-3600.0, 3600.0, "deg")
FIELD: Final = NumberRange(1e-6, 179.0, "deg")
COUNT: Final = NumberRange(1, 100_000, whole=True)
SHARE: Final = NumberRange(0.0, 1.0)
SCALE: Final = NumberRange(1e-12, 1e12)
SECONDS: Final = NumberRange(0.0, 1e5, "s")
POWER: Final = NumberRange(0.0, 1e18)


def add_lidar(commands: Subparsers) -> argparse.ArgumentParser:
    """Parser of ``spinfilters lidar``."""
    lidar = commands.add_parser("lidar", help="simulate scans of a body, tell how many are needed")
    actions = lidar.add_subparsers(title="actions", required=True, metavar="ACTION", dest="action")
    scan = actions.add_parser(
        "scan",
        help="scan a mesh with a simulated lidar",
        description="Writes scan.ply, scan.png and metadata; with --scans a data set of scans of the tumbling body, with truth, "
        "for 'spinfilters compare'. Frame of the lidar: x along its axis, y towards elevation, z towards azimuth.",
    )
    scan.add_argument(
        "mesh",
        metavar="MESH",
        nargs="?",
        help=".stl, .obj, .ply, .tab or .txt in m (see --scale), cube or spacecraft (default: that of the preset)",
    )
    scan.add_argument("-o", "--output", metavar="FOLDER", required=True)
    scan.add_argument(
        "--preset",
        metavar="NAME",
        help="the thesis' own inputs: table-2.1, table-3.2, figure-2.12 ... figure-2.18",
    )
    scan.add_argument("--seed", type=number(SEED), default=0)
    _add_body(scan)
    _add_rays(scan)
    _add_errors(scan)
    _add_output(scan)
    _add_needed(actions)
    return lidar


def _add_needed(actions: Subparsers) -> None:
    needed = actions.add_parser(
        "needed",
        help="how many scans an attitude of a given accuracy takes",
        description="Registers the scans of a data set of kind lidar-scans and tells how many like them a mean attitude of the "
        "accuracy takes; writes scans_needed.png.",
    )
    needed.add_argument(
        "scans", metavar="FOLDER", help="data set of scans, such as 'lidar scan --scans' writes"
    )
    needed.add_argument("-o", "--output", metavar="FOLDER", required=True)
    needed.add_argument(
        "--attitude-deg",
        type=number(NumberRange(1e-9, 180.0, "deg")),
        default=0.01,
        help="standard deviation of the mean attitude (default 0.01)",
    )


def _add_body(parser: argparse.ArgumentParser) -> None:
    body = parser.add_argument_group("the body")
    body.add_argument(
        "--scale",
        type=number(SCALE),
        default=1.0,
        help="metres in a unit of the mesh: 0.001 for mm, 1000 for km",
    )
    _triple(body, "--rotation", ANGLE, "Z Y X", "deg: the mesh is rotated by Rx Ry Rz")
    _triple(
        body,
        "--translation",
        LENGTH,
        "X Y Z",
        "place of the mesh's origin, m (default: on the axis, four radii away)",
    )
    _add_scans(body)
    _add_body_motion(body)


def _add_scans(body: argparse._ArgumentGroup) -> None:
    body.add_argument(
        "--scans", type=number(FRAMES), help="scan the tumbling body so many times: writes a data set"
    )
    body.add_argument(
        "--points",
        action="store_true",
        help="with --scans: points of the faces are the measurements, rather than a pose of every scan",
    )
    body.add_argument(
        "--interval", type=number(INTERVAL), default=1.0, help="seconds between the scans (default 1)"
    )


def _add_body_motion(body: argparse._ArgumentGroup) -> None:
    _triple(
        body,
        "--rate-rpm",
        RATE_RPM,
        "MINOR INTERMEDIATE MAJOR",
        "initial rate about the principal axes of the body of uniform density (default 1 2 1.5)",
    )
    _triple(body, "--velocity", LENGTH, "X Y Z", "of the centre of mass, m/s (default 0 0 0)")


def _add_rays(parser: argparse.ArgumentParser) -> None:
    rays = parser.add_argument_group("the rays")
    rays.add_argument(
        "--fov",
        type=number(FIELD),
        nargs=2,
        metavar=("AZ", "EL"),
        help="field of view, deg (default: around the body)",
    )
    rays.add_argument(
        "--rays", type=number(COUNT), nargs=2, metavar=("AZ", "EL"), help="number of rays (default 200 200)"
    )
    _add_windows(rays)
    rays.add_argument(
        "--scan-seconds",
        type=number(SECONDS),
        default=0.0,
        help="duration of a scan, in which the body moves (default 0)",
    )


def _add_windows(rays: argparse._ArgumentGroup) -> None:
    rays.add_argument(
        "--window",
        type=number(ANGLE),
        nargs=4,
        action="append",
        metavar=("EL_START", "EL_SPAN", "AZ_START", "AZ_SPAN"),
        help="high-resolution window, deg; may be repeated",
    )
    rays.add_argument(
        "--multiplier",
        type=number(NumberRange(1, 1000, whole=True)),
        default=2,
        help="density within windows (default 2)",
    )


def _add_errors(parser: argparse.ArgumentParser) -> None:
    errors = parser.add_argument_group("errors, those of Jena-Optronik's RVS")
    errors.add_argument(
        "--noise",
        choices=("none", "jitter", "encoder", "thesis"),
        help="noise of range and angles; of the angles: the beam leaves its direction unknown, is read wrongly, or leaves it and "
        "is read rightly (default none, or that of the preset)",
    )
    errors.add_argument(
        "--long-range", action="store_true", help="0.1 m (3 sigma) of range noise instead of 0.01 m"
    )
    errors.add_argument("--bias", action="store_true", help="with the largest biases of the specification")
    _add_dust(errors)
    errors.add_argument("--reflectivity", type=number(SHARE), default=1.0, help="of the surface (default 1)")
    errors.add_argument(
        "--weakest",
        type=number(POWER),
        default=0.0,
        help="received power that is still measured; 1 is a white surface met head-on at 500 m",
    )
    errors.add_argument("--strongest", type=number(POWER), help="received power that saturates the detector")
    _triple(
        errors,
        "--sun",
        NumberRange(-1.0, 1.0),
        "X Y Z",
        "direction towards the sun, whose glint blinds the detector",
    )


def _add_dust(errors: argparse._ArgumentGroup) -> None:
    errors.add_argument(
        "--dust", type=number(SHARE), default=0.0, help="share of the beams that dust absorbs"
    )
    errors.add_argument(
        "--clutter",
        type=number(SHARE),
        default=0.0,
        help="share of the returns that come from dust before the body",
    )


def _add_output(parser: argparse.ArgumentParser) -> None:
    output = parser.add_argument_group("output")
    output.add_argument(
        "--format",
        choices=("ply", "pcd", "csv"),
        nargs="+",
        default=["ply"],
        help="of a single scan (default ply)",
    )
    output.add_argument(
        "--misses", action="store_true", help="write rays without a return too, with their flag"
    )


def _triple(
    group: argparse._ArgumentGroup, name: str, allowed: NumberRange, metavar: str, words: str
) -> None:
    group.add_argument(name, type=number(allowed), nargs=3, metavar=tuple(metavar.split()), help=words)


def run_lidar(options: argparse.Namespace) -> int:
    """Simulate scans, or say how many are needed."""
    from spinfilters.cli.lidar_actions import lidar

    return lidar(options)


LIDAR = Command(add_lidar, run_lidar)
