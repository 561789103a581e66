"""Poses from points on planes known in frame g.

One per scan, motion during the scan left out.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float

from spinfilters.core.attitude_conversions import matrix_from_quaternion, matrix_from_rotation_vector
from spinfilters.core.errors import InputError
from spinfilters.core.gauss_newton import LeastSquaresEnd, StepEquations, gauss_newton, step_equations

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
        rows = np.linspace(0, len(self.points) - 1, min(most, len(self.points))).astype(int)
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
