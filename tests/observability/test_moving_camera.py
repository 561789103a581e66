"""A camera on a known trajectory: what it determines of a motion is at least what a camera at rest does."""

import numpy as np
import pytest
from jaxtyping import Float

from observability.canonical_motions import CANONICAL_MOTIONS, landmarks
from observability.cramer_rao import cramer_rao_bound, observability_gramian
from observability.exact_numbers import as_floats
from observability.reference_trajectory import ReferenceTrajectory, SensorSchedule
from spinfilters.core.cameras import monocular_camera, stereo_pair
from spinfilters.core.errors import ShapeError
from spinfilters.models.camera_landmarks import MOVING, MonocularLandmark, StereoLandmark, camera_parameters
from spinfilters.models.measurement import MeasurementModel
from spinfilters.models.process import ProcessNoise
from spinfilters.models.sensor_noise import IsotropicNoise
from spinfilters.simulation.inspector import circle as circle_about
from tests.observability.bound_samples import CALIBRATION, LAYOUT, flight_of

FRAMES, INTERVAL = 25, 0.5
TOLERANCE = 1e-13
"""Of the Gramian, scaled to a unit diagonal: its eigenvalues are squares of singular values."""
POINTS = np.stack([as_floats(point) for point in landmarks(5)])
SEEN = np.ones((FRAMES, len(POINTS)), dtype=bool)


def reference() -> ReferenceTrajectory:
    """A tumble."""
    return flight_of(CANONICAL_MOTIONS[0], FRAMES, INTERVAL, ProcessNoise())


def schedule(name: str, poses: Float[np.ndarray, "k 7"] | None) -> SensorSchedule:
    """Unknown landmarks before a camera at rest or at these poses."""
    pose = () if poses is None else (MOVING,)
    if name == "stereo":
        camera = stereo_pair(CALIBRATION)
        model: MeasurementModel = StereoLandmark(LAYOUT, IsotropicNoise(3), camera, *pose)
        return SensorSchedule(model, camera_parameters(POINTS, CALIBRATION, 1.0), 3, SEEN, poses)
    one = CALIBRATION[:4]
    model = MonocularLandmark(LAYOUT, IsotropicNoise(2), monocular_camera(one), *pose)
    return SensorSchedule(model, camera_parameters(POINTS, one, 1.0), 3, SEEN, poses)


def circle() -> Float[np.ndarray, "k 7"]:
    """About the first place of the body."""
    centre = reference().states[0, LAYOUT.mean_slice("t")]
    time = reference().time
    return circle_about(centre)(time - time[0])


def identities() -> Float[np.ndarray, "k 7"]:
    """Of a camera that stays where frame i is."""
    return np.tile([0.0, 0, 0, 0, 0, 0, 1], (FRAMES, 1))


def rank(name: str, poses: Float[np.ndarray, "k 7"] | None) -> int:
    """Directions of the first state and the map that the recording determines."""
    gramian = observability_gramian(reference(), [schedule(name, poses)])
    scale = np.sqrt(np.diag(gramian))
    values = np.linalg.eigvalsh(gramian / np.outer(scale, scale))
    return int((values > TOLERANCE * values[-1]).sum())


@pytest.mark.parametrize(("name", "gained"), [("stereo", 0), ("monocular", 1)])
def test_a_circling_camera_determines_no_less_and_one_camera_the_scale_besides(
    name: str, gained: int
) -> None:
    assert rank(name, circle()) == rank(name, None) + gained


@pytest.mark.parametrize("name", ["stereo", "monocular"])
def test_the_bound_of_a_camera_that_stays_is_that_of_one_at_rest(name: str) -> None:
    bounds = [cramer_rao_bound(reference(), [schedule(name, poses)]).std for poses in (identities(), None)]
    np.testing.assert_allclose(*bounds, rtol=1e-9)


def test_a_trajectory_over_other_epochs_is_refused() -> None:
    with pytest.raises(ShapeError, match="poses"):
        schedule("stereo", identities()[1:])
