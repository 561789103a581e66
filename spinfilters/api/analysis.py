"""Observability analysis: what a sensor determines of a motion, with proof and bounds."""

import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from observability.analysis_report import Report, analyse, title
from observability.canonical_motions import motion
from observability.cases import Case, InputSizes
from observability.system import Input
from spinfilters.api.argument_ranges import FRAMES, LANDMARKS, MOMENT, require_motion
from spinfilters.api.argument_ranges import INTERVAL as INTERVALS
from spinfilters.api.argument_ranges import RATE_RPM as RATES
from spinfilters.api.blas_threads import on_one_blas_thread
from spinfilters.core.conventions import RPM
from spinfilters.core.errors import InputError
from spinfilters.io.argument_checks import (
    checked_arguments,
    names,
    number,
    one_of,
    optional,
    path,
    text,
    three_numbers,
    truth,
)
from spinfilters.io.output_files import output_folder, refuse_foreign, write_json, write_text
from spinfilters.simulation.bundled_example import EPOCHS, INTERVAL, PRINCIPAL_MOMENTS, RATE_RPM

if TYPE_CHECKING:
    from matplotlib.figure import Figure


OBSERVE: Final = "observe"
"""Name of the command whose folders are these."""
MOST_EPOCHS: Final = 5000
"""Beyond it the bound takes minutes and says nothing new."""
MOST_TURNS: Final = 100
"""Revolutions between epochs, at most: the motion is integrated step by step."""


@dataclass(frozen=True, eq=False, repr=False)
class ObservabilityResult:
    """Result of an observability analysis; printed, it is the text of ``spinfilters observe``.

    Attributes
    ----------
    report: with the certificate of the rank, the Cramer-Rao bound and the verdict on every quantity.
    """

    report: Report

    @property
    def document(self) -> dict[str, Any]:
        """The content of ``observe.json``."""
        return self.report.document()

    def figure(self) -> "Figure":
        """Ranks by order of derivative, and the bound over time, as a matplotlib figure."""
        from spinfilters.plots.observability_figures import observability_figure

        return observability_figure(self.report, title(self.report.case))

    def write(self, folder: Path) -> None:
        """Text, JSON and picture into a folder that exists. InputError: they cannot be written."""
        from spinfilters.plots.style import save_figure

        write_text(folder / "observe.txt", f"{self}\n")
        save_figure(self.figure(), folder / "observe.png")
        write_json(folder / "observe.json", self.document)

    @checked_arguments(folder=path("a folder"))
    def save(self, folder: str | os.PathLike[str]) -> Path:
        """Text, JSON and picture in a folder as the command writes them; returns its path.

        Raises
        ------
        InputError: it holds something else, or cannot be written.
        """
        refuse_foreign(Path(folder), OBSERVE)
        with output_folder(Path(folder), OBSERVE) as place:
            self.write(place)
        return Path(folder)

    def __str__(self) -> str:
        return "\n".join(self.report.sentences)

    __repr__ = __str__

    def _repr_html_(self) -> str:
        """For a notebook."""
        return f"<pre>{escape(str(self))}</pre>"


@dataclass(frozen=True)
class KnownInputs:
    """Known torques on the body and known accelerations of the inspector.

    Attributes
    ----------
    torque: axes x, y, z of the body with a known torque.   manoeuvre: axes of the camera along which the inspector accelerates.
    sizes: amplitudes (N m, m/s^2) and period (s) of both.
    """

    torque: Sequence[str] = ()
    manoeuvre: Sequence[str] = ()
    sizes: InputSizes = field(default_factory=InputSizes)

    @property
    def inputs(self) -> tuple[Input, ...]:
        """The inputs as the analyser takes them, each once. InputError: no axis, no sizes."""
        for name, axes in (("torque", self.torque), ("manoeuvre", self.manoeuvre)):
            one_of(str, tuple, list, cure='axes such as ("x", "y")')(name, axes)
        one_of(InputSizes, cure="observability.cases.InputSizes")("sizes", self.sizes)
        for axis in (*self.torque, *self.manoeuvre):
            if axis not in ("x", "y", "z"):
                raise InputError(f"axis {axis!r} is unknown; use x, y or z")
        named = [f"torque about {axis}" for axis in self.torque]
        named += [f"inspector's acceleration along {axis}" for axis in self.manoeuvre]
        return tuple(Input(name) for name in dict.fromkeys(named))


@checked_arguments(
    sensors=names('names of sensors such as "stereo,gyro", or a list of at least one'),
    rate_rpm=three_numbers(RATES),
    moments=three_numbers(MOMENT),
    frames=number(FRAMES),
    interval=number(INTERVALS),
    landmarks=number(LANDMARKS),
    known_map=truth,
    chart=text('"principal", "tensor" or "filter"'),
    unknowns=text('"ratios" or "moments"'),
    known=optional(one_of(KnownInputs, cure="spinfilters.api.analysis.KnownInputs")),
)
@on_one_blas_thread
def observe(
    sensors: Sequence[str] | str = "stereo",
    *,
    rate_rpm: Sequence[float] = RATE_RPM,
    moments: Sequence[float] = PRINCIPAL_MOMENTS,
    frames: int = EPOCHS,
    interval: float = INTERVAL,
    landmarks: int = 4,
    known_map: bool = False,
    chart: str = "principal",
    unknowns: str = "ratios",
    known: KnownInputs | None = None,
) -> ObservabilityResult:
    """Observability of a motion by some sensors.

    The result proves which directions are observable, with a Cramer-Rao bound.

    Parameters
    ----------
    sensors: one or several of "stereo", "monocular", "lidar", "pose", "attitude", "gyro"; one text may list several, with commas.
    rate_rpm: (3,) about the principal axes x, y, z, rpm.   moments: (3,) about them, any scale.
    frames: number of epochs, at most 5000.   interval: between them, s.
    landmarks: that each camera or lidar sees.   known_map: whether they are known.
    chart: coordinates of the unknowns: "principal", "tensor" or "filter".
    unknowns: of the inertia in the principal chart: "ratios" or "moments".
    known: torques and accelerations that are known, None for none.

    Raises
    ------
    InputError: an unknown sensor, chart, kind of unknowns or axis, a number out of its range, a motion that is too
    fast for the interval.
    """
    rate, inertia = tuple(rate_rpm), tuple(moments)
    require_motion(frames, interval, rate, inertia)
    _require_bound(frames, interval, rate)
    acting = known or KnownInputs()
    exact = [round(rpm * RPM, 12) for rpm in rate]  # 0 rpm about an axis is exactly 0
    case = Case(
        sensors=_names(sensors),
        landmarks=landmarks,
        known_map=known_map,
        chart=chart,
        unknowns=unknowns,
        motion=motion(f"{' '.join(f'{rpm:g}' for rpm in rate)} rpm", exact, list(inertia)),
        inputs=acting.inputs,
        sizes=acting.sizes,
    )
    return ObservabilityResult(analyse(case, frames, interval))


def _names(sensors: Sequence[str] | str) -> tuple[str, ...]:
    """Names of sensors, of a text that lists them too."""
    listed = sensors.split(",") if isinstance(sensors, str) else sensors
    return tuple(name.strip() for name in listed)


def _require_bound(frames: int, interval: float, rate_rpm: tuple[float, ...]) -> None:
    """Refuse recordings whose bound would take too long, and motions that are too fast between epochs."""
    if frames > MOST_EPOCHS:
        raise InputError(f"frames is {frames}; give 1 to {MOST_EPOCHS}")
    fastest = max(map(abs, rate_rpm))
    if fastest * interval / 60 > MOST_TURNS:
        raise InputError(
            f"a rate of {' '.join(f'{rpm:g}' for rpm in rate_rpm)} rpm at an interval of {interval:g} s; give at most {MOST_TURNS} "
            "revolutions between epochs"
        )
