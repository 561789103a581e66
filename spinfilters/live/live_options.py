"""Options and initialisation of a live run."""

from collections.abc import Callable
from dataclasses import dataclass, field

from spinfilters.data.measurement_log import MeasurementStream
from spinfilters.estimators.estimator import Estimator, Measurement, ProcessModel
from spinfilters.estimators.landmarks.landmark_map import LandmarkOptions
from spinfilters.estimators.smoothing.window.smoother_records import SmootherOptions
from spinfilters.estimators.timeline import Timeline
from spinfilters.live.smoother_worker import Build
from spinfilters.live.supervisor import SupervisionOptions
from spinfilters.models.measurement import MeasurementModel

Bind = Callable[[MeasurementStream], Measurement]
"""What makes a measurement of one sensor's rows of an epoch."""


@dataclass(frozen=True)
class LiveOptions:
    """Options of a live run.

    Attributes
    ----------
    deadline: s from an epoch's arrival to its answer.   ahead: s that every answer is predicted ahead, 0 for none.
    history: epochs that a hand-over or a late measurement may be old.   largest_gap: s between epochs that is believed at once.
    smoother: whether there is one.   landmarks: how those that the smoother hands over are held.
    memory: bytes of the smoother's address space, 0 for no limit.
    """

    deadline: float = 0.02
    ahead: float = 0.0
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
    filter: started at ``time`` (s).   models: by sensor.   bind: rows to a measurement.
    first_smoother: the smoother of the initialisation, begun, and its own time then; None to begin from the filter.
    rehearsal: epochs after the initialisation, where the data set has some.
    """

    process: ProcessModel
    filter: Estimator
    time: float
    models: dict[str, MeasurementModel]
    bind: Bind
    first_smoother: tuple[Build, float] | None = None
    rehearsal: Timeline = ()
