"""What a recording can determine: rank and bound at the smoother's estimate of it."""

from dataclasses import replace
from typing import Any, Final

import numpy as np
from jaxtyping import Float, Int

from observability.analysis_report import Report
from observability.canonical_motions import CanonicalMotion, motion
from observability.cases import Case, Levels
from observability.cramer_rao import bounded_quantities, cramer_rao_bound
from observability.further_sensors import further_sensors
from observability.prior_dependence import quantity_bounds
from observability.reference_trajectory import ReferenceTrajectory, SensorSchedule
from observability.system import analysed
from spinfilters.api.analysis import MOST_EPOCHS, ObservabilityResult, stated_deviations
from spinfilters.api.arguments import ObserveArguments
from spinfilters.api.blas_threads import on_one_blas_thread
from spinfilters.api.comparison import given_dataset
from spinfilters.api.given_settings import SETTINGS_GIVEN, AnySettings, chosen_settings
from spinfilters.core.conventions import RPM
from spinfilters.core.errors import InputError
from spinfilters.core.mass_distribution import inertia_matrix
from spinfilters.evaluation.recording_bound import landmarks_at
from spinfilters.filters.timeline import SensorEpochs, by_sensor, times_of
from spinfilters.inference.setup import Setup
from spinfilters.io.argument_checks import called, checked_arguments, one_of, optional, truth
from spinfilters.io.dataset import Dataset
from spinfilters.models.camera_landmarks import MOVING
from spinfilters.models.sensor_registry import sensor_of
from spinfilters.models.state_blocks import BLOCKS, GYRO_BIAS
from spinfilters.models.state_layout import POSE_BLOCKS
from spinfilters.run.comparison_run import compare_dataset, silent
from spinfilters.run.estimation import Progress
from spinfilters.settings.run_settings import FILTER, Settings

SMOOTHER: Final = "smoother"
MOST_LANDMARKS: Final = 60
"""Unknown landmarks in the bound, those that are seen most often: time grows with the cube of their number."""
RANKED_LANDMARKS: Final = 4
"""In the exact rank; more determine nothing more of the motion."""
DIGITS: Final = 4
"""Decimals of rates (rad/s) and ratios of moments in the exact rank."""


NO_MOTION: Final = (
    "the smoother finds no motion in the whole recording, about which a bound could be computed; see what compare says, or give a "
    "part of it with --segment"
)


@checked_arguments(
    segment=optional(one_of(int, str, cure='a number, times such as "6.55:7.4", or "auto"')),
    further=truth,
    settings=optional(SETTINGS_GIVEN),
    progress=called,
)
@on_one_blas_thread
def observe_recording(
    data: Any,
    settings: AnySettings | None = None,
    segment: int | str | None = None,
    *,
    further: bool = ObserveArguments.further,
    progress: Progress = silent,
) -> ObservabilityResult:
    """What a recording can determine: rank and bound at the smoother's estimate of it.

    The bound is that of the measurements as they were made, with their epochs, their noise and the priors of the settings.

    Parameters
    ----------
    data : Dataset, str, os.PathLike, data frame, mapping or array
        As `compare` takes it.
    settings : Settings, Mapping, str, os.PathLike or None
        As `compare` takes them.
    segment : int, str or None
        Of a recording, see `load`.
    further : bool
        Whether each further kind of sensor is added to those of the recording, one at a time, to see which helps most. All are
        simulated then: at as many epochs, the recording's median interval apart, about the motion in its middle.
    progress : Callable[[str, int, int], None]
        Called with what is being done, steps done and steps in all.

    Returns
    -------
    ObservabilityResult
        Rank with its certificate, the bound, and the verdict on every quantity.

    Raises
    ------
    InputError
        What `compare` refuses; a recording in which the smoother finds no motion, or of more than 5000 epochs.
    """
    chosen = Settings() if settings is None else chosen_settings(settings)
    report = recording_report(given_dataset(data, segment), chosen, progress)
    if not further:
        return ObservabilityResult(report)
    time = report.reference.time
    interval = float(np.median(np.diff(time)))
    return ObservabilityResult(report, further_sensors(report.case, len(time), interval, progress))


def recording_report(dataset: Dataset, settings: Settings, progress: Progress) -> Report:
    """Rank and bound at what the smoother finds in a recording.

    The bound is that of the measurements as they were made, at their epochs and with their noise. Of unknown landmarks it takes
    the `MOST_LANDMARKS` that are seen most often, so that all of them determine no less.

    Parameters
    ----------
    dataset : Dataset
        The recording.
    settings : Settings
        Noise and priors, as for a comparison.
    progress : Callable[[str, int, int], None]
        Called with what is being done, steps done and steps in all.

    Returns
    -------
    Report
        Rank, bound and verdict on every quantity.

    Raises
    ------
    InputError
        A recording in which no motion is found, or that is too long.
    """
    comparison = compare_dataset(dataset, replace(settings, estimators=(SMOOTHER,), verdict=FILTER), progress)
    setup, (evaluation,) = comparison.setup, comparison.evaluations
    history = evaluation.history
    if len(history.time) != len(setup.timeline) or not np.isfinite(history.mean).all():
        raise InputError(NO_MOTION)
    if len(history.time) > MOST_EPOCHS:
        raise InputError(
            f"the recording has {len(history.time)} epochs; give at most {MOST_EPOCHS} of them with --segment START:END"
        )
    reference = ReferenceTrajectory(setup.process, times_of(setup.timeline), history.mean)
    case = _case(setup, settings, history.mean)
    schedules, remark = _schedules(setup, history.mean)
    bound = cramer_rao_bound(
        reference, schedules, case.prior_std, case.levels.landmark_std, defined=case.defined
    )
    return Report(
        case,
        case.certificate(),
        reference,
        bound,
        bounded_quantities(bound, reference),
        quantity_bounds(case, reference, bound, longer=False),
        recording=_words(dataset, reference, remark),
    )


def _words(dataset: Dataset, reference: ReferenceTrajectory, remark: str) -> str:
    length = float(reference.time[-1] - reference.time[0])
    return f"{dataset.kind} of {len(reference.time)} epochs in {length:.4g} s{remark}"


def _case(setup: Setup, settings: Settings, states: Float[np.ndarray, "k m"]) -> Case:
    """Question to the exact rank: sensors, noise and priors of the recording, and its motion in few digits."""
    layout = setup.process.layout
    names = tuple(sensor_of(name).name for name in setup.log.sensors)
    options = {option for name in names for option in analysed(name).noise}
    priors = {
        name: settings.initialisation.prior_std(BLOCKS[name])
        for name in layout.blocks
        if name not in (*POSE_BLOCKS, "w")
    }
    priors |= stated_deviations(settings.initialisation)
    bias = priors.pop(GYRO_BIAS.name, 0.0)
    seeing = [name for name in names if analysed(name).sees_points]
    return Case(
        sensors=names,
        landmarks=RANKED_LANDMARKS,
        known_map=bool(seeing) and not setup.initial.has_landmarks,
        chart="filter" if bias else "principal",
        motion=_motion(states[:, layout.mean_slice("w")], states[-1, layout.mean_slice("s")]),
        levels=Levels(
            {name: getattr(setup.noise, name) for name in options},
            setup.process.noise,
            priors,
            gyro_bias_std=bias,
        ),
    )


def _motion(rates: Float[np.ndarray, "k 3"], s: Float[np.ndarray, " 5"]) -> CanonicalMotion:
    """The estimated motion of the middle epoch about principal axes of ascending moments. InputError: no moments of a body."""
    moments, axes = np.linalg.eigh(inertia_matrix(s))
    rate = np.round(rates[len(rates) // 2] @ axes, DIGITS).tolist()
    rpm = " ".join(f"{each / RPM:.3g}" for each in rate)
    try:
        return motion(f"{rpm} rpm in its middle", rate, np.round(moments / moments[-1], DIGITS).tolist())
    except InputError:
        raise InputError(NO_MOTION) from None


def _schedules(setup: Setup, states: Float[np.ndarray, "k m"]) -> tuple[list[SensorSchedule], str]:
    """Every sensor as it measured, and a remark on landmarks that are left out."""
    ids, points = landmarks_at(setup, states)
    found, remark = [], ""
    for each in by_sensor(setup.timeline):
        if each.measurement.ids is None:
            found.append(_schedule(each, len(states)))
            continue
        numbers, counts = np.unique(each.measurement.ids, return_counts=True)
        known = np.isin(numbers, ids)
        chosen = np.sort(numbers[known][np.argsort(-counts[known], kind="stable")[:MOST_LANDMARKS]])
        if len(chosen) < len(numbers):
            remark = (
                f", of which the bound takes the {len(chosen)} landmarks seen most often of {len(numbers)}"
            )
        found.append(_mapping_schedule(each, len(states), chosen, points[np.searchsorted(ids, chosen)]))
    return found, remark


def _schedule(each: SensorEpochs, epochs: int) -> SensorSchedule:
    """A sensor whose rows have parameters of their own: each is an item of one epoch."""
    seen = np.zeros((epochs, len(each.epoch)), dtype=bool)
    seen[each.epoch, np.arange(len(each.epoch))] = True
    return SensorSchedule(each.measurement.model, each.measurement.parameters, 0, seen)


def _mapping_schedule(
    each: SensorEpochs, epochs: int, ids: Int[np.ndarray, " L"], points: Float[np.ndarray, "L 3"]
) -> SensorSchedule:
    """A camera with unknown landmarks: each is an item, seen in some epochs."""
    measurement = each.measurement
    measured = np.asarray(measurement.ids)
    rows = np.flatnonzero(np.isin(measured, ids))
    item = np.searchsorted(ids, measured[rows])
    seen = np.zeros((epochs, len(ids)), dtype=bool)
    seen[each.epoch[rows], item] = True
    parameters, poses = measurement.parameters[rows], None
    if measurement.model.known_pose is not None:
        poses = np.tile([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], (epochs, 1))
        poses[each.epoch[rows]] = parameters[:, -MOVING.parameter_dim :]
        parameters = parameters[:, : -MOVING.parameter_dim]
    items = np.zeros((len(ids), parameters.shape[1]))
    items[item] = parameters
    items[:, :3] = points
    return SensorSchedule(measurement.model, items, 3, seen, poses)
