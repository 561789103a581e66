"""The command ``threshold``: does a target tumble or spin, for an inspector that keeps station?"""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final, Literal

from spinfilters.cli.command import Command
from spinfilters.cli.common_options import FigureOptions, draw, print_document
from spinfilters.io.stated_values import Argument, NumberRange

if TYPE_CHECKING:
    from spinfilters.core.spin_threshold import InspectionMission, SpinThreshold

POSITIVE: Final = {name: NumberRange(1e-9, 1e9, name) for name in ("m", "kg", "N", "s")}
MISSION_FIELDS: Final = {
    "radius": "station_keeping_radius",
    "mass": "inspector_mass",
    "force": "max_force",
    "specific_impulse": "specific_impulse",
    "mass_fraction": "max_mass_fraction",
    "duration": "duration",
}
"""Arguments that replace values of the mission, and the mission's names for them."""


@dataclass(frozen=True, kw_only=True)
class ThresholdArguments:
    """Arguments of ``threshold``; what is not given is the mission's."""

    mission: Annotated[
        Literal["spheres", "orbital-express"],
        Argument("mission with the default values (Tweddle 2013, Table 1.1)"),
    ] = "spheres"
    radius: Annotated[
        float | None, POSITIVE["m"], Argument("distance of station keeping, m", metavar="M")
    ] = None
    mass: Annotated[
        float | None, POSITIVE["kg"], Argument("mass of the inspector at the start, kg", metavar="KG")
    ] = None
    force: Annotated[
        float | None, POSITIVE["N"], Argument("largest thrust towards the target, N", metavar="N")
    ] = None
    specific_impulse: Annotated[
        float | None, POSITIVE["s"], Argument("specific impulse of the thrusters, s", metavar="S")
    ] = None
    mass_fraction: Annotated[
        float | None,
        NumberRange(1e-9, 0.999999),
        Argument("propellant for station keeping over the inspector's mass, 0.029 for 2.9 %", metavar="PART"),
    ] = None
    duration: Annotated[float | None, POSITIVE["s"], Argument("time of station keeping, s", metavar="S")] = (
        None
    )
    rate_rpm: Annotated[
        float | None,
        NumberRange(-1e6, 1e6, "rpm"),
        Argument("rate of the target, to say whether it tumbles or spins", metavar="RPM"),
    ] = None
    output: Annotated[str, Argument("JSON, CSV and picture", short="-o", metavar="FOLDER")] = "runs/threshold"


def threshold(options: ThresholdArguments) -> int:
    """Compute both limits, write JSON, CSV and a picture, print them."""
    from spinfilters.cli.console import wide_console
    from spinfilters.core.conventions import RPM
    from spinfilters.core.spin_threshold import spin_threshold
    from spinfilters.io.output_files import output_folder, refuse_foreign, write_json, write_text
    from spinfilters.plots.free_rotation import spin_threshold_figure

    folder, mission = Path(options.output), mission_of(options)
    refuse_foreign(folder, COMMAND.name)
    found = spin_threshold(mission)
    sentences = _sentences(mission, found, options.rate_rpm)
    rates = {} if options.rate_rpm is None else {"the target": options.rate_rpm * RPM}
    document = {
        "mission": {name: getattr(mission, name) for name in MISSION_FIELDS.values()},
        "threshold_rpm": {
            "thrust": found.force / RPM,
            "propellant": found.mass_fraction / RPM,
            "overall": found.overall / RPM,
        },
        "target": None
        if options.rate_rpm is None
        else {"rate_rpm": options.rate_rpm, "regime": found.regime(options.rate_rpm * RPM).value},
        "text": sentences,
    }
    with output_folder(folder, COMMAND.name) as place:
        write_text(place / "threshold.csv", _table(mission))
        draw(lambda: spin_threshold_figure({_name(options): mission}, rates), place / "threshold.png")
        write_json(place / "threshold.json", document)
    wide_console().print("\n".join([*sentences, f"written to {folder}"]), highlight=False, soft_wrap=True)
    print_document(document)
    return 0


def mission_of(options: ThresholdArguments) -> "InspectionMission":
    """The named mission with the values that are given."""
    from dataclasses import replace

    from spinfilters.core.spin_threshold import ORBITAL_EXPRESS, SPHERES

    mission = SPHERES if options.mission == "spheres" else ORBITAL_EXPRESS
    given = {field: getattr(options, name) for name, field in MISSION_FIELDS.items()}
    return replace(mission, **{field: value for field, value in given.items() if value is not None})


def _name(options: ThresholdArguments) -> str:
    changed = any(getattr(options, name) is not None for name in MISSION_FIELDS)
    return (
        "own mission"
        if changed
        else {"spheres": "SPHERES", "orbital-express": "Orbital Express"}[options.mission]
    )


def _sentences(mission: "InspectionMission", found: "SpinThreshold", rate_rpm: float | None) -> list[str]:
    from spinfilters.core.conventions import RPM

    limits = found.force / RPM, found.mass_fraction / RPM
    first = "thrust" if limits[0] < limits[1] else "propellant"
    sentences = [
        f"At {mission.station_keeping_radius:g} m the thrust suffices up to {limits[0]:.4g} rpm, the propellant up to "
        f"{limits[1]:.4g} rpm (Tweddle 2013, Eqs 1.2, 1.10).",
        f"A target tumbles below {min(limits):.4g} rpm, where the {first} ends; from there on it spins, and its rate "
        "must be estimated.",
    ]
    if rate_rpm is not None:
        verb = "tumbles" if found.regime(rate_rpm * RPM).value == "tumbling" else "spins"
        sentences.append(f"At {abs(rate_rpm):g} rpm the target {verb}.")
    return sentences


def _table(mission: "InspectionMission") -> str:
    """CSV of the limits over the distance of station keeping, the picture's numbers."""
    from dataclasses import replace

    import numpy as np

    from spinfilters.core.conventions import RPM
    from spinfilters.core.spin_threshold import spin_threshold

    lines = ["station_keeping_radius_m,by_thrust_rpm,by_propellant_rpm,overall_rpm"]
    for radius in mission.station_keeping_radius * np.geomspace(0.1, 10.0, 41):
        limit = spin_threshold(replace(mission, station_keeping_radius=float(radius)))
        numbers = (radius, *(each / RPM for each in (limit.force, limit.mass_fraction, limit.overall)))
        lines.append(",".join(f"{each:.9g}" for each in numbers))
    return "\n".join(lines) + "\n"


COMMAND = Command(
    "threshold",
    ThresholdArguments,
    threshold,
    "An inspector that keeps station over a point of a rotating target flies a circle (Tweddle 2013, section 1.2). The target "
    "tumbles while thrust and propellant suffice for that; otherwise it spins, and its rate must be estimated.",
    common=FigureOptions,
)
