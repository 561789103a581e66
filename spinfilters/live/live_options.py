"""Options and initialisation of a live run."""

from collections.abc import Callable
from dataclasses import dataclass, field

from spinfilters.core.errors import InputError
from spinfilters.filters.estimator import Estimator, Measurement, ProcessModel
from spinfilters.filters.shared_modes import LandmarkOptions
from spinfilters.filters.timeline import REHEARSED, Timeline
from spinfilters.inference.estimator_entry import begin_with_first_epoch
from spinfilters.inference.setup import Setup, camera_view
from spinfilters.inference.smoother_run import begin_after_initialisation, sliding_smoother
from spinfilters.io.dataset import Dataset
from spinfilters.io.measurement_log import MeasurementStream
from spinfilters.live.live_arguments import LiveArguments
from spinfilters.live.smoother_process import Build, SupervisionOptions
from spinfilters.models.measurement import MeasurementModel
from spinfilters.models.sensor_registry import sensor_of
from spinfilters.run.estimators import estimator_entries
from spinfilters.run.preparation import prepare
from spinfilters.settings.run_settings import Settings
from spinfilters.smoother.recursive_smoother import RecursiveSmoother
from spinfilters.smoother.sliding_smoother import SmootherOptions

Bind = Callable[[MeasurementStream], Measurement]
"""What makes a measurement of one sensor's rows of an epoch."""


@dataclass(frozen=True)
class LiveOptions:
    """Options of a live run.

    Attributes
    ----------
    deadline : float
        s from an epoch's arrival to its answer.
    ahead : float
        s that every answer is predicted ahead, 0 for none.
    history : int
        Epochs that a hand-over or a late measurement may be old.
    largest_gap : float
        s between epochs that is believed at once.
    smoother : bool
        Whether there is one.
    landmarks : LandmarkOptions
        How those that the smoother hands over are held.
    memory : int
        Bytes of the smoother's address space, 0 for no limit.
    """

    deadline: float = LiveArguments.deadline_ms / 1e3
    ahead: float = LiveArguments.predict
    history: int = 100
    largest_gap: float = 60.0
    smoother: bool = True
    supervision: SupervisionOptions = field(default_factory=SupervisionOptions)
    sliding: SmootherOptions = field(default_factory=SmootherOptions)
    landmarks: LandmarkOptions = field(default_factory=LandmarkOptions)
    memory: int = 0


@dataclass(frozen=True)
class LiveSetup:
    """Models and initialisation of a live run.

    Attributes
    ----------
    filter : Estimator
        Started at ``time`` (s).
    models : dict[str, MeasurementModel]
        By sensor.
    bind : Bind
        Rows to a measurement.
    first_smoother : tuple[Build, float] or None
        The smoother of the initialisation, begun, and its own time then; None to begin from the filter.
    rehearsal : Timeline
        Epochs after the initialisation, where the data set has some.
    """

    process: ProcessModel
    filter: Estimator
    time: float
    models: dict[str, MeasurementModel]
    bind: Bind
    first_smoother: tuple[Build, float] | None = None
    rehearsal: Timeline = ()


LONG_RUN = 100_000
"""Epochs: the smoother of a run without an end lets go of its past."""


def live_setup(dataset: Dataset, settings: Settings, name: str) -> LiveSetup:
    """Initialise from the first epochs of a data set.

    Parameters
    ----------
    name : str
        Of the filter, among those of `LiveArguments`.

    Raises
    ------
    InputError
        a filter that the data set has nothing for; an initialisation that failed.
    """
    setup = prepare(dataset, settings)
    if setup.initial.has_failed:
        why = "; ".join(setup.initial.status.reasons)
        raise InputError(f"the first epochs determine no state ({why}); give other ones")
    entry = estimator_entries()[name]
    estimator = entry.build(setup, settings)
    assert estimator is not None
    begin_with_first_epoch(entry, estimator, setup)
    models = _models(setup)
    bind, first = _binding(setup, models), _first_smoother(setup, settings)
    for stream in dataset.log.streams:
        bind(stream)  # built before a clock runs
    count = len(setup.initial.mean)
    rehearsal = setup.timeline[count : count + REHEARSED]
    return LiveSetup(setup.process, estimator, setup.end_of_initialisation, models, bind, first, rehearsal)


def _binding(setup: Setup, models: dict[str, MeasurementModel]) -> Callable[[MeasurementStream], Measurement]:
    """Makes measurements of rows as they arrive; new models join the given ones."""
    view, noise, layout = camera_view(setup.dataset), setup.noise, setup.process.layout

    def bind(stream: MeasurementStream) -> Measurement:
        """A measurement of rows of one sensor."""
        bound = sensor_of(stream.sensor).bind(stream, layout, noise, view)
        model = models.setdefault(bound.model.name, bound.model)
        return Measurement(model, bound.values, bound.parameters, bound.ids)

    return bind


def _first_smoother(setup: Setup, settings: Settings) -> tuple[Callable[[], RecursiveSmoother], float] | None:
    """Builder of the first smoother and the end of its initialisation, s; None where no smoother runs."""
    if sliding_smoother(setup, settings) is None:
        return None

    def build() -> RecursiveSmoother:
        """The smoother after the initialisation."""
        smoother = RecursiveSmoother(setup.process, settings.smoother.options(LONG_RUN))
        begin_after_initialisation(smoother, setup)
        return smoother

    return build, setup.end_of_initialisation


def _models(setup: Setup) -> dict[str, MeasurementModel]:
    """Models of all sensors of the data set by name, as the smoother's process needs."""
    epochs = (setup.timeline[k] for k in range(len(setup.timeline)))
    models: dict[str, MeasurementModel] = {}
    for frame in epochs:
        for measurement in frame.measurements:
            models.setdefault(measurement.model.name, measurement.model)
        if len(models) == len(setup.dataset.log.sensors):
            break
    return models
