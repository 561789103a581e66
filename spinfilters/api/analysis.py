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
from spinfilters.api.arguments import ObserveArguments
from spinfilters.api.blas_threads import on_one_blas_thread
from spinfilters.core.conventions import RPM
from spinfilters.core.errors import InputError
from spinfilters.io.argument_checks import checked_arguments, one_of, optional, path
from spinfilters.io.output_files import output_folder, refuse_foreign, write_json, write_text
from spinfilters.simulation.scenario_record import Scenario

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
    report : Report
        With the certificate of the rank, the Cramer-Rao bound and the verdict on every quantity.
    """

    report: Report

    @property
    def document(self) -> dict[str, Any]:
        """The content of ``observe.json``."""
        return self.report.document()

    def figure(self) -> "Figure":
        """Ranks by order of derivative, and the bound over time, as a matplotlib figure.

        Returns
        -------
        Figure
            Not yet saved or shown.
        """
        from spinfilters.plots.observability_figures import observability_figure

        return observability_figure(self.report, title(self.report.case))

    def write(self, folder: Path) -> None:
        """Text, JSON and picture into a folder that exists. InputError: they cannot be written.

        Parameters
        ----------
        folder : Path
            An existing folder.
        """
        from spinfilters.plots.style import save_figure

        write_text(folder / "observe.txt", f"{self}\n")
        save_figure(self.figure(), folder / "observe.png")
        write_json(folder / "observe.json", self.document)

    @checked_arguments(folder=path("a folder"))
    def save(self, folder: str | os.PathLike[str]) -> Path:
        """Text, JSON and picture in a folder as the command writes them.

        Parameters
        ----------
        folder : str or os.PathLike
            New, or one that an earlier analysis has written.

        Returns
        -------
        Path
            Of the folder.

        Raises
        ------
        InputError
            It holds something else, or cannot be written.
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
    torque : sequence of str
        Axes x, y, z of the body with a known torque.
    manoeuvre : sequence of str
        Axes of the camera along which the inspector accelerates.
    sizes : InputSizes
        Amplitudes (N m, m/s^2) and period (s) of both.
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
    ObserveArguments, known=optional(one_of(KnownInputs, cure="spinfilters.api.analysis.KnownInputs"))
)
@on_one_blas_thread
def observe(
    sensors: Sequence[str] | str = "stereo",
    *,
    rate_rpm: Sequence[float] = Scenario.rate_rpm,
    moments: Sequence[float] = Scenario.principal_moments,
    frames: int = Scenario.epochs,
    interval: float = Scenario.interval,
    landmarks: int = ObserveArguments.landmarks,
    known_map: bool = ObserveArguments.known_map,
    chart: str = ObserveArguments.chart,
    unknowns: str = ObserveArguments.unknowns,
    known: KnownInputs | None = None,
) -> ObservabilityResult:
    """Observability of a motion by some sensors.

    The result proves which directions are observable, with a Cramer-Rao bound.

    Parameters
    ----------
    sensors : str or sequence of str
        One or several of "stereo", "monocular", "lidar", "pose", "attitude", "gyro"; one text may list several, with commas.
    rate_rpm : sequence of 3 floats
        About the principal axes x, y, z, rpm.
    moments : sequence of 3 floats
        About them, any scale.
    frames : int
        Number of epochs, at most 5000.
    interval : float
        Between them, s.
    landmarks : int
        That each camera or lidar sees.
    known_map : bool
        Whether they are known.
    chart : str
        Coordinates of the unknowns: "principal", "tensor" or "filter".
    unknowns : str
        Of the inertia in the principal chart: "ratios" or "moments".
    known : KnownInputs or None
        Torques and accelerations that are known, None for none.

    Returns
    -------
    ObservabilityResult
        Rank with its certificate, the bound, and the verdict on every quantity.

    Raises
    ------
    InputError
        An unknown sensor, chart, kind of unknowns or axis, a number out of its range, a motion that is too fast for the interval.
    """
    rate = tuple(rate_rpm)
    _require_bound(frames, interval, rate)
    acting = known or KnownInputs()
    exact = [round(rpm * RPM, 12) for rpm in rate]  # 0 rpm about an axis is exactly 0
    listed = sensors.split(",") if isinstance(sensors, str) else sensors
    case = Case(
        sensors=tuple(name.strip() for name in listed),
        landmarks=landmarks,
        known_map=known_map,
        chart=chart,
        unknowns=unknowns,
        motion=motion(f"{' '.join(f'{rpm:g}' for rpm in rate)} rpm", exact, list(moments)),
        inputs=acting.inputs,
        sizes=acting.sizes,
    )
    return ObservabilityResult(analyse(case, frames, interval))


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
