"""A live run made ready from a data set: its sensors, noise, camera and initialisation."""

from spinfilters.errors import InputError
from spinfilters.estimators.estimator import Measurement
from spinfilters.estimators.run import REHEARSED
from spinfilters.estimators.smoothing.recursive import RecursiveSmoother
from spinfilters.live.executive import Setup
from spinfilters.logs.dataset import Dataset
from spinfilters.logs.measurement_log import MeasurementStream
from spinfilters.models.measurement import MeasurementModel
from spinfilters.sensors.registry import sensor_of
from spinfilters.workflow.estimator_entry import estimator_entries
from spinfilters.workflow.preparation import Prepared, camera_view, prepare
from spinfilters.workflow.settings import Settings
from spinfilters.workflow.smoothing import begin_at_start, sliding_smoother

LONG_RUN = 100_000
"""Epochs: the smoother of a run without an end lets go of its past."""
FILTERS = ("mekf", "ukf", "embedded", "embedded-double")


def live_setup(dataset: Dataset, settings: Settings, name: str) -> Setup:
    """Initialise from the first epochs of a data set.

    Parameters
    ----------
    name: of the filter, among `FILTERS`.

    Raises
    ------
    InputError: a filter that the data set has nothing for; an initialisation that failed.
    """
    prepared = prepare(dataset, settings)
    if prepared.start.has_failed:
        why = "; ".join(prepared.start.status.reasons)
        raise InputError(f"the first epochs tell no state ({why}); give other ones")
    entry = estimator_entries()[name]
    estimator = entry.build(prepared, settings)
    assert estimator is not None
    entry.begin(estimator, prepared)
    models = _models(prepared)
    view, noise, layout = camera_view(dataset), prepared.noise, prepared.process.layout

    def bind(stream: MeasurementStream) -> Measurement:
        bound = sensor_of(stream.sensor).bind(stream, layout, noise, view)
        model = models.setdefault(bound.model.name, bound.model)
        return Measurement(model, bound.values, bound.parameters, bound.ids)

    first = None
    if sliding_smoother(prepared, settings) is not None:

        def build() -> RecursiveSmoother:
            smoother = RecursiveSmoother(prepared.process, settings.smoother.options(LONG_RUN))
            begin_at_start(smoother, prepared)
            return smoother

        first = (build, prepared.start_end)
    for stream in dataset.log.streams:
        bind(stream)  # built before a clock runs
    count = len(prepared.start.mean)
    rehearsal = prepared.timeline[count : count + REHEARSED]
    return Setup(prepared.process, estimator, prepared.start_end, models, bind, first, rehearsal)


def _models(prepared: Prepared) -> dict[str, MeasurementModel]:
    """Of all sensors of the data set, by name: the smoother's process knows no others."""
    frames = (prepared.timeline[k] for k in range(len(prepared.timeline)))
    models: dict[str, MeasurementModel] = {}
    for frame in frames:
        for measurement in frame.measurements:
            models.setdefault(measurement.model.name, measurement.model)
        if len(models) == len(prepared.dataset.log.sensors):
            break
    return models
