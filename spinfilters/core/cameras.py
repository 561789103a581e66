"""Projections of one camera and of a rectified stereo pair, with the distortion of their lenses, and the rays of pixels."""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any, NoReturn

import casadi as ca
import numpy as np
from jaxtyping import Float

from spinfilters.core.attitude_expressions import Expression
from spinfilters.core.compiled import Compiled
from spinfilters.core.errors import ShapeError
from spinfilters.core.working_time import building

ITERATIONS = 8
"""Newton steps that undo a distortion: five give full precision at 60 degrees off the axis of a usual wide lens."""


class Lens(ABC):
    """A map of normalised coordinates, written with ``parameter_dim`` coefficients."""

    parameter_dim: int

    @abstractmethod
    def distort(self, xy: Expression, coefficients: Expression) -> Expression:
        """Distorted normalised coordinates (2,)."""

    @abstractmethod
    def undistort(self, xy: Expression, coefficients: Expression) -> Expression:
        """The inverse of `distort`, where there is one."""

    @abstractmethod
    def undistort_x(self, x: Expression, y: Expression, coefficients: Expression) -> Expression:
        """Undistorted x of a point of which the distorted x and the undistorted y are known."""

    @abstractmethod
    def valid(self, xy: Expression, coefficients: Expression) -> Expression:
        """Positive where the map is one to one; beyond, a point outside the image would be projected into it."""


@dataclass(frozen=True)
class PerfectLens(Lens):
    """No distortion."""

    parameter_dim = 0

    def distort(self, xy: Expression, coefficients: Expression) -> Expression:
        """The same (x, y)."""
        return xy

    def undistort(self, xy: Expression, coefficients: Expression) -> Expression:
        """The same (x, y)."""
        return xy

    def undistort_x(self, x: Expression, y: Expression, coefficients: Expression) -> Expression:
        """The same x."""
        return x

    def valid(self, xy: Expression, coefficients: Expression) -> Expression:
        """Everywhere."""
        return ca.DM(1)


@dataclass(frozen=True)
class RadialTangentialLens(Lens):
    """Radial-tangential lens of EuRoC and OpenCV (Brown 1971).

    Coefficients (k1, k2, p1, p2), with r^2 = x^2 + y^2:
    x' = x (1 + k1 r^2 + k2 r^4) + 2 p1 x y + p2 (r^2 + 2 x^2), y' = y (1 + k1 r^2 + k2 r^4) + p1 (r^2 + 2 y^2) + 2 p2 x y.
    """

    parameter_dim = 4

    def distort(self, xy: Expression, coefficients: Expression) -> Expression:
        """(x', y') of (x, y)."""
        k1, k2, p1, p2 = (coefficients[k] for k in range(4))
        x, y = xy[0], xy[1]
        square = x * x + y * y
        radial = 1 + square * (k1 + square * k2)
        return ca.vertcat(
            x * radial + 2 * p1 * x * y + p2 * (square + 2 * x * x),
            y * radial + p1 * (square + 2 * y * y) + 2 * p2 * x * y,
        )

    def undistort(self, xy: Expression, coefficients: Expression) -> Expression:
        """(x, y) of (x', y'), by Newton's method."""
        guess = xy
        for _ in range(ITERATIONS):
            guess = guess - ca.solve(
                self._jacobian(guess, coefficients), self.distort(guess, coefficients) - xy
            )
        return guess

    def undistort_x(self, x: Expression, y: Expression, coefficients: Expression) -> Expression:
        """x of x' and y, by Newton's method."""
        guess = x
        for _ in range(ITERATIONS):
            at = ca.vertcat(guess, y)
            slope = self._jacobian(at, coefficients)[0, 0]
            guess = guess - (self.distort(at, coefficients)[0] - x) / slope
        return guess

    def valid(self, xy: Expression, coefficients: Expression) -> Expression:
        """Positive where the radial part still grows with the radius.

        The slope 1 + 3 k1 r^2 + 5 k2 r^4 must be positive at every radius up to the point's, so it is taken where it is
        least: at the point, or at the vertex of the parabola where that lies within.
        """
        k1, k2, square = coefficients[0], coefficients[1], ca.dot(xy, xy)
        has_vertex = ca.logic_and(k1 < 0, k2 > 0)
        least = ca.fmin(square, ca.if_else(has_vertex, -0.3 * k1 / k2, square))
        return 1 + least * (3 * k1 + 5 * k2 * least)

    def _jacobian(self, xy: Expression, coefficients: Expression) -> Expression:
        """Jacobian of `distort` by the coordinates, differentiated from it."""
        at, k = ca.SX.sym("xy", 2), ca.SX.sym("k", 4)
        (jacobian,) = ca.substitute(
            [ca.jacobian(self.distort(at, k), at)], [at, k], [ca.SX(xy), ca.SX(coefficients)]
        )
        return jacobian


PERFECT = PerfectLens()
RADIAL_TANGENTIAL = RadialTangentialLens()


NEAREST_DEPTH = 1e-3
"""Depth in m below which a point counts as at or behind the camera; closer ones are projected as if they were there."""
Formula = Callable[[Any, Expression, Expression], Expression]
"""Of a camera, what is given (a point or pixels) and the calibration."""


@dataclass(frozen=True)
class Camera(ABC):
    """A pinhole camera with a lens, or a stereo pair.

    A subclass writes the projection and its inverse as expressions; the functions on arrays are derived here.

    Attributes
    ----------
    lens : Lens
        Before the (left) pinhole.
    pixel_dim : int
        Numbers of an observation.
    parameter_dim : int
        Numbers of the calibration.
    """

    lens: Lens = PERFECT

    @property
    @abstractmethod
    def pixel_dim(self) -> int:
        """Numbers of an observation."""
        ...

    @property
    @abstractmethod
    def parameter_dim(self) -> int:
        """Numbers of the calibration."""
        ...

    @abstractmethod
    def project(self, point: Expression, calibration: Expression) -> Expression:
        """Pixels of a point (3,), m, camera frame."""

    @abstractmethod
    def ray(self, pixels: Expression, calibration: Expression) -> Expression:
        """Direction (x/z, y/z, 1) that the (left) pixel is seen in."""

    @abstractmethod
    def _lens_coefficients(self, calibration: Expression) -> Expression:
        """Coefficients of the (left) lens."""

    def fits(self, calibration: Float[np.ndarray, " c"]) -> bool:
        """Whether a calibration has as many numbers as this camera takes."""
        return calibration.shape == (self.parameter_dim,)

    def in_view(self, point: Expression, calibration: Expression) -> Expression:
        """Positive where `project` is meaningful: in front of the camera, and where the lens is one to one."""
        before = point[2] - NEAREST_DEPTH
        if self.lens == PERFECT:
            return before
        xy = point[:2] / ca.fmax(point[2], NEAREST_DEPTH)
        return ca.fmin(before, self.lens.valid(xy, self._lens_coefficients(calibration)))

    def pixels_of(
        self, points: Float[np.ndarray, "*batch 3"], calibration: Float[np.ndarray, " c"]
    ) -> Float[np.ndarray, "*batch v"]:
        """`project` of many points."""
        return _numeric(self, type(self).project, 3)(points, calibration)[0]

    def rays_of(
        self, pixels: Float[np.ndarray, "*batch v"], calibration: Float[np.ndarray, " c"]
    ) -> Float[np.ndarray, "*batch 3"]:
        """`ray` of many pixels."""
        return _numeric(self, type(self).ray, self.pixel_dim)(pixels, calibration)[0]

    def pixels_by_point(
        self, points: Float[np.ndarray, "*batch 3"], calibration: Float[np.ndarray, " c"]
    ) -> Float[np.ndarray, "*batch v 3"]:
        """Derivatives of `project` by the points, px/m."""
        return _numeric(self, type(self).derivative, 3)(points, calibration)[0]

    def derivative(self, point: Expression, calibration: Expression) -> Expression:
        """Derivative of `project` by the point."""
        return ca.jacobian(self.project(point, calibration), point)


@dataclass(frozen=True)
class Monocular(Camera):
    """Pixels (u, v) of a pinhole camera with distortion.

    u = fx x' + cx, v = fy y' + cy of the distorted (x', y') (Tweddle 2013, Eqs 2.87-2.88 corrected).
    Calibration: (fx, fy, cx, cy px, coefficients of the lens).
    """

    @property
    def pixel_dim(self) -> int:
        """(u, v)."""
        return 2

    @property
    def parameter_dim(self) -> int:
        """(fx, fy, cx, cy) and the lens."""
        return 4 + self.lens.parameter_dim

    def project(self, point: Expression, calibration: Expression) -> Expression:
        """(u, v) px of a point, m."""
        xy = point[:2] / ca.fmax(point[2], NEAREST_DEPTH)
        return _to_pixels(self.lens.distort(xy, self._lens_coefficients(calibration)), calibration)

    def ray(self, pixels: Expression, calibration: Expression) -> Expression:
        """(x/z, y/z, 1) of (u, v)."""
        xy = _from_pixels(pixels, calibration)
        return ca.vertcat(self.lens.undistort(xy, self._lens_coefficients(calibration)), 1)

    def _lens_coefficients(self, calibration: Expression) -> Expression:
        return calibration[4:]


@dataclass(frozen=True)
class StereoPair(Camera):
    """Pixels (u_left, v_left, u_right) of two parallel cameras of common intrinsics.

    The right camera is moved by the baseline along x. Without distortion u_right = u_left - fx baseline / z (Tweddle 2013,
    Eqs 4.83-4.84). Calibration: (fx, fy, cx, cy px, baseline m, coefficients of the left lens, of the right lens).
    """

    @property
    def pixel_dim(self) -> int:
        """(u_left, v, u_right)."""
        return 3

    @property
    def parameter_dim(self) -> int:
        """(fx, fy, cx, cy, baseline) and the lens."""
        return 5 + 2 * self.lens.parameter_dim

    def project(self, point: Expression, calibration: Expression) -> Expression:
        """(u_left, v, u_right) px of a point, m."""
        depth = ca.fmax(point[2], NEAREST_DEPTH)
        xy, shift = point[:2] / depth, calibration[4] / depth
        left = _to_pixels(self.lens.distort(xy, self._lens_coefficients(calibration)), calibration)
        if self.lens == PERFECT:
            return ca.vertcat(left, left[0] - calibration[0] * shift)
        right = self.lens.distort(ca.vertcat(xy[0] - shift, xy[1]), self._right_coefficients(calibration))
        return ca.vertcat(left, _to_pixels(right, calibration)[0])

    def ray(self, pixels: Expression, calibration: Expression) -> Expression:
        """(x/z, y/z, 1) of the left pixel."""
        xy = _from_pixels(pixels[:2], calibration)
        return ca.vertcat(self.lens.undistort(xy, self._lens_coefficients(calibration)), 1)

    def disparity(self, pixels: Expression, calibration: Expression) -> Expression:
        """fx baseline / z, px, once the lenses are undone."""
        if self.lens == PERFECT:
            return pixels[0] - pixels[2]
        left = self.ray(pixels, calibration)
        seen = (pixels[2] - calibration[2]) / calibration[0]
        right = self.lens.undistort_x(seen, left[1], self._right_coefficients(calibration))
        return calibration[0] * (left[0] - right)

    def backproject(
        self, pixels: Expression, calibration: Expression, smallest_disparity: float | None = None
    ) -> Expression:
        """Point (3,), m, in the camera frame of the stereo pixels.

        A disparity of zero or less gives no point in front of the pair, unless it is replaced by ``smallest_disparity`` (px).
        """
        disparity = self.disparity(pixels, calibration)
        if smallest_disparity is not None:
            disparity = ca.fmax(disparity, smallest_disparity)
        return self.ray(pixels, calibration) * (calibration[0] * calibration[4] / disparity)

    def points_of(
        self, pixels: Float[np.ndarray, "*batch 3"], calibration: Float[np.ndarray, " c"]
    ) -> Float[np.ndarray, "*batch 3"]:
        """`backproject` of many pixels."""
        return _numeric(self, type(self).backproject, 3)(pixels, calibration)[0]

    def _lens_coefficients(self, calibration: Expression) -> Expression:
        return calibration[5 : 5 + self.lens.parameter_dim]

    def _right_coefficients(self, calibration: Expression) -> Expression:
        return calibration[5 + self.lens.parameter_dim :]


def monocular_camera(calibration: Float[np.ndarray, " c"]) -> Monocular:
    """The monocular camera of a calibration; one of 4 numbers has no distortion.

    Raises
    ------
    ShapeError
        A calibration whose length fits no such camera.
    """
    found = [each for each in (Monocular(), Monocular(RADIAL_TANGENTIAL)) if each.fits(calibration)]
    return found[0] if found else _refuse(calibration)


def stereo_pair(calibration: Float[np.ndarray, " c"]) -> StereoPair:
    """The stereo pair of a calibration; one of 5 numbers has no distortion.

    Raises
    ------
    ShapeError
        A calibration whose length fits no such pair.
    """
    found = [each for each in (StereoPair(), StereoPair(RADIAL_TANGENTIAL)) if each.fits(calibration)]
    return found[0] if found else _refuse(calibration)


def _refuse(calibration: Float[np.ndarray, " c"]) -> NoReturn:
    raise ShapeError(f"a calibration of shape {calibration.shape} is of no such camera; give that of its rig")


def _to_pixels(xy: Expression, calibration: Expression) -> Expression:
    return calibration[:2] * xy + calibration[2:4]


def _from_pixels(pixels: Expression, calibration: Expression) -> Expression:
    return (pixels - calibration[2:4]) / calibration[:2]


@cache
@building()
def _numeric(camera: Camera, expression: Formula, size: int) -> Compiled:
    """One of a camera's expressions on arrays; its first argument has so many numbers."""
    given, calibration = ca.SX.sym("given", size), ca.SX.sym("calibration", camera.parameter_dim)
    name = f"{type(camera).__name__}_{camera.lens.parameter_dim}_{expression.__name__}".lower()
    return Compiled(ca.Function(name, [given, calibration], [expression(camera, given, calibration)]))
