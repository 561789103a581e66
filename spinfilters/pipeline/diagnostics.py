"""Findings about a recording and its initialisation."""

from spinfilters.pipeline.gyro_noise import LARGEST_ERROR
from spinfilters.pipeline.initialisation_length import DETERMINED_STD, moments_std_of
from spinfilters.pipeline.inspector_poses import pose_findings
from spinfilters.pipeline.setup import Setup
from spinfilters.sensors.sensor_registry import sensor_of
from spinfilters.state.status import Finding
from spinfilters.verdict.checks import MOST_MOMENTUM, finding


def shared_diagnostics(setup: Setup) -> list[Finding]:
    """Findings that concern every estimator of a run."""
    found = [*setup.initial.status.findings, *(Finding("data-set", text) for text in setup.dataset.doubts)]
    found += [*_moving_camera(setup), *pose_findings(setup)]
    noise = setup.gyro_noise
    if noise is not None and not noise.is_of_flight:
        numbers = {"percent": 100 * noise.relative_error, "limit": 100 * LARGEST_ERROR}
        found.append(finding("not-a-free-flight", numbers))
    for stream in setup.dataset.log.streams:
        found += [Finding("sensor-data", text) for text in sensor_of(stream.sensor).diagnostics(stream)]
    return found


def _moving_camera(setup: Setup) -> list[Finding]:
    """That a camera which is taken to be at rest may move, where the initialisation did not settle."""
    initial, dataset = setup.initial, setup.dataset
    is_at_rest = dataset.rig is not None and dataset.inspector is None
    if not is_at_rest or initial.converged or not initial.momentum_residual > MOST_MOMENTUM:
        return []
    return [finding("camera-may-move", {"percent": 100 * initial.momentum_residual})]


def filter_diagnostics(setup: Setup) -> list[Finding]:
    """Findings that concern filters alone: a smoother revises its first epochs."""
    if setup.initial.has_failed:
        return []
    std, count = moments_std_of(setup.initial), len(setup.initial.mean)
    if not std <= DETERMINED_STD:
        return [finding("vague-initialisation", {"epochs": count, "std": std})]
    return []
