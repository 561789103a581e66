"""Lenses: distortion of the normalised coordinates (x/z, y/z)."""

from abc import ABC, abstractmethod
from dataclasses import dataclass

import casadi as ca

from spinfilters.attitude.expressions import Expression

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
        """Positive where the map is one to one.

        Beyond, a point outside the image would be seen inside.
        """


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

        1 + 3 k1 r^2 + 5 k2 r^4 where it is least, at its vertex if that is passed.
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
