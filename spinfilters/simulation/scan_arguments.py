"""Arguments of a simulated scan: the body, the rays and their errors. Nothing heavy is imported here, so that help is quick."""

from dataclasses import dataclass, field
from typing import Annotated, Final, Literal

from spinfilters.io.stated_values import LENGTH, Argument, ArgumentGroup, NumberRange
from spinfilters.simulation.scenario_record import FRAMES, INTERVAL, SEED, Place, Rates

ANGLE: Final = NumberRange(-3600.0, 3600.0, "deg")
FIELD: Final = NumberRange(1e-6, 179.0, "deg")
COUNT: Final = NumberRange(1, 100_000, whole=True)
SHARE: Final = NumberRange(0.0, 1.0)
POWER: Final = NumberRange(0.0, 1e18)
Angles = tuple[Annotated[float, ANGLE], Annotated[float, ANGLE], Annotated[float, ANGLE]]
Window = tuple[float, float, float, float]


@dataclass(frozen=True, kw_only=True)
class BodyArguments:
    """The body, its place and its motion."""

    scale: Annotated[
        float,
        NumberRange(1e-12, 1e12),
        Argument("metres in a unit of the mesh: 0.001 for mm, 1000 for km"),
    ] = 1.0
    rotation: Annotated[
        Angles | None, Argument("deg: the mesh is rotated by Rx Ry Rz", metavar=("Z", "Y", "X"))
    ] = None
    translation: Annotated[
        Place | None,
        Argument(
            "place of the mesh's origin, m (default: on the axis, four radii away)", metavar=("X", "Y", "Z")
        ),
    ] = None
    scans: Annotated[
        int | None, FRAMES, Argument("scan the tumbling body so many times: writes a data set")
    ] = None
    points: Annotated[
        bool,
        Argument("with --scans: points of the faces are the measurements, rather than a pose of every scan"),
    ] = False
    interval: Annotated[float, INTERVAL, Argument("seconds between the scans")] = 1.0
    rate_rpm: Annotated[
        Rates,
        Argument(
            "initial rate about the principal axes of the body of uniform density",
            metavar=("MINOR", "INTERMEDIATE", "MAJOR"),
        ),
    ] = (1.0, 2.0, 1.5)
    velocity: Annotated[Place, LENGTH, Argument("of the centre of mass, m/s", metavar=("X", "Y", "Z"))] = (
        0.0,
        0.0,
        0.0,
    )


@dataclass(frozen=True, kw_only=True)
class RayArguments:
    """The rays of a scan."""

    fov: Annotated[
        tuple[Annotated[float, FIELD], Annotated[float, FIELD]] | None,
        Argument("field of view, deg (default: around the body)", metavar=("AZ", "EL")),
    ] = None
    rays: Annotated[
        tuple[Annotated[int, COUNT], Annotated[int, COUNT]] | None,
        Argument("number of rays (default 200 200)", metavar=("AZ", "EL")),
    ] = None
    window: Annotated[
        tuple[Window, ...],
        ANGLE,
        Argument(
            "high-resolution window, deg; may be repeated",
            metavar=("EL_START", "EL_SPAN", "AZ_START", "AZ_SPAN"),
        ),
    ] = ()
    multiplier: Annotated[int, NumberRange(1, 1000, whole=True), Argument("density within windows")] = 2
    scan_seconds: Annotated[
        float, NumberRange(0.0, 1e5, "s"), Argument("duration of a scan during which the body moves")
    ] = 0.0


@dataclass(frozen=True, kw_only=True)
class ErrorArguments:
    """Errors of a scan, and what is lost of it."""

    noise: Annotated[
        Literal["none", "jitter", "encoder", "thesis"] | None,
        Argument(
            "noise of range and angles; jitter: the beam deviates unreported; encoder: its reported direction is wrong; thesis: it "
            "deviates and is reported rightly (default none, or that of the preset)"
        ),
    ] = None
    long_range: Annotated[bool, Argument("0.1 m (3 sigma) of range noise instead of 0.01 m")] = False
    bias: Annotated[bool, Argument("add the largest biases of the specification")] = False
    dust: Annotated[float, SHARE, Argument("share of beams absorbed by dust")] = 0.0
    clutter: Annotated[float, SHARE, Argument("share of returns from dust before the body")] = 0.0
    reflectivity: Annotated[float, SHARE, Argument("of the surface")] = 1.0
    weakest: Annotated[
        float,
        POWER,
        Argument("smallest received power that is measured; 1 is a white surface met head-on at 500 m"),
    ] = 0.0
    strongest: Annotated[float | None, POWER, Argument("received power that saturates the detector")] = None
    sun: Annotated[
        tuple[float, float, float] | None,
        NumberRange(-1.0, 1.0),
        Argument("direction towards the sun, whose glint blinds the detector", metavar=("X", "Y", "Z")),
    ] = None


@dataclass(frozen=True, kw_only=True)
class ScanArguments:
    """A scan, or a sequence of scans of a tumbling body."""

    mesh: Annotated[
        str | None,
        Argument(
            ".stl, .obj, .ply, .tab or .txt in m (see --scale), cube or spacecraft (default: that of the preset)",
            positional=True,
            metavar="MESH",
        ),
    ] = None
    preset: Annotated[
        str | None,
        Argument("inputs of the thesis: table-2.1, table-3.2, figure-2.12 ... figure-2.18", metavar="NAME"),
    ] = None
    seed: Annotated[int, SEED, Argument("seed of all random numbers")] = 0
    body: Annotated[BodyArguments, ArgumentGroup("the body")] = field(default_factory=BodyArguments)
    beams: Annotated[RayArguments, ArgumentGroup("the rays")] = field(default_factory=RayArguments)
    errors: Annotated[ErrorArguments, ArgumentGroup("errors, those of Jena-Optronik's RVS")] = field(
        default_factory=ErrorArguments
    )
