"""Points of lidar scans on known planes of the body, and landmarks by range and angles for the observability analyser.

First poses come from these points, one per scan, motion during the scan left out.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import casadi as ca
import numpy as np
from jaxtyping import Float

from spinfilters.core.attitude_conversions import (
    continuous_quaternions,
    matrix_from_quaternion,
    matrix_from_rotation_vector,
    quaternion_from_matrix,
)
from spinfilters.core.attitude_expressions import Expression, normalised, quaternion_rate, rotate
from spinfilters.core.errors import InputError
from spinfilters.core.gauss_newton import LeastSquaresEnd, StepEquations, gauss_newton, step_equations
from spinfilters.core.linear_algebra import evenly_spaced
from spinfilters.core.mass_distribution import inertia
from spinfilters.io.camera import Rig
from spinfilters.io.measurement_log import MeasurementStream
from spinfilters.io.sensor_format import NoiseOption, SensorFormat, SensorNoise
from spinfilters.io.stated_values import NumberRange
from spinfilters.models.measurement import MeasurementModel
from spinfilters.models.process import body_acceleration
from spinfilters.models.rotation_integrator import (
    ACCELERATION_TERMS,
    acceleration_constants,
    runge_kutta_step,
)
from spinfilters.models.sensor import (
    AnalysedSensor,
    BoundStream,
    CameraView,
    MotionSamples,
    Scene,
    Sensor,
    SimulatedStream,
    model_over,
    row_covariance,
)
from spinfilters.models.sensor_noise import factor_of, parameters_of
from spinfilters.models.state_layout import StateLayout

NEAREST_RANGE = 1e-3
"""Range in m below which a point counts as at the lidar itself."""


class LidarLandmark(MeasurementModel):
    """z = t + R_ig p_g, the point in the lidar's frame i.

    m, with the noise of a range and of two angles.
    Range, azimuth and elevation are held as the point that they give: the same information, and neither square roots nor the
    poles of the angles. With r = |z| and u = z / r the noise covariance is range_std^2 u u' + (r angle_std)^2 (I - u u'):
    angle_std is that of azimuth and elevation as arcs on the sphere, alike in every direction.
    Parameters of a measurement: (p_g 3 m, range_std m, angle_std rad). The noise is taken where the map says that the point is,
    so that no landmark can be made from a measurement before one is known: this is no `LandmarkSensor`.
    """

    name = "lidar"
    dim = 3
    value_dim = 3
    parameter_dim = 5
    needs = ("t", "a")

    def symbolic(self, state: dict[str, Expression], parameters: Expression) -> Expression:
        """t + R_ig p_g, the point in frame i, m."""
        return state["t"] + rotate(state["q"], parameters[:3])

    def noise_factor(self, state: dict[str, Expression], parameters: Expression) -> Expression:
        """Cholesky factor of the covariance along and across the beam, m."""
        p = self.symbolic(state, parameters)
        square = ca.fmax(ca.dot(p, p), NEAREST_RANGE**2)
        along = p @ p.T / square
        across = parameters[4] ** 2 * square * (ca.DM.eye(3) - along)
        return ca.chol(ca.SX(parameters[3] ** 2 * along + across)).T

    def valid(self, state: dict[str, Expression], parameters: Expression) -> Expression:
        """Positive beyond the nearest range."""
        p = self.symbolic(state, parameters)
        return ca.dot(p, p) - NEAREST_RANGE**2


GRAZING = 0.02
"""Cosine between a beam and the inward normal, at least: below, a beam skims the plane and its range carries no information."""
STEPS = 2
"""Runge-Kutta steps from the scan's epoch to the point's stamp: error below 2e-5 rad for a rotation of 0.5 rad."""


class LidarPoint(MeasurementModel):
    """z = (d + n.t) / (n.u), the range along a lidar's beam, m.

    Where the beam u of the lidar, at the origin of i, meets the plane n_g.p = d.
    n = R_ig n_g and t are those at the point's own stamp: the state is taken there from the scan's epoch by its rates, its velocity
    and Euler's equation, so that the motion during a scan is part of the model. u = (cos E cos A, sin E, cos E sin A).
    The noise is that of the range, and of the angles as they change the range: s^2 = h S h', h = (1, -dz/dA, -dz/dE).
    Parameters of a measurement: A and E rad, delay of the stamp after the epoch s, n_g (3), d m, and the 6 entries, row by row, of
    the lower Cholesky factor of S, m and rad.
    """

    name = "lidar-points"
    dim = 1
    value_dim = 1
    parameter_dim = 13

    def __init__(self, layout: StateLayout) -> None:
        super().__init__(layout)
        optional = (block.name for block in ACCELERATION_TERMS.values() if layout.has(block))
        self.needs = ("t", "a", "v", "w", "c", "s", *optional)

    def symbolic(self, state: dict[str, Expression], parameters: Expression) -> Expression:
        """Range at which the ray meets the face, m."""
        n, distance = self._plane(state, parameters)
        return distance / ca.dot(n, _beam(parameters))

    def noise_factor(self, state: dict[str, Expression], parameters: Expression) -> Expression:
        """Noise of the range, with the angles' errors by the incidence, m."""
        n, distance = self._plane(state, parameters)
        angles = ca.SX.sym("angles", 2)
        expected = distance / ca.dot(n, _beam(angles))
        slopes = ca.substitute(ca.jacobian(expected, angles), angles, ca.SX(parameters[:2]))
        h = ca.horzcat(1, -slopes)
        return ca.norm_2(h @ factor_of(parameters[7:], 3))

    def valid(self, state: dict[str, Expression], parameters: Expression) -> Expression:
        """Positive where the beam meets the plane from outside, before the lidar."""
        n, distance = self._plane(state, parameters)
        return ca.fmin(-ca.dot(n, _beam(parameters)) - GRAZING, -distance)

    def _plane(self, state: dict[str, Expression], parameters: Expression) -> tuple[Expression, Expression]:
        """Normal in i and signed distance from the lidar, m, at the stamp."""
        delay, n_g, offset = parameters[2], parameters[3:6], parameters[6]
        q = _attitude_after(state, delay)
        c = state["c"]
        place = state["t"] + rotate(state["q"], c) + delay * state["v"] - rotate(q, c)
        n = rotate(q, n_g)
        return n, offset + ca.dot(n, place)


def lidar_point_parameters(
    angles: Float[np.ndarray, "n 2"],
    delay: Float[np.ndarray, " n"],
    planes: Float[np.ndarray, "n 4"],
    covariance: Float[np.ndarray, "n 3 3"],
) -> Float[np.ndarray, "n 13"]:
    """Parameters of lidar points.

    Azimuth and elevation rad, delay s, unit normals n_g and offsets d m, covariances (m, rad, rad).

    Raises
    ------
    numpy.linalg.LinAlgError
        When a covariance is not positive definite.
    """
    return np.column_stack([angles, delay, planes, parameters_of(covariance)])


def _beam(angles: Expression) -> Expression:
    azimuth, elevation = angles[0], angles[1]
    level = ca.cos(elevation)
    return ca.vertcat(level * ca.cos(azimuth), ca.sin(elevation), level * ca.sin(azimuth))


def _attitude_after(state: dict[str, Expression], delay: Expression) -> Expression:
    """q_ig after ``delay`` s, which may be negative, by Runge-Kutta 4 of attitude and rate."""
    J, h = inertia(state["s"]), delay / STEPS
    constants = acceleration_constants(state)

    def rates(x: Expression) -> Expression:
        """Time derivatives of attitude and rate."""
        return ca.vertcat(quaternion_rate(x[:4], x[4:]), body_acceleration(x[4:], J, **constants))

    x = ca.vertcat(state["q"], state["w"])
    for _ in range(STEPS):
        x = runge_kutta_step(rates, x, h)
    return normalised(x[:4])


NORMAL_TOLERANCE: Final = 1e-6
"""Largest | |n| - 1 | that is taken as rounding."""
SCAN_SECONDS: Final = 0.1
"""Duration of a simulated scan."""
MOST_POINTS: Final = 200
"""Of a simulated scan."""
BOX: Final = np.array([0.65, 0.5, 0.4])
"""Half edges of the simulated body, over the radius of the surface that cameras see."""
ANGLE_STD: Final = 1e-4
"""Of a simulated scan's angles, rad."""
FARTHEST_M: Final = 100.0
"""Largest range of an outlier."""


class LidarPointsSensor(Sensor):
    """Lidar points, one a row, at the scan's epoch.

    Values (range m, azimuth and elevation rad, delay s, unit normal n_g, offset d m).
    The point was measured ``delay`` after the epoch, and lies on the plane n_g.p = d, n_g outwards. Frame i is that of the lidar.
    Covariance over (range, azimuth, elevation), m and rad: with what the planes' own errors add to the range.
    """

    name = "lidar-points"
    format = SensorFormat(
        name=name,
        kind=name,
        file="lidar_points.csv",
        columns=("range_m", "azimuth_rad", "elevation_rad", "delay_s", "nx", "ny", "nz", "offset_m"),
        dimension=3,
        noise=(
            NoiseOption(
                "lidar_range_std",
                "ranges",
                NumberRange(1e-9, 1e6, "m"),
                0.01,
                (0,),
                scene_level="position_std",
            ),
            NoiseOption(
                "lidar_angle_std", "angles", NumberRange(1e-12, 1.0, "rad"), 1e-4, (1, 2), simulated=ANGLE_STD
            ),
        ),
        repeats=True,
    )
    sees_place = True
    former_names = ("lidar",)
    analysis = AnalysedSensor(
        LidarLandmark,
        (0.01, 0.002),
        {"lidar_range_std": (0,), "lidar_angle_std": (1,)},
        sees_points=True,
        words="a lidar",
    )

    def bind(
        self, stream: MeasurementStream, layout: StateLayout, noise: SensorNoise, view: CameraView | None
    ) -> BoundStream:
        """Ranges, whose parameters are the rays, delays and faces."""
        _require_normals(stream)
        std = np.array([noise.lidar_range_std, noise.lidar_angle_std, noise.lidar_angle_std])
        z = stream.values
        parameters = lidar_point_parameters(z[:, 1:3], z[:, 3], z[:, 4:], row_covariance(stream, std))
        return BoundStream(model_over(LidarPoint, layout), stream.time, z[:, :1], parameters)

    def initial_motion(
        self, stream: MeasurementStream, noise: SensorNoise, view: CameraView | None
    ) -> MotionSamples:
        """A pose per scan, the motion during it left out."""
        # here: every command lists the sensors, and the lidar's room is slow to import
        from spinfilters.core.ray_angles import unit_vectors

        _require_normals(stream)
        z = stream.values
        points = z[:, :1] * unit_vectors(z[:, 1], z[:, 2])
        scans = [PlanePoints(points[a:b], z[a:b, 4:7], z[a:b, 7]) for a, b in pairwise(stream.epoch_offsets)]
        found = [
            (t, pose)
            for t, pose in zip(stream.epoch_times, plane_poses(scans), strict=True)
            if pose is not None
        ]
        q = quaternion_from_matrix(np.array([pose.rotation for _, pose in found]))
        return MotionSamples(
            np.array([t for t, _ in found]),
            continuous_quaternions(q),
            positions=np.array([pose.translation for _, pose in found]),
        )

    def simulate(self, scene: Scene) -> SimulatedStream:
        """Points on the faces of a box within the surface, `MOST_POINTS` in the scan of every epoch."""
        from spinfilters.core.ray_angles import angles_of

        model, layout = LidarPoint(scene.motion.layout), scene.motion.layout
        half = BOX * float(np.linalg.norm(scene.surface.points, axis=1).max())
        std = np.array([scene.noise.level("lidar_range_std"), *[scene.noise.level("lidar_angle_std")] * 2])
        covariance = np.tile(np.diag(std**2), (MOST_POINTS, 1, 1))
        delay = np.linspace(-SCAN_SECONDS / 2, SCAN_SECONDS / 2, MOST_POINTS)
        times, rows = [], []
        for time, x, R in zip(scene.motion.time, scene.motion.states, scene.motion.rotations, strict=True):
            t, rate = x[layout.mean_slice("t")], R @ x[layout.mean_slice("w")]
            points, planes = _box_points(half, -R.T @ t, scene.generator)
            arm = points @ R.T
            angles = np.stack(angles_of(t + arm + delay[:, None] * np.cross(rate, arm)), axis=1)
            parameters = lidar_point_parameters(angles, delay, planes, covariance)
            exact = model.predict(x, parameters)
            met = model.linearise(x, parameters, exact).valid
            measured = np.column_stack([exact, angles])
            measured = measured + std * scene.generator.standard_normal(measured.shape)
            rows.append(np.column_stack([measured, delay, planes])[met])
            times.append(np.full(int(met.sum()), time))
        stream = MeasurementStream(self.name, np.concatenate(times), np.concatenate(rows))
        return SimulatedStream(stream, {"lidar_range_std": float(std[0]), "lidar_angle_std": float(std[1])})

    def outliers(
        self, count: int, rig: Rig | None, generator: np.random.Generator
    ) -> Float[np.ndarray, "count 8"]:
        """Ranges of random planes up to `FARTHEST_M`.

        Beams point to the front of the lidar; planes lie within a metre of the origin of g.
        """
        normals = generator.standard_normal((count, 3))
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        ranges, angles = generator.uniform(0, FARTHEST_M, count), generator.uniform(-0.5, 0.5, (count, 2))
        return np.column_stack([ranges, angles, np.zeros(count), normals, generator.uniform(0, 1, count)])


def _box_points(
    half: Float[np.ndarray, "3"], lidar: Float[np.ndarray, "3"], generator: np.random.Generator
) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 4"]]:
    """Visible points on the faces of a box, and their planes.

    Half edges, m, about the origin of g; seen from the lidar's place in g.

    Raises
    ------
    InputError
        A lidar within the box.
    """
    seen = np.flatnonzero(np.abs(lidar) > half)
    if not seen.size:
        raise InputError("the lidar is within the body; move it away (range_m)")
    area = np.prod(half) / half[seen] * (np.abs(lidar[seen]) - half[seen])  # as it appears from there
    axis = generator.choice(seen, MOST_POINTS, p=area / area.sum())
    every, side = np.arange(MOST_POINTS), np.sign(lidar[axis])
    points, planes = generator.uniform(-half, half, (MOST_POINTS, 3)), np.zeros((MOST_POINTS, 4))
    points[every, axis], planes[every, axis], planes[:, 3] = side * half[axis], side, half[axis]
    return points, planes


def _require_normals(stream: MeasurementStream) -> None:
    """InputError: a normal that is no unit vector, a range that is not positive."""
    off = np.abs(np.linalg.norm(stream.values[:, 4:7], axis=1) - 1.0) > NORMAL_TOLERANCE
    bad = np.flatnonzero(off | (stream.values[:, 0] <= 0))
    if bad.size:
        row = stream.values[bad[0]]
        raise InputError(
            f"{stream.sensor} row {bad[0]}: range {row[0]:g} m and normal {row[4:7].tolist()} of its plane; give a positive range "
            "and a unit normal"
        )


LIDAR_POINTS = LidarPointsSensor()


FEWEST: Final = 12
"""Points of a scan that a pose is found from, at least: twice its unknowns."""
SETTLED: Final = 1e-9
"""Step, rad and radii of the body, below which a pose is found."""
_MOST_STEPS, _SPREAD, _SEARCHED = 30, 60, 200
_GOOD = 2.0  # ratio to the best residual found so far above which a pose is searched again
_RIDGE = 1e-9
DETERMINED: Final = 1e-5
"""Smallest over largest information of an attitude, or of a place, below which planes leave a direction open."""


@dataclass(frozen=True, eq=False)
class PlanePoints:
    """Points of one scan in frame L, m, with the planes n.p = d of frame g that they lie on."""

    points: Float[np.ndarray, "n 3"]
    normals: Float[np.ndarray, "n 3"]
    offsets: Float[np.ndarray, " n"]

    def thinned(self, most: int) -> "PlanePoints":
        """At most so many of the points, evenly spaced."""
        rows = evenly_spaced(len(self.points), most)
        return PlanePoints(self.points[rows], self.normals[rows], self.offsets[rows])


@dataclass(frozen=True, eq=False)
class PlanePose:
    """Pose of a scan, R_Lg and the origin of g in L (m), with the root-mean-square point-to-plane distance (m)."""

    rotation: Float[np.ndarray, "3 3"]
    translation: Float[np.ndarray, "3"]
    residual_std: float


_Placement = tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, "3"]]


def plane_poses(scans: Sequence[PlanePoints]) -> list[PlanePose | None]:
    """A pose of every scan, None for one with too few points.

    The search starts at the pose of the scan before, or at many attitudes.

    Raises
    ------
    InputError
        No scan determines its pose.
    """
    poses: list[PlanePose | None] = []
    last: PlanePose | None = None
    good = 0.0
    for scan in scans:
        found = None
        if len(scan.points) >= FEWEST:
            found = None if last is None else _refine_pose(scan, last.rotation, last.translation)
            if found is None or found.residual_std > good:
                found = _search_attitudes(scan, good, None if last is None else last.translation)
        poses.append(found)
        if found is not None:
            last = found
            good = min(good or np.inf, _GOOD * found.residual_std)
    if last is None:
        raise InputError(
            f"no scan of {len(scans)} determines a pose; give scans with {FEWEST} points on two planes or more"
        )
    return poses


def _search_attitudes(
    scan: PlanePoints, good: float, place: Float[np.ndarray, "3"] | None
) -> PlanePose | None:
    """The best of many attitudes in which the planes face the lidar, or the first with residuals below ``good`` m.

    Parameters
    ----------
    place : Float[np.ndarray, '3'] | None
        Of the origin of g before, m: kept where two planes leave it open along their edge.
    """
    few, middle = scan.thinned(_SEARCHED), scan.points.mean(axis=0)
    centre = (few.normals * few.offsets[:, None]).mean(axis=0)
    best: PlanePose | None = None
    drawn = np.random.default_rng(0).standard_normal(
        (_SPREAD, 4)
    )  # of all directions alike: uniform attitudes
    for R in matrix_from_quaternion(drawn / np.linalg.norm(drawn, axis=1, keepdims=True)):
        found = _refine_pose(few, R, middle - R @ centre if place is None else place)
        if found is not None and (best is None or found.residual_std < best.residual_std):
            best = found
            if best.residual_std < good:
                break
    return None if best is None else _refine_pose(scan, best.rotation, best.translation)


def _refine_pose(
    scan: PlanePoints, R: Float[np.ndarray, "3 3"], t: Float[np.ndarray, "3"]
) -> PlanePose | None:
    """Gauss-Newton of point-to-plane distances.

    None where planes would face away from the lidar, leave the attitude undetermined, or it does not settle.
    """
    size = float(np.abs(scan.offsets).max()) or 1.0

    def linearise(placement: _Placement) -> StepEquations:
        R, t = placement
        n, residual = _residuals(scan, R, t)
        return step_equations(-residual, np.concatenate([np.cross(n, scan.points - t), -size * n], axis=1))

    def retract(placement: _Placement, step: Float[np.ndarray, " 6"]) -> _Placement:
        R, t = placement  # a step is half a radian and half a radius of the body at most
        step = step * min(1.0, 0.5 / max(float(np.abs(step).max()), 1e-300))
        return matrix_from_rotation_vector(step[:3]) @ R, t + size * step[3:]

    found = gauss_newton(
        (R, t),
        linearise,
        retract,
        lambda step, _: bool(np.abs(step).max() < SETTLED),
        _MOST_STEPS,
        lambda H: _RIDGE * np.trace(H),
    )
    if found.normal is None or found.end is not LeastSquaresEnd.SETTLED:
        return None
    (R, t), H = found.state, found.normal.information
    n, residual = _residuals(scan, R, t)
    values = np.linalg.eigvalsh(H[:3, :3] - H[:3, 3:] @ np.linalg.pinv(H[3:, 3:], DETERMINED) @ H[3:, :3])
    if not np.isfinite(residual).all() or values[0] < DETERMINED * values[-1]:
        return None
    if np.mean(np.einsum("ni,ni->n", n, scan.points) < 0) < 0.9:
        return None
    return PlanePose(R, t, float(np.sqrt(np.mean(residual**2))))


def _residuals(
    scan: PlanePoints, R: Float[np.ndarray, "3 3"], t: Float[np.ndarray, "3"]
) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, " n"]]:
    """Normals in L and distances n.(p - t) - d, m."""
    n = scan.normals @ R.T
    return n, np.einsum("ni,ni->n", n, scan.points - t) - scan.offsets
