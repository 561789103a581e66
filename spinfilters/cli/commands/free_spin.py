"""The command ``polhode``: how a body of given moments turns freely."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from spinfilters.cli.command import Command
from spinfilters.cli.common_options import FigureOptions, draw, print_document
from spinfilters.io.stated_values import Argument, NumberRange
from spinfilters.simulation.scenario_record import Moments, Rates

if TYPE_CHECKING:
    from spinfilters.core.rolling_motion import AxisStability, Cones, RollingMotion


@dataclass(frozen=True, kw_only=True)
class PolhodeArguments:
    """Arguments of ``polhode``."""

    moments: Annotated[
        Moments, Argument("principal moments about x, y, z, of any scale", metavar=("JX", "JY", "JZ"))
    ] = (1.3, 1.0, 0.5)
    rate_rpm: Annotated[Rates, Argument("body rate at t = 0 about x, y, z", metavar=("X", "Y", "Z"))] = (
        0.1,
        10.0,
        0.1,
    )
    duration: Annotated[
        float | None,
        NumberRange(1e-6, 1e9, "s"),
        Argument("time, s (default four periods of the polhode, or ten turns)", metavar="S"),
    ] = None
    output: Annotated[str, Argument("JSON, CSV and pictures", short="-o", metavar="FOLDER")] = "runs/polhode"


def polhode(options: PolhodeArguments) -> int:
    """Compute the motion, write JSON, CSV and pictures, print what it is."""
    import numpy as np

    from spinfilters.cli.console import wide_console
    from spinfilters.core.conventions import RPM
    from spinfilters.core.polhode import are_of_rigid_body
    from spinfilters.core.rolling_motion import rolling_motion
    from spinfilters.io.output_files import output_folder, refuse_foreign, write_json, write_text
    from spinfilters.plots.free_rotation import (
        cones_figure,
        polhode_figure,
        possible_body_figure,
        stability_figure,
    )

    folder = Path(options.output)
    refuse_foreign(folder, COMMAND.name)
    moments, rate = np.array(options.moments), RPM * np.array(options.rate_rpm)
    motion = rolling_motion(moments, rate, options.duration)
    document = describe_motion(moments, rate, motion)
    with output_folder(folder, COMMAND.name) as place:
        write_text(place / "polhode.csv", _table(motion))
        draw(lambda: polhode_figure(moments, rate), place / "polhode.png")
        draw(lambda: cones_figure(moments, rate), place / "cones.png")
        if are_of_rigid_body(moments):
            draw(lambda: stability_figure(moments, float(np.linalg.norm(rate))), place / "stability.png")
        else:
            draw(lambda: possible_body_figure(moments, rate), place / "possible.png")
        write_json(place / "polhode.json", document)
    wide_console().print(
        "\n".join([*document["text"], f"written to {folder}"]), highlight=False, soft_wrap=True
    )
    print_document(document)
    return 0


def describe_motion(moments: Any, rate: Any, motion: "RollingMotion") -> dict[str, Any]:
    """Numbers and sentences on a free rotation; ``moments`` (3,) of any scale, ``rate`` (3,) rad/s in principal axes."""
    import numpy as np

    from spinfilters.core.polhode import are_of_rigid_body, nearest_possible_moments, polhode_of_moments
    from spinfilters.core.rolling_motion import axis_stability, cones

    kind, circular = polhode_of_moments(moments, rate).kind, cones(moments, rate)
    speed, possible = float(np.linalg.norm(rate)), are_of_rigid_body(moments)
    spins = axis_stability(moments, speed) if possible else ()
    return {
        "moments": list(map(float, moments)),
        "rate_rad_s": list(map(float, rate)),
        "is_rigid_body": possible,
        "nearest_possible_moments": nearest_possible_moments(moments).tolist(),
        "kind": kind.name.lower().replace("_", "-"),
        "period_s": motion.period,
        "advance_rad": motion.advance,
        "plane_distance_rad_s": motion.plane_distance,
        "herpolhode_radii_rad_s": list(motion.herpolhode_radii),
        "cones": None
        if circular is None
        else {
            "axis": "xyz"[circular.axis],
            "sense": circular.sense,
            "body_half_angle_rad": circular.body_half_angle,
            "space_half_angle_rad": circular.space_half_angle,
            "nutation_angle_rad": circular.nutation_angle,
            "precession_rad_s": circular.precession_rate,
            "spin_rad_s": circular.spin_rate,
        },
        "stability": {
            "xyz"[found.axis]: {
                "verdict": found.stability.name.lower(),
                "growth_per_s": found.growth_rate,
                "nutation_rad_s": found.nutation_frequency,
            }
            for found in spins
        },
        "text": [
            *_motion_sentences(kind.value, motion),
            *_cone_sentences(circular),
            *_stability_sentences(spins, speed),
        ],
    }


def _motion_sentences(kind: str, motion: "RollingMotion") -> list[str]:
    sentences = [f"The polhode is {kind}." if kind.startswith("a ") else f"The polhode goes {kind}."]
    if math.isfinite(motion.period):
        sentences.append(
            f"The body rate returns after {motion.period:.4g} s, the body then turned by {math.degrees(motion.advance):.4g} deg "
            "about its angular momentum."
        )
    low, high = motion.herpolhode_radii
    sentences.append(
        f"The rate lies on the invariable plane, {motion.plane_distance:.4g} rad/s along the momentum and {low:.4g} to "
        f"{high:.4g} rad/s off it."
    )
    return sentences


def _cone_sentences(found: "Cones | None") -> list[str]:
    if found is None:
        return []
    body, space = math.degrees(found.body_half_angle), math.degrees(found.space_half_angle)
    sense = "no nutation" if found.sense == "none" else f"{found.sense} nutation"
    return [
        f"Axis of symmetry {'xyz'[found.axis]}: {sense}, half angles of body cone {body:.3g} deg and space cone {space:.3g} deg, "
        f"precession {found.precession_rate:.4g} rad/s."
    ]


def _stability_sentences(spins: "tuple[AxisStability, ...]", speed: float) -> list[str]:
    if not spins:
        return [
            "No rigid body has these moments: the largest exceeds the sum of the other two. They are drawn anyway, beside the "
            "nearest body in possible.png."
        ]
    for found in spins:
        if found.growth_rate > 0.0:
            return [
                f"A spin of {speed:.4g} rad/s about {'xyz'[found.axis]} is unstable: disturbances grow with "
                f"{found.growth_rate:.3g} 1/s."
            ]
    return ["No spin about a principal axis is unstable: two moments are equal."]


def _table(motion: "RollingMotion") -> str:
    """CSV of polhode and herpolhode over time."""
    import numpy as np

    rows = np.column_stack([motion.time, motion.body_rate, motion.space_rate])
    head = "time_s," + ",".join(f"{frame}_rate_{axis}_rad_s" for frame in ("body", "space") for axis in "xyz")
    return "\n".join([head, *(",".join(f"{each:.10g}" for each in row) for row in rows.tolist())]) + "\n"


COMMAND = Command(
    "polhode",
    PolhodeArguments,
    polhode,
    "Torque-free motion in closed form, without a recording (Tweddle 2013, section 2.5, Figures 2-6 to 2-10). Moments that no "
    "rigid body can have are drawn all the same, and the output says so. The nearest body that can exist is drawn too.",
    common=FigureOptions,
)
