"""A data set and settings made ready for any estimator: process, timeline, initialisation."""

from dataclasses import replace

from spinfilters.data.dataset import Dataset
from spinfilters.pipeline.acceleration_state import with_acceleration_if_told
from spinfilters.pipeline.considered_calibration import considered_deviations
from spinfilters.pipeline.drag_law import with_likelier_drag
from spinfilters.pipeline.first_epochs import BoundLog, GivenInitialisation
from spinfilters.pipeline.identified_noise import ROUNDS, with_identified_noise
from spinfilters.pipeline.setup import NOTHING_SOUGHT, Setup, camera_view
from spinfilters.pipeline.stated_noise import (
    layout_of,
    levels_of_rows,
    log_with_noise,
    models_beside,
    stated_models,
    unstated_names,
    unstated_noise,
)
from spinfilters.settings.run_settings import AUTO, Settings
from spinfilters.symbolic.working_time import working_seconds

BESIDE_ROUNDS = 2
"""Initialisations at most from the noise of another setup."""


def prepare(dataset: Dataset, settings: Settings, initial: GivenInitialisation | None = None) -> Setup:
    """Join a data set with models and smooth its first epochs.

    Parameters
    ----------
    initial: gives the initialisation where the first epochs are not to be smoothed.

    Raises
    ------
    InputError: too few epochs, no rotation, tracks that no pose can be found from. The text names the data set.
    """
    begin = working_seconds()

    def make(own: Settings, beside: Setup | None) -> Setup:
        """The setup with these settings, see `Make`."""
        return _setup(dataset, own, None, beside)

    with dataset.naming():
        if initial is None:
            settings = with_likelier_drag(make, settings)
        if initial is not None or settings.process.gravity != AUTO:
            setup = _setup(dataset, settings, initial)
        else:
            setup = with_acceleration_if_told(make, settings)
    return replace(setup, initial_seconds=working_seconds() - begin)


def _setup(
    dataset: Dataset, settings: Settings, initial: GivenInitialisation | None, beside: Setup | None = None
) -> Setup:
    """Beside another setup from its noise and body."""
    log = log_with_noise(dataset.log, settings)
    layout = layout_of(log, settings)
    if beside is None:
        stated, likely = stated_models(dataset, log, layout, settings), None
    else:
        stated, likely = models_beside(beside, layout, settings), beside.initial
    silent, view = NOTHING_SOUGHT, camera_view(dataset)
    binding = BoundLog(replace(dataset, log=log), view, layout, settings, initial, likely)
    if initial is not None:
        made, components = binding(stated.process, stated.noise, None), ()
    else:
        silent = unstated_noise(log, dataset, settings, stated.unknown) if beside is None else beside.sought
        rounds = ROUNDS if beside is None else BESIDE_ROUNDS
        made, components = with_identified_noise(binding, stated.process, stated.noise, silent, rounds)
    known = None if dataset.known_map is None else dataset.known_map.points
    return Setup(
        *(dataset, log, made.process, made.timeline, made.noise, made.start),
        belief=made.start.joint_belief(settings.landmarks),
        map_points=made.start.points if made.start.has_landmarks else known,
        gyro_noise=stated.gyro_noise,
        identified=components,
        unstated=unstated_names(dataset, settings),
        sought=silent,
        is_given=initial is not None,
        calibration=considered_deviations(dataset, settings, layout),
        inflation=levels_of_rows(log, dataset),
    )
