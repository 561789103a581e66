"""Motion measured directly over a whole recording."""

from spinfilters.data.sensor_format import sensor_format
from spinfilters.estimators.smoothing.initial_motion import InitialMotion, initial_motion
from spinfilters.pipeline.first_epochs import initial_samples
from spinfilters.pipeline.setup import Setup, camera_view


def measured_motion(setup: Setup) -> InitialMotion:
    """Attitudes, rates and positions measured directly over a recording, without an estimator.

    Raises
    ------
    InputError: when it does not say them: too few poses, or too large turns between them.
    """
    dataset = setup.dataset
    known = dataset.known_map is not None
    streams = [s for s in dataset.log.streams if known or not sensor_format(s.sensor).has_landmarks]
    samples = initial_samples(streams, setup.noise, camera_view(dataset))
    return initial_motion(samples, len(setup.timeline))
