"""Model of a sensor of landmarks held in the state.

Also differentiated by, and solved for, the landmark.
"""

from abc import abstractmethod
from functools import reduce
from operator import mul
from typing import NamedTuple

import casadi as ca
import numpy as np
from jaxtyping import Bool, Float

from spinfilters.attitude.expressions import Expression
from spinfilters.models.measurement import MeasurementModel, row_by_row
from spinfilters.symbolic.compiled import Compiled
from spinfilters.symbolic.vectorised import Vectorised
from spinfilters.symbolic.working_time import built_property


class LandmarkLinearisation(NamedTuple):
    """A sensor linearised about a state and landmarks, whitened.

    One landmark per value, k values at once, by the noise factor.

    Attributes
    ----------
    innovation: (k, dim).   jacobian: (k, dim, c) by the model's `columns` of the state's error.
    by_landmark: (k, dim, 3) by the landmark, frame g.   valid: (k,).   log_noise: (k,), as in `Linearisation`.
    """

    innovation: Float[np.ndarray, "k r"]
    jacobian: Float[np.ndarray, "k r c"]
    by_landmark: Float[np.ndarray, "k r 3"]
    valid: Bool[np.ndarray, " k"]
    log_noise: Float[np.ndarray, " k"]


class NewLandmarks(NamedTuple):
    """Landmarks initialised from one measurement each.

    Attributes
    ----------
    points: (k, 3) m, frame g.   jacobian: (k, 3, c) by the model's `columns` of the state's error.
    root: (k, 3, 3) lower triangular factor of the covariance that the sensor's noise alone gives the point, m.
    determined: (k,) whether the measurement tells all three coordinates (the depth of a far point is not told).
    """

    points: Float[np.ndarray, "k 3"]
    jacobian: Float[np.ndarray, "k 3 c"]
    root: Float[np.ndarray, "k 3 3"]
    determined: Bool[np.ndarray, " k"]


class LandmarkSensor(MeasurementModel):
    """A sensor whose parameters begin with the landmark's point in frame g (3, m)."""

    known_by = 3

    @property
    def landmark_sensor(self) -> "LandmarkSensor":
        """The sensor itself."""
        return self

    @abstractmethod
    def landmark(
        self, state: dict[str, Expression], measured: Expression, parameters: Expression
    ) -> Expression:
        """The point (3, frame g) that explains a measurement exactly.

        From this state; its parameters are not read.
        """

    @abstractmethod
    def determined(self, measured: Expression, parameters: Expression) -> Expression:
        """Positive where `landmark` is far better known than nothing (the disparity stands out of its noise)."""

    def linearise_landmarks(
        self,
        x: Float[np.ndarray, " m"],
        parameters: Float[np.ndarray, "k p"],
        measured: Float[np.ndarray, "k v"],
    ) -> LandmarkLinearisation:
        """Innovations and their derivatives at a state and at the landmarks that lead the parameters."""
        innovation, jacobian, by_landmark, valid, determinant = self._linearise_landmarks(
            x, parameters, measured
        )
        return LandmarkLinearisation(
            innovation,
            jacobian.reshape(*innovation.shape, len(self.columns)),
            by_landmark.reshape(*innovation.shape, 3),
            valid[..., 0] > 0,
            np.log(determinant[..., 0]),
        )

    def new_landmarks(
        self,
        x: Float[np.ndarray, "*points m"],
        parameters: Float[np.ndarray, "k p"],
        measured: Float[np.ndarray, "k v"],
    ) -> NewLandmarks:
        """Landmarks from one measurement each, at a common point (m,) or one each (k, m).

        Their dependence on the state's error and on the sensor's noise comes with them.
        """
        points, jacobian, root, determined = self._new_landmarks(x, parameters, measured)
        count = len(measured)
        return NewLandmarks(
            points,
            jacobian.reshape(count, 3, len(self.columns)),
            root.reshape(count, 3, 3),
            determined[..., 0] > 0,
        )

    def build(self) -> None:
        """Build the function of `new_landmarks` in advance."""
        self._new_landmarks.build()

    @built_property
    def observation_rows(self) -> Vectorised:
        """`linearise_landmarks` for many states, landmarks and observations side by side.

        Inputs: a point of the layout, a landmark (3, m, frame g), the rest of the parameters, the measured value. Outputs: per
        component of the innovation a row (by the model's `columns`, by the landmark, the whitened innovation itself), row after
        row; what is positive where the model applies; the squared length of the whitened innovation; and the determinant of the
        noise factor, not its logarithm: a compiler makes no vector instructions of a loop that calls one.
        """
        x, p, z = self._symbols
        whitening, here, jacobian, by_landmark = self._derivatives(x, p, z)
        away = whitening @ here
        rows = ca.horzcat(whitening @ jacobian, whitening @ by_landmark, away)
        valid = self.valid(self.layout.unpack(x), p)
        outputs = [row_by_row(rows), valid, ca.dot(away, away), self._noise_determinant(x, p)]
        return Vectorised(ca.Function(f"{self.name}_observation_rows", [x, p[:3], p[3:], z], outputs))

    @built_property
    def observation_innovations(self) -> Vectorised:
        """Whitened innovations, validity and determinant of the noise factor.

        Validity is positive where the model applies.
        Inputs: those of `observation_rows`.
        """
        x, p, z = self._symbols
        state = self.layout.unpack(x)
        whitening, _ = self._whitening_expression(x, p)
        away = whitening @ self.innovation(self.symbolic(state, p), z)
        outputs = [away, self.valid(state, p), self._noise_determinant(x, p)]
        return Vectorised(ca.Function(f"{self.name}_observation_innovations", [x, p[:3], p[3:], z], outputs))

    def _noise_determinant(self, x: ca.SX, p: ca.SX) -> ca.SX:
        factor = ca.SX(self.noise_factor(self.layout.unpack(x), p))
        return reduce(mul, ca.vertsplit(ca.diag(factor)))

    @built_property
    def _linearise_landmarks(self) -> Compiled:
        x, p, z = self._symbols
        whitening, here, jacobian, by_landmark = self._derivatives(x, p, z)
        outputs = [
            whitening @ here,
            row_by_row(whitening @ jacobian),
            row_by_row(whitening @ by_landmark),
            self.valid(self.layout.unpack(x), p),
            self._noise_determinant(x, p),
        ]
        return self._function("linearise_landmarks", [x, p, z], outputs)

    def _derivatives(self, x: ca.SX, p: ca.SX, z: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX, ca.SX]:
        """Whitening, innovation and its derivatives by the model's columns and the landmark.

        The signs are those of the expectation's derivatives.
        """
        at, d = self._moved(x)
        expected = self.innovation(self.symbolic(at, p), z)
        here = self.innovation(self.symbolic(self.layout.unpack(x), p), z)
        jacobian = ca.substitute(-ca.jacobian(expected, d)[:, self.columns], d, ca.SX.zeros(*d.shape))
        return self._whitening_expression(x, p)[0], here, jacobian, -ca.jacobian(here, p)[:, :3]

    @built_property
    def _new_landmarks(self) -> Compiled:
        x, p, z = self._symbols
        at, d = self._moved(x)
        state = self.layout.unpack(x)
        point = self.landmark(state, z, p)
        moved = self.landmark(at, z, p)
        jacobian = ca.substitute(ca.jacobian(moved, d)[:, self.columns], d, ca.SX.zeros(*d.shape))
        spread = ca.jacobian(point, z) @ ca.SX(self.noise_factor(state, p))
        root = ca.qr(spread.T)[1].T
        valid = ca.fmin(self.determined(z, p), self.valid(state, ca.vertcat(point, p[3:])))
        outputs = [point, row_by_row(jacobian), row_by_row(root), valid]
        return self._function("new_landmarks", [x, p, z], outputs)

    def _moved(self, x: ca.SX) -> tuple[dict[str, Expression], ca.SX]:
        d = ca.SX.sym("d", self.layout.error_dim)
        return self.layout.unpack(self.layout.retract_expression(x, d)), d
