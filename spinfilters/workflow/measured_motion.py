"""Motion that the measurements of a whole recording say directly."""

from spinfilters.estimators.motion_evidence import MotionEvidence, motion_evidence
from spinfilters.logs.sensor_format import sensor_format
from spinfilters.workflow.preparation import Prepared, camera_view, initial_samples


def measured_motion(prepared: Prepared) -> MotionEvidence:
    """Attitudes, rates and places that the whole recording says directly, without any estimator.

    Raises
    ------
    InputError: when it does not say them: too few poses, or too large turns between them.
    """
    dataset = prepared.dataset
    known = dataset.known_map is not None
    streams = [s for s in dataset.log.streams if known or not sensor_format(s.sensor).has_landmarks]
    samples = initial_samples(streams, prepared.noise, camera_view(dataset))
    return motion_evidence(samples, len(prepared.timeline))
