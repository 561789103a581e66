"""State, models, timeline and initialisation of a run."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float, Int

from spinfilters.core.camera_trajectory import CameraTrajectory
from spinfilters.filters.estimator import Estimator, LandmarkBelief
from spinfilters.filters.history import EPOCH_ARRAYS
from spinfilters.filters.noise_levels import VarianceComponent
from spinfilters.filters.timeline import CameraView, SensorNoise, Timeline, times_of
from spinfilters.inference.identified_noise import GyroNoise, Unstated
from spinfilters.inference.initial_estimate import InitialEstimate
from spinfilters.io.consider_parameter import ConsideredDeviation
from spinfilters.io.dataset import Dataset
from spinfilters.io.measurement_log import MeasurementLog
from spinfilters.io.sensor_format import sensor_format
from spinfilters.models.process import TorqueFreeProcess
from spinfilters.models.sensor_registry import sensor_of, sensors_in
from spinfilters.models.state_blocks import BLOCKS
from spinfilters.models.state_layout import FULL_BLOCKS, ROTATION_BLOCKS, Gaussian, StateLayout
from spinfilters.settings.run_settings import Settings

NOTHING_SOUGHT = Unstated({}, ())


@dataclass(frozen=True)
class Setup:
    """Models, timeline and initialisation shared by all estimators of a run.

    Attributes
    ----------
    log : MeasurementLog
        Log of the data set, without covariances of rows that the settings replace by a number.
    timeline : Timeline
        All epochs.
    initial : InitialEstimate
        Initialisation, the smoothed first epochs.
    belief : Gaussian or LandmarkBelief
        What every filter begins from at the end of the initialisation, with landmarks where the map is not known.
    map_points : (k, 3) float array or None
        Landmarks, m, frame g: the known map or that of the start, or None.
    gyro_noise : GyroNoise or None
        Identified correlated error of a gyro, or None where it is white or stated.
    identified : tuple[VarianceComponent, ...]
        Other noise that is not stated, as identified.
    unstated : frozenset[str]
        Names of all noise that is not stated.
    sought : Unstated
        What of it is identified, by sensor.
    is_given : bool
        Whether the initialisation was not made from the data, as in studies of filters alone: the belief is one before the
        measurements of the first epoch.
    calibration : tuple[ConsideredDeviation, ...]
        Deviations of the calibration that are considered.
    inflation : Mapping[str, float]
        Inflation of the variances that rows state for themselves, by noise option.
    initial_seconds : float
        Working time of the initialisation, with the identification of noise, s.
    """

    dataset: Dataset
    log: MeasurementLog
    process: TorqueFreeProcess
    timeline: Timeline
    noise: SensorNoise
    initial: InitialEstimate
    belief: Gaussian | LandmarkBelief
    map_points: Float[np.ndarray, "k 3"] | None
    gyro_noise: GyroNoise | None
    identified: tuple[VarianceComponent, ...] = ()
    unstated: frozenset[str] = frozenset()
    sought: Unstated = NOTHING_SOUGHT
    is_given: bool = False
    calibration: tuple[ConsideredDeviation, ...] = ()
    inflation: Mapping[str, float] = field(default_factory=dict)
    initial_seconds: float = 0.0

    @property
    def initial_runtime(self) -> Float[np.ndarray, " k"]:
        """Working time of every epoch of the initialisation, s: all of it in the last, because none is estimated before."""
        runtime = np.zeros(len(self.initial.mean))
        runtime[-1] = self.initial_seconds
        return runtime

    @property
    def initial_arrays(self) -> dict[str, np.ndarray]:
        """Every array of `EPOCH_ARRAYS` of the initialisation's epochs, which no error or count includes."""
        start, count = self.initial, len(self.initial.mean)
        return dict.fromkeys(EPOCH_ARRAYS, np.zeros(count)) | {
            "time": times_of(self.timeline[:count]),
            "mean": start.mean,
            "factor": start.factor,
            "runtime": self.initial_runtime,
        }

    @property
    def end_of_initialisation(self) -> float:
        """Time of the last epoch of the initialisation, s."""
        return self.timeline[len(self.initial.mean) - 1].time

    def take_in_first_epoch(self, estimator: Estimator) -> None:
        """Update an estimator that begins from a given belief by the measurements of its epoch; else do nothing.

        Parameters
        ----------
        estimator : Estimator
            Started with the belief.
        """
        if self.is_given:
            estimator.update_all(self.timeline[0].measurements)

    @property
    def observations(self) -> Int[np.ndarray, " n"]:
        """Rows of the log at each epoch, those of landmarks that a known map lacks included."""
        times = times_of(self.timeline)
        counts = np.zeros(len(times), dtype=np.int64)
        for stream in self.dataset.log.streams:
            offsets = stream.epoch_offsets
            stamps, rows = stream.time[offsets[:-1]], np.diff(offsets)
            at = np.minimum(np.searchsorted(stamps, times), len(stamps) - 1)
            counts += np.where(stamps[at] == times, rows[at], 0)
        return counts

    @property
    def maps_landmarks(self) -> bool:
        """Whether estimators find the landmarks: those of the initialisation, or all of them from a given belief on."""
        return self.initial.has_landmarks or (self.is_given and maps_landmarks(self.dataset))

    @property
    def known_frames(self) -> bool:
        """Whether the estimate's frames are the truth's."""
        return knows_frames(self.dataset)


def maps_landmarks(dataset: Dataset) -> bool:
    """Whether a data set has tracks of landmarks whose map is not known."""
    return not knows_frames(dataset) and any(
        sensor_format(sensor).has_landmarks for sensor in dataset.log.sensors
    )


def knows_frames(dataset: Dataset) -> bool:
    """Whether a data set, by map or sensor, determines frames i and g."""
    if dataset.known_map is not None:
        return True
    return sensor_of(dataset.sensor).knows_frames(dataset.log.stream(dataset.sensor))


def camera_view(dataset: Dataset) -> CameraView | None:
    """Map and calibration that landmark rows are measured against; None without any."""
    if dataset.rig is None:
        return None
    return CameraView(dataset.known_map, dataset.rig.calibration, CameraTrajectory.of(dataset.inspector))


def layout_of(log: MeasurementLog, settings: Settings) -> StateLayout:
    """Layout of what the sensors observe, with the constants that the settings ask for."""
    sensors = sensors_in(log)
    layout = StateLayout(FULL_BLOCKS if any(sensor.sees_place for sensor in sensors) else ROTATION_BLOCKS)
    for block in BLOCKS.values():
        is_asked = block.switch and getattr(settings.process, block.switch) in block.switched_by
        if is_asked and (layout.translates or not block.translational):
            layout = layout.joined(block)
    for block in (block for sensor in sensors for block in sensor.error_blocks):
        if settings.initialisation.states_prior(block):
            layout = layout.joined(block)
    return layout
