"""Motion that the measurements of a whole recording say directly."""

from spinfilters.estimators.motion_evidence import MotionEvidence, evidence_from_gyro, evidence_from_poses
from spinfilters.estimators.timeline import noise_level
from spinfilters.perception.track_poses import poses_with_map
from spinfilters.workflow.preparation import Prepared


def measured_motion(prepared: Prepared) -> MotionEvidence:
    """Attitudes, rates and places that the whole recording says directly, without any estimator.

    Raises
    ------
    InputError: when it does not say them: too few poses, or too large turns between them.
    """
    log, dataset, frames = prepared.dataset.log, prepared.dataset, len(prepared.timeline)
    if "stereo" in log.sensors and dataset.rig is not None and dataset.known_map is not None:
        tracks, level = log.stream("stereo"), noise_level(log.stream("stereo"), prepared.noise.pixel_std)
        return evidence_from_poses(
            poses_with_map(tracks, dataset.known_map, dataset.rig.calibration, level), frames
        )
    if "pose" in log.sensors:
        return evidence_from_poses(log.stream("pose"), frames)
    return evidence_from_gyro(log.stream("gyro"), frames)
