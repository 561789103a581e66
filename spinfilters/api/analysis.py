"""Observability analysis: what a sensor determines of a motion, with proof and bounds."""

import os
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from functools import cached_property
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from observability.analysis_report import Report, analyse
from observability.canonical_motions import motion
from observability.cases import Case, InputSizes, Levels
from observability.further_sensors import FurtherSensors, further_sensors
from observability.reference_trajectory import RecordedInput
from observability.system import Input
from spinfilters.api.arguments import ObserveArguments
from spinfilters.api.blas_threads import on_one_blas_thread
from spinfilters.api.given_settings import SETTINGS_GIVEN, AnySettings, chosen_settings
from spinfilters.core.conventions import RPM
from spinfilters.core.errors import InputError
from spinfilters.io.argument_checks import called, checked_arguments, one_of, optional, path
from spinfilters.io.input_file import path_text, value_text
from spinfilters.io.output_files import output_folder, refuse_foreign, write_json, write_text
from spinfilters.io.table_layout import read_header
from spinfilters.io.text_table import read_csv
from spinfilters.models.process import THESIS_NOISE
from spinfilters.models.state_blocks import BLOCKS
from spinfilters.run.comparison_run import silent
from spinfilters.run.estimation import Progress
from spinfilters.settings.run_settings import AUTO, InitialisationOptions, Settings
from spinfilters.settings.stated_belief import block_named
from spinfilters.simulation.scenario_record import Scenario

if TYPE_CHECKING:
    from matplotlib.figure import Figure


OBSERVE: Final = "observe"
"""Name of the command whose folders are these."""
MOST_EPOCHS: Final = 5000
"""Beyond it the bound takes minutes and says nothing new."""
MOST_TURNS: Final = 100
"""Revolutions between epochs, at most: the motion is integrated step by step."""


SIMULATED_SENSORS: Final = (
    "The following bounds are of simulated measurements, of the sensors of the recording too: as many epochs, its median interval "
    "apart."
)


@dataclass(frozen=True, eq=False, repr=False)
class ObservabilityResult:
    """Result of an observability analysis; printed, it is the text of ``spinfilters observe``.

    Attributes
    ----------
    report : Report
        With the certificate of the rank, the Cramer-Rao bound and the verdict on every quantity.
    further : FurtherSensors or None
        What each further sensor would add; None where it was not asked for.
    """

    report: Report
    further: FurtherSensors | None = None

    @property
    def document(self) -> dict[str, Any]:
        """The content of ``observe.json``."""
        added = {} if self.further is None else {"further_sensors": self.further.document()}
        return self.report.document() | added

    def figure(self) -> "Figure":
        """Ranks by order of derivative, and the bound over time, as a matplotlib figure.

        Returns
        -------
        Figure
            Not yet saved or shown.
        """
        from spinfilters.plots.observability_figures import observability_figure

        return observability_figure(self.report, self.report.title)

    def further_figure(self) -> "Figure":
        """Bounds with each further sensor, and what becomes determined, as a matplotlib figure.

        Returns
        -------
        Figure
            Not yet saved or shown.

        Raises
        ------
        InputError
            No further sensors were asked for.
        """
        from spinfilters.plots.observability_figures import further_sensors_figure

        if self.further is None:
            raise InputError("no further sensors were asked for; give observe(..., further=True)")
        return further_sensors_figure(self.further)

    def write(self, folder: Path, figures: bool = True) -> None:
        """Text, JSON and pictures into a folder that exists. InputError: they cannot be written.

        Parameters
        ----------
        folder : Path
            An existing folder.
        figures : bool
            Whether pictures are drawn.
        """
        from spinfilters.plots.style import save_figure

        write_text(folder / "observe.txt", f"{self}\n")
        if figures:
            save_figure(self.figure(), folder / "observe.png")
            if self.further is not None:
                save_figure(self.further_figure(), folder / "further.png")
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
        lines = list(self.report.sentences)
        if self.further is None:
            return "\n".join(lines)
        if self.report.recording:
            lines.append(SIMULATED_SENSORS)
        return "\n".join([*lines, *self.further.sentences])

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
    table : str, os.PathLike or None
        CSV file with both over time in their place: time_s, and some of torque_x, torque_y, torque_z (N m) and acceleration_x,
        acceleration_y, acceleration_z (m/s^2).
    """

    torque: Sequence[str] = ()
    manoeuvre: Sequence[str] = ()
    sizes: InputSizes = field(default_factory=InputSizes)
    table: str | os.PathLike[str] | None = None

    @property
    def inputs(self) -> tuple[Input, ...]:
        """The inputs as the analyser takes them, each once. InputError: no axis, no sizes."""
        if self.table is not None:
            return tuple(each.axis for each in self.recorded)
        for name, axes in (("torque", self.torque), ("manoeuvre", self.manoeuvre)):
            one_of(str, tuple, list, cure='axes such as ("x", "y")')(name, axes)
        one_of(InputSizes, cure="observability.cases.InputSizes")("sizes", self.sizes)
        for axis in (*self.torque, *self.manoeuvre):
            if axis not in ("x", "y", "z"):
                raise InputError(f"axis {axis!r} is unknown; use x, y or z")
        named = [f"torque about {axis}" for axis in self.torque]
        named += [f"inspector's acceleration along {axis}" for axis in self.manoeuvre]
        return tuple(Input(name) for name in dict.fromkeys(named))

    @cached_property
    def recorded(self) -> tuple[RecordedInput, ...]:
        """The inputs of the table; none without one. InputError: a table that cannot be read, or axes in addition to it."""
        if self.table is None:
            return ()
        if self.torque or self.manoeuvre:
            raise InputError("known inputs are named by axis and by a table; give one of them")
        return recorded_inputs(Path(self.table))


INPUT_COLUMNS: Final = {
    f"{word}_{axis}": Input(f"{phrase} {axis}")
    for word, phrase in (("torque", "torque about"), ("acceleration", "inspector's acceleration along"))
    for axis in "xyz"
}
"""Columns of a table of known inputs."""


def recorded_inputs(path: Path) -> tuple[RecordedInput, ...]:
    """Known inputs of a CSV file, in its order; columns of zeros are left out.

    Raises
    ------
    InputError
        A file that cannot be read, a column that is no input, no clock, times that do not ascend, nothing but zeros.
    """
    names = read_header(path)
    known = ("time_s", *INPUT_COLUMNS)
    for name in names:
        if name not in known:
            raise InputError(
                f"{path_text(path)}: column {value_text(name)} is no known input; use {', '.join(known)}"
            )
    if "time_s" not in names:
        raise InputError(f"{path_text(path)}: has no column time_s; add the times of the inputs, s")
    columns = dict(zip(names, read_csv(path, names).values.T, strict=True))
    time = columns.pop("time_s")
    acting = {name: column for name, column in columns.items() if np.any(column)}
    if not acting:
        raise InputError(
            f"{path_text(path)}: holds no input but zeros; give one that acts, or leave the file out"
        )
    try:
        return tuple(RecordedInput(INPUT_COLUMNS[name], time, column) for name, column in acting.items())
    except InputError as error:
        raise InputError(f"{path_text(path)}: {error}") from None


def levels_of(settings: Settings) -> Levels:
    """Noise, disturbances and priors of the settings of a run, as a bound takes them.

    What is "auto" is the analyser's own: noise and disturbances of the bundled example. Of ``[initialisation]`` are read the
    standard deviations of the first state, those of ``std`` before the others, and ``gyro_bias_std``.

    Parameters
    ----------
    settings : Settings
        Of a run.

    Returns
    -------
    Levels
        For `observability.cases.Case`.

    Raises
    ------
    InputError
        Drag, a constant torque, a flywheel or an acceleration in the state, which the analyser does not know.
    """
    process, initial = settings.process, settings.initialisation
    for name in filter(None, (block.switch for block in BLOCKS.values())):
        if getattr(process, name) not in (False, AUTO):
            raise InputError(
                f"process.{name} is no part of this analysis, which is of free motion; leave it out"
            )
    options = {"s": initial.mass_std, "c": initial.centre_std, "v": initial.speed_std}
    priors = options | stated_deviations(initial)
    noise = {name: std for name, std in asdict(settings.sensors).items() if std != AUTO}
    bias = priors.pop("b", initial.gyro_bias_std)
    return Levels(noise, process.noise(THESIS_NOISE), priors, gyro_bias_std=bias)


def stated_deviations(initial: InitialisationOptions) -> dict[str, float]:
    """Standard deviations of a stated belief of the first state, by block; of each block the root mean square."""
    return {
        block_named("std", word).name: float(np.sqrt(np.mean(np.square(std))))
        for word, std in initial.std.items()
    }


@checked_arguments(
    ObserveArguments,
    known=optional(one_of(KnownInputs, cure="spinfilters.api.analysis.KnownInputs")),
    settings=optional(SETTINGS_GIVEN),
    progress=called,
)
@on_one_blas_thread
def observe(
    sensors: Sequence[str] | str = ObserveArguments.sensors,
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
    settings: AnySettings | None = None,
    further: bool = ObserveArguments.further,
    progress: Progress = silent,
) -> ObservabilityResult:
    """Observability of a motion by some sensors.

    The result proves which directions are observable, with a Cramer-Rao bound.

    Parameters
    ----------
    sensors : str or sequence of str
        One or several of "stereo-tracks", "mono-tracks", "lidar-points", "lidar-poses", "pose", "attitude", "gyro", "magnetometer",
        as `simulate` calls them; one text may list several, with commas. "stereo", "monocular" and "lidar" are accepted too.
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
    settings : Settings, Mapping, str, os.PathLike or None
        Noise of the sensors, disturbances and priors of the bound, as `compare` takes them; see `levels_of`. A ``gyro_bias_std``
        makes the gyro's bias one more unknown, in the filters' state. None takes noise and disturbances of the bundled example.
    further : bool
        Whether each further kind of sensor is added to these, one at a time, to see which helps most.
    progress : Callable[[str, int, int], None]
        Called with what is being done, steps done and steps in all.

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
    levels = Levels() if settings is None else levels_of(chosen_settings(settings))
    case = Case(
        sensors=tuple(name.strip() for name in listed),
        landmarks=landmarks,
        known_map=known_map,
        chart="filter" if levels.gyro_bias_std and chart == ObserveArguments.chart else chart,
        unknowns=unknowns,
        motion=motion(f"{' '.join(f'{rpm:g}' for rpm in rate)} rpm", exact, list(moments)),
        inputs=acting.inputs,
        sizes=acting.sizes,
        levels=levels,
        recorded=acting.recorded,
    )
    report = analyse(case, frames, interval)
    return ObservabilityResult(report, further_sensors(case, frames, interval, progress) if further else None)


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
