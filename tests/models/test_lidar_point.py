"""Points of known planes against a scanner that moves the body ray by ray, independently of the model."""

import numpy as np
import pytest

from spinfilters.core.attitude_conversions import quaternion_from_matrix
from spinfilters.core.mass_distribution import from_inertia
from spinfilters.lidar.mesh import box, mass_properties
from spinfilters.lidar.scan import LidarNoise, RayPattern, Scan
from spinfilters.models.process import ProcessNoise, TorqueFreeProcess
from spinfilters.models.rotation_integrator import ACCELERATION_TERMS
from spinfilters.models.sensors.lidar_points import LidarPoint, lidar_point_parameters
from spinfilters.models.state_layout import FULL_BLOCKS, StateLayout
from spinfilters.simulation.lidar_scanner import LidarSettings, Scanner, TorqueFreeTumble
from spinfilters.simulation.lidar_sequence import Initial, tumble_of

LAYOUT = StateLayout(FULL_BLOCKS)
MESH = box((1.0, 1.3, 0.8))
RATE = np.array([0.15, 0.25, 0.2])
"""rad/s: 20 deg in a scan of a second."""


def motion() -> TorqueFreeTumble:
    rotation = tumble_rotation()
    return tumble_of(
        MESH, Initial(rotation, np.array([10.0, 0.2, -0.1]), RATE, np.array([0.02, -0.01, 0.03]))
    )


def tumble_rotation() -> np.ndarray:
    Q, _ = np.linalg.qr(np.array([[1.0, 0.4, -0.2], [0.3, 1.0, 0.5], [-0.6, 0.2, 1.0]]))
    return Q * np.sign(np.linalg.det(Q))


def scanned(seconds: float) -> tuple[Scan, np.ndarray]:
    """A scan without noise, and the planes (normal, offset) of frame g that its returns lie on."""
    scanner = Scanner.of(
        MESH, LidarSettings(RayPattern((12.0, 12.0), (41, 41)), LidarNoise(), duration=seconds)
    )
    scan = scanner.scan(motion(), 0.0, np.random.default_rng(0))
    R, t = motion().poses(scan.point_times)
    points = np.einsum("nji,nj->ni", R, scan.points - t)
    normals, corners = MESH.normals, MESH.vertices[MESH.triangles[:, 0]]
    offsets = np.einsum("ki,ki->k", normals, corners)
    on = np.abs(points @ normals.T - offsets).argmin(axis=1)
    return scan, np.column_stack([normals[on], offsets[on]])


def true_state(time: float) -> np.ndarray:
    tumble, x = motion(), LAYOUT.origin()
    R, t = tumble.poses(np.array([time]))
    q = quaternion_from_matrix(R[0])
    body = mass_properties(MESH)
    axes = body.principal_axes
    for name, value in {
        "t": t[0],
        "a": q,
        "v": np.array([0.02, -0.01, 0.03]),
        "w": R[0].T @ tumble.rates(np.array([time]))[0],
        "c": body.center_of_mass,
        "s": from_inertia(axes.T @ np.diag(body.principal_moments) @ axes),
    }.items():
        x[LAYOUT.mean_slice(name)] = value
    return x


def ranges_off(scan: Scan, planes: np.ndarray, delays: np.ndarray) -> float:
    rows = scan.is_return
    angles = np.column_stack([scan.azimuth[rows], scan.elevation[rows]])
    noise = np.tile(np.diag([0.01, 1e-4, 1e-4]) ** 2, (len(angles), 1, 1))
    model = LidarPoint(LAYOUT)
    parameters = lidar_point_parameters(angles, delays, planes, noise)
    x = true_state(scan.epoch)
    assert model.linearise(x, parameters, scan.distance[rows, None]).valid.all()
    return float(np.abs(model.predict(x, parameters)[:, 0] - scan.distance[rows]).max())


@pytest.mark.parametrize("seconds", [0.0, 1.0])
def test_the_true_state_predicts_every_range_of_a_scan_in_which_the_body_moves(seconds: float) -> None:
    scan, planes = scanned(seconds)
    assert len(planes) > 200
    assert ranges_off(scan, planes, scan.point_times - scan.epoch) < 2e-5


def test_without_their_own_stamps_points_of_a_moving_body_are_centimetres_off() -> None:
    scan, planes = scanned(1.0)
    assert ranges_off(scan, planes, np.zeros(len(planes))) > 0.03


def test_a_plane_that_faces_away_or_lies_behind_the_lidar_is_not_valid() -> None:
    x = LAYOUT.origin()
    x[LAYOUT.mean_slice("t")] = [10.0, 0.0, 0.0]
    planes = np.array([[-1.0, 0, 0, 0.5], [1.0, 0, 0, 0.5], [-1.0, 0, 0, 10.5], [0.0, 1.0, 0, 0.5]])
    noise = np.tile(1e-4 * np.eye(3), (4, 1, 1))
    parameters = lidar_point_parameters(np.zeros((4, 2)), np.zeros(4), planes, noise)
    valid = LidarPoint(LAYOUT).linearise(x, parameters, np.ones((4, 1))).valid
    np.testing.assert_array_equal(valid, [True, False, False, False])


def test_the_noise_is_that_of_the_range_and_of_the_angles_as_they_change_it() -> None:
    x = LAYOUT.origin()
    x[LAYOUT.mean_slice("t")] = [10.0, 0.0, 0.0]
    tilt = np.deg2rad(60)
    plane = np.array([[-np.cos(tilt), 0.0, np.sin(tilt), 0.0]])
    noise = np.diag([0.01, 2e-3, 1e-3])[None] ** 2
    (W,) = LidarPoint(LAYOUT).whitening(
        x, lidar_point_parameters(np.zeros((1, 2)), np.zeros(1), plane, noise)
    )
    slope = 10.0 * np.tan(tilt)
    np.testing.assert_allclose(1 / W[0, 0], np.hypot(0.01, slope * 2e-3), rtol=1e-12)


@pytest.mark.parametrize("term", sorted(ACCELERATION_TERMS))
def test_during_a_scan_the_body_moves_with_every_constant_that_the_state_has(term: str) -> None:
    block = ACCELERATION_TERMS[term]
    layout = LAYOUT.joined(block)
    x = layout.origin()
    x[layout.mean_slice("t")] = [10.0, 0.0, 0.0]
    x[layout.mean_slice("w")] = RATE
    x[layout.mean_slice(block.name)] = 0.3
    delay = 0.5
    later = TorqueFreeProcess(layout, ProcessNoise(0.0, 0.0)).step(x, delay)
    without = x.copy()
    without[layout.mean_slice(block.name)] = 0.0
    plane, noise = np.array([[-1.0, 0.0, 0.0, 0.5]]), np.tile(1e-4 * np.eye(3), (1, 1, 1))

    def seen(state: np.ndarray, after: float) -> float:
        parameters = lidar_point_parameters(np.array([[0.3, 0.1]]), np.array([after]), plane, noise)
        return float(LidarPoint(layout).predict(state, parameters)[0, 0])

    assert seen(x, delay) == pytest.approx(seen(later, 0.0), abs=1e-6)
    assert abs(seen(without, delay) - seen(later, 0.0)) > 1e-4
