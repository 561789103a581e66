"""Measurement model: expected value, noise and validity as expressions, linearised for many values at once.

A model of landmarks is also differentiated by, and solved for, the landmark.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable
from functools import cache, cached_property, lru_cache, reduce
from operator import mul
from typing import Final, NamedTuple

import casadi as ca
import numpy as np
from jaxtyping import Bool, Float, Int

from spinfilters.core.attitude_expressions import Expression
from spinfilters.core.compiled import Compiled
from spinfilters.core.vectorised import Vectorised
from spinfilters.core.working_time import building, built_property
from spinfilters.models.state_layout import StateLayout, error_derivative

ByError = Callable[[Expression, Expression, Expression], tuple[Expression, Expression]]
"""Gives a measured value and the parameters of its measurement, were the calibration larger by an error."""


class Linearisation(NamedTuple):
    """Sensor linearised about a state, k values at once.

    Attributes
    ----------
    innovation : Float[np.ndarray, 'k r']
        (k, dim) whitened by the noise factor.
    jacobian : Float[np.ndarray, 'k r c']
        (k, dim, c) whitened, with respect to the model's `columns` of the error.
    valid : Bool[np.ndarray, ' k']
        (k,) whether the model applies.
    log_noise : Float[np.ndarray, ' k']
        (k,) log determinant of the noise factor, for likelihoods.
    """

    innovation: Float[np.ndarray, "k r"]
    jacobian: Float[np.ndarray, "k r c"]
    valid: Bool[np.ndarray, " k"]
    log_noise: Float[np.ndarray, " k"]


class InnovationsAtPoints(NamedTuple):
    """k innovations at p points, whitened by the noise at one of them.

    Attributes
    ----------
    innovation : Float[np.ndarray, 'k r p']
        (k, dim, p).
    valid : Bool[np.ndarray, ' k']
        (k,) where all points are.
    log_noise : Float[np.ndarray, ' k']
        (k,) log determinant of the noise factor.
    """

    innovation: Float[np.ndarray, "k r p"]
    valid: Bool[np.ndarray, " k"]
    log_noise: Float[np.ndarray, " k"]


class MeasurementModel(ABC):
    """A sensor over a state layout. A subclass writes expressions only; everything numeric is derived here.

    Attributes
    ----------
    name : str
        The sensor's name, as in a `MeasurementStream`.
    dim : int
        Dimension of the innovation.
    value_dim : int
        Dimension of a measured value (a pose has 7 numbers and an innovation of 6).
    parameter_dim : int
        Dimension of what accompanies each measurement: landmark, calibration, noise.
    needs : tuple[str, ...]
        State blocks that the measurement depends on.
    known_by : int | None
        Leading parameters that identify what is measured, by which it is recognised; None for all of them.
    images : int
        Of which a value holds pixels: one of a camera, two of a pair.
    reads_rate : bool
        Whether it reads the body rate, axes g.
    known_pose : slice | None
        Place of the sensor's own known pose (t_i m, q_i) among the parameters; None of one that defines frame i.
    """

    name: str
    dim: int
    value_dim: int
    parameter_dim: int
    needs: tuple[str, ...]
    known_by: int | None = None
    images: int = 0
    reads_rate: bool = False
    known_pose: slice | None = None

    def __init__(self, layout: StateLayout) -> None:
        self.layout = layout

    @abstractmethod
    def symbolic(self, state: dict[str, Expression], parameters: Expression) -> Expression:
        """Expected value of the measurement (value_dim,) from the state's blocks (attitude as ``q``).

        Parameters
        ----------
        state : dict[str, Expression]
            Blocks of the state, as `StateLayout.unpack` names them.
        parameters : Expression
            What accompanies the measurement, (parameter_dim,).

        Returns
        -------
        Expression
            Expected value, (value_dim,).
        """

    @abstractmethod
    def noise_factor(self, state: dict[str, Expression], parameters: Expression) -> Expression:
        """Lower factor of the noise covariance, (dim, dim).

        Parameters
        ----------
        state : dict[str, Expression]
            Blocks of the state, as `StateLayout.unpack` names them.
        parameters : Expression
            What accompanies the measurement, (parameter_dim,).

        Returns
        -------
        Expression
            Factor L with the noise covariance L L'.
        """

    def innovation(self, expected: Expression, measured: Expression) -> Expression:
        """measured [-] expected, (dim,).

        Parameters
        ----------
        expected : Expression
            Value that the model predicts, (value_dim,).
        measured : Expression
            Value that was measured, (value_dim,).

        Returns
        -------
        Expression
            Difference in the sensor's own sense, (dim,).
        """
        return measured - expected

    def valid(self, state: dict[str, Expression], parameters: Expression) -> Expression:
        """Positive where the model applies (a point in front of the camera).

        Parameters
        ----------
        state : dict[str, Expression]
            Blocks of the state, as `StateLayout.unpack` names them.
        parameters : Expression
            What accompanies the measurement, (parameter_dim,).

        Returns
        -------
        Expression
            Scalar; by default the model applies everywhere.
        """
        return ca.DM(1)

    @property
    def landmark_sensor(self) -> "LandmarkSensor | None":
        """The model as one that observes landmarks; None for any other model."""
        return None

    @cached_property
    def columns(self) -> list[int]:
        """Error components that the measurement depends on."""
        every = np.arange(self.layout.error_dim)
        return np.concatenate([every[self.layout.slice(block)] for block in self.needs]).tolist()

    def predict(
        self, x: Float[np.ndarray, "*batch m"], parameters: Float[np.ndarray, "*batch p"]
    ) -> Float[np.ndarray, "*batch v"]:
        """Expected values of the measurements.

        Parameters
        ----------
        x : ndarray of float, shape (..., m)
            Points of the layout.
        parameters : ndarray of float, shape (..., p)
            What accompanies each measurement.

        Returns
        -------
        ndarray of float, shape (..., v)
            A value for each.
        """
        return self._predict(x, parameters)[0]

    def predict_each(
        self,
        points: Float[np.ndarray, "f m"],
        which: Int[np.ndarray, " k"],
        parameters: Float[np.ndarray, "q p"],
        accompanying: Int[np.ndarray, " k"],
    ) -> Float[np.ndarray, "k v"]:
        """`predict` of values at some of the points with some of the parameters, none of which is copied for each.

        Parameters
        ----------
        points : ndarray of float, shape (f, m)
            Points of the layout.
        which : ndarray of int, shape (k,)
            Number of each value's point.
        parameters : ndarray of float, shape (q, p)
            What accompanies measurements.
        accompanying : ndarray of int, shape (k,)
            Number of each value's parameters.

        Returns
        -------
        ndarray of float, shape (k, v)
            A value for each.
        """
        return self._predict_each(points, parameters, rows=(which, accompanying))[0]

    def innovations(
        self,
        x: Float[np.ndarray, "*batch m"],
        parameters: Float[np.ndarray, "*batch p"],
        measured: Float[np.ndarray, "*batch v"],
    ) -> tuple[Float[np.ndarray, "*batch r"], Bool[np.ndarray, "*batch"]]:
        """Innovations at given points, and where the model is valid.

        Parameters
        ----------
        x : ndarray of float, shape (..., m)
            Points of the layout.
        parameters : ndarray of float, shape (..., p)
            What accompanies each measurement.
        measured : ndarray of float, shape (..., v)
            Measured values.

        Returns
        -------
        innovation : ndarray of float, shape (..., r)
            Not whitened.
        valid : ndarray of bool, shape (...)
            Whether the model applies.
        """
        innovation, valid = self._innovations(x, parameters, measured)
        return innovation, valid[..., 0] > 0

    def innovations_at(
        self,
        points: Float[np.ndarray, "p m"],
        x: Float[np.ndarray, " m"],
        parameters: Float[np.ndarray, "k p2"],
        measured: Float[np.ndarray, "k v"],
    ) -> InnovationsAtPoints:
        """Innovations at many points, whitened by the noise at ``x``.

        Parameters
        ----------
        points : ndarray of float, shape (p, m)
            Points of the layout, such as sigma points.
        x : ndarray of float, shape (m,)
            Point at which the noise is taken.
        parameters : ndarray of float, shape (k, p2)
            What accompanies each measurement.
        measured : ndarray of float, shape (k, v)
            Measured values.

        Returns
        -------
        InnovationsAtPoints
            Whitened innovations of every value at every point; a value is valid where it is at all points.
        """
        if len(points) * len(measured) >= FEWEST_PAIRS and self.innovations_beside.is_c:
            return self._innovations_of_pairs(points, x, parameters, measured)
        innovation, valid, log_noise = self._innovations_at(len(points))(points.T, x, parameters, measured)
        innovation = innovation.reshape(len(measured), self.dim, len(points))
        return InnovationsAtPoints(innovation, valid[:, 0] > 0, log_noise[:, 0])

    def whitening(
        self, x: Float[np.ndarray, "*batch m"], parameters: Float[np.ndarray, "*batch p"]
    ) -> Float[np.ndarray, "*batch r r"]:
        """Inverse of the noise factor.

        Parameters
        ----------
        x : ndarray of float, shape (..., m)
            Points of the layout.
        parameters : ndarray of float, shape (..., p)
            What accompanies each measurement.

        Returns
        -------
        ndarray of float, shape (..., r, r)
            L^-1 of each, with the noise covariance L L'.
        """
        rows = self._whitening(x, parameters)[0]
        return rows.reshape(*rows.shape[:-1], self.dim, self.dim)

    def linearise(
        self,
        x: Float[np.ndarray, "*points m"],
        parameters: Float[np.ndarray, "k p"],
        measured: Float[np.ndarray, "k v"],
    ) -> Linearisation:
        """Whitened innovations and their Jacobians.

        ``x`` is one point (m,) common to all values, or a point for each value (k, m).

        Parameters
        ----------
        x : ndarray of float, shape (..., m)
            Points of the layout.
        parameters : ndarray of float, shape (k, p)
            What accompanies each measurement.
        measured : ndarray of float, shape (k, v)
            Measured values.

        Returns
        -------
        Linearisation
            Innovations, Jacobians by `columns`, and where the model applies.
        """
        points = x if x.ndim == 2 else x[np.newaxis]
        return self._linearised(self.linearisation(points, parameters, measured, rows=(None, None, None)))

    def linearise_each(
        self,
        points: Float[np.ndarray, "f m"],
        which: Int[np.ndarray, " k"],
        parameters: Float[np.ndarray, "k p"],
        measured: Float[np.ndarray, "k v"],
    ) -> Linearisation:
        """`linearise` of values at some of the points, which are not copied for each.

        Parameters
        ----------
        points : ndarray of float, shape (f, m)
            Points of the layout.
        which : ndarray of int, shape (k,)
            Number of each value's point.
        parameters : ndarray of float, shape (k, p)
            What accompanies each measurement.
        measured : ndarray of float, shape (k, v)
            Measured values.

        Returns
        -------
        Linearisation
            As `linearise`.
        """
        return self._linearised(self.linearisation(points, parameters, measured, rows=(which, None, None)))

    def _linearised(self, made: tuple[np.ndarray, ...]) -> Linearisation:
        innovation, jacobian, valid, log_noise = made
        jacobian = jacobian.reshape(*innovation.shape, len(self.columns))
        return Linearisation(innovation, jacobian, valid[:, 0] > 0, log_noise[:, 0])

    def by_error(
        self, moved: ByError, size: int, x: Float[np.ndarray, "k m"], parameters: Float[np.ndarray, "k p"]
    ) -> Float[np.ndarray, "k r e"]:
        """Derivative of the innovations of expected values by an error of the calibration.

        Parameters
        ----------
        moved : ByError
            Value and parameters of a measurement, were the calibration larger by an error.
        size : int
            Number of components of the error.
        x : ndarray of float, shape (k, m)
            Point of each measurement.
        parameters : ndarray of float, shape (k, p)
            What accompanies each measurement.

        Returns
        -------
        ndarray of float, shape (k, r, e)
            Derivatives, not whitened.
        """
        rows = self._by_error(moved, size)(x, parameters)[0]
        return rows.reshape(len(x), self.dim, size)

    def with_error(
        self,
        moved: ByError,
        error: Float[np.ndarray, " e"],
        values: Float[np.ndarray, "k v"],
        parameters: Float[np.ndarray, "k p"],
    ) -> tuple[Float[np.ndarray, "k v"], Float[np.ndarray, "k p"]]:
        """Values and parameters of measurements, were the calibration larger by an error.

        Parameters
        ----------
        moved : ByError
            Value and parameters of a measurement, were the calibration larger by an error.
        error : ndarray of float, shape (e,)
            The error, in the calibration's units.
        values : ndarray of float, shape (k, v)
            Measured values.
        parameters : ndarray of float, shape (k, p)
            What accompanies each measurement.

        Returns
        -------
        values : ndarray of float, shape (k, v)
            Changed values.
        parameters : ndarray of float, shape (k, p)
            Changed parameters.
        """
        changed, accompanying = self._build_with_error(moved, len(error))(values, parameters, error)
        return changed, accompanying

    @building()
    def _build_with_error(self, moved: ByError, size: int) -> Compiled:
        _, p, z = self._symbols
        e = ca.SX.sym("e", size)
        return Compiled.interpreted(ca.Function("with_error", [z, p, e], list(moved(z, p, e))))

    @cached_property
    def _by_error(self) -> Callable[[ByError, int], Compiled]:
        return cache(self._build_by_error)

    @building()
    def _build_by_error(self, moved: ByError, size: int) -> Compiled:
        x, p, _ = self._symbols
        e, state = ca.SX.sym("e", size), self.layout.unpack(x)
        measured, parameters = moved(self.symbolic(state, p), p, e)
        away = self.innovation(self.symbolic(state, parameters), measured)
        jacobian = error_derivative(away, e)
        function = ca.Function(f"{self.name.replace('-', '_')}_by_error", [x, p], [row_by_row(jacobian)])
        return Compiled(function)

    @built_property
    def reads_attitude(self) -> bool:
        """Whether the expected value depends on the attitude."""
        x, p, _ = self._symbols
        state = self.layout.unpack(x)
        return "q" in state and ca.depends_on(self.symbolic(state, p), state["q"])

    @built_property
    def _symbols(self) -> tuple[ca.SX, ca.SX, ca.SX]:
        x = ca.SX.sym("x", self.layout.mean_dim)
        return x, ca.SX.sym("p", self.parameter_dim), ca.SX.sym("z", self.value_dim)

    def _function(self, name: str, inputs: list[Expression], outputs: list[Expression]) -> Compiled:
        return Compiled(ca.Function(f"{self.name.replace('-', '_')}_{name}", inputs, outputs))

    @built_property
    def _predict(self) -> Compiled:
        x, p, _ = self._symbols
        return self._function("predict", [x, p], [self.symbolic(self.layout.unpack(x), p)])

    @built_property
    def _predict_each(self) -> Vectorised:
        return Vectorised(self._predict.function)

    @built_property
    def _innovations(self) -> Compiled:
        x, p, z = self._symbols
        state = self.layout.unpack(x)
        return self._function(
            "innovations", [x, p, z], [self.innovation(self.symbolic(state, p), z), self.valid(state, p)]
        )

    def _innovations_of_pairs(
        self,
        points: Float[np.ndarray, "p m"],
        x: Float[np.ndarray, " m"],
        parameters: Float[np.ndarray, "k p2"],
        measured: Float[np.ndarray, "k v"],
    ) -> InnovationsAtPoints:
        """`innovations_at` by compiled code, every value beside every point."""
        count, shape = len(points), (len(measured), len(points))
        at, value = _pairs(*shape)
        innovation, valid, determinant = self.innovations_beside(
            points, x[np.newaxis], parameters, measured, rows=(at, None, value, value)
        )
        # a row for every pair, those of a value together: the points go behind the components
        beside = np.ascontiguousarray(innovation.reshape(*shape, self.dim).swapaxes(1, 2))
        with np.errstate(invalid="ignore", divide="ignore"):
            log_noise = np.log(determinant[::count, 0])
        return InnovationsAtPoints(beside, valid.reshape(shape).min(axis=1) > 0, log_noise)

    @built_property
    def innovations_beside(self) -> Vectorised:
        """Whitened innovation and validity at a point, and determinant of the noise factor at another, of many pairs."""
        x, p, z = self._symbols
        at, state = ca.SX.sym("at", self.layout.mean_dim), self.layout.unpack(x)
        factor = ca.SX(self.noise_factor(self.layout.unpack(at), p))
        away = ca.solve(factor, ca.SX.eye(self.dim)) @ self.innovation(self.symbolic(state, p), z)
        outputs = [away, self.valid(state, p), _determinant(factor)]
        return Vectorised(ca.Function(f"{self.name.replace('-', '_')}_beside", [x, at, p, z], outputs))

    @cached_property
    def _innovations_at(self) -> Callable[[int], Compiled]:
        return cache(self._build_innovations_at)

    @building()
    def _build_innovations_at(self, count: int) -> Compiled:
        """Compiled loop over landmarks with points inside, without copies."""
        x, p, z = self._symbols
        W, state = ca.SX.sym("W", self.dim, self.dim), self.layout.unpack(x)
        away = W @ self.innovation(self.symbolic(state, p), z)
        one = ca.Function("one", [x, p, z, W], [away, self.valid(state, p)])
        factor = ca.SX(self.noise_factor(state, p))
        noise = ca.Function(
            "noise", [x, p], [ca.solve(factor, ca.SX.eye(self.dim)), _log_determinant(factor)]
        )
        points, at = ca.MX.sym("points", self.layout.mean_dim, count), ca.MX.sym("x", self.layout.mean_dim)
        p, z = ca.MX.sym("p", self.parameter_dim), ca.MX.sym("z", self.value_dim)
        whitening, log_noise = noise(at, p)
        every = one.map("every", "serial", count, [1, 2, 3], [])
        innovation, valid = every(points, p, z, whitening)
        return self._function(
            f"innovations_{count}", [points, at, p, z], [row_by_row(innovation), ca.mmin(valid), log_noise]
        )

    @built_property
    def _whitening(self) -> Compiled:
        x, p, _ = self._symbols
        root = self.noise_factor(self.layout.unpack(x), p)
        return self._function("whitening", [x, p], [row_by_row(ca.solve(root, ca.SX.eye(self.dim)))])

    def _whitening_expression(self, x: ca.SX, p: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Inverse of the noise factor, and the log determinant of the factor."""
        factor = ca.SX(self.noise_factor(self.layout.unpack(x), p))
        return ca.solve(factor, ca.SX.eye(self.dim)), _log_determinant(factor)

    def _retract_symbol(self, x: ca.SX) -> tuple[dict[str, Expression], ca.SX]:
        """The state moved by an error, and this error."""
        d = ca.SX.sym("d", self.layout.error_dim)
        return self.layout.unpack(self.layout.retract_expression(x, d)), d

    @built_property
    def linearisation(self) -> Vectorised:
        """Linearisation of many values side by side.

        What `linearise` gives of a point, a value's parameters and the value.
        Outputs: whitened innovation, its Jacobian row by row, what is positive where the model applies, log determinant of the
        noise factor.
        """
        x, p, z = self._symbols
        moved, d = self._retract_symbol(x)
        state = self.layout.unpack(x)
        jacobian = -error_derivative(self.innovation(self.symbolic(moved, p), z), d, self.columns)
        whitening, log_noise = self._whitening_expression(x, p)
        innovation = self.innovation(self.symbolic(state, p), z)
        outputs = [
            whitening @ innovation,
            row_by_row(whitening @ jacobian),
            self.valid(state, p),
            log_noise,
        ]
        return Vectorised(ca.Function(f"{self.name.replace('-', '_')}_linearise", [x, p, z], outputs))


FEWEST_PAIRS: Final = 64
"""Of points and values, from which vector instructions are worth their library."""


@lru_cache(maxsize=64)
def _pairs(values: int, points: int) -> tuple[Int[np.ndarray, " q"], Int[np.ndarray, " q"]]:
    """Point and value of every pair, those of a value together."""
    return np.tile(np.arange(points), values), np.repeat(np.arange(values), points)


def _log_determinant(factor: ca.SX) -> ca.SX:
    """One logarithm, not one of every number on the diagonal."""
    return ca.log(_determinant(factor))


def _determinant(factor: ca.SX) -> ca.SX:
    return reduce(mul, ca.vertsplit(ca.diag(factor)))


def row_by_row(matrix: Expression) -> Expression:
    """All elements in one column, in the order of a NumPy array of that shape."""
    return ca.vec(matrix.T)


class LandmarkLinearisation(NamedTuple):
    """A sensor linearised about a state and k landmarks, one landmark per value, whitened by the noise factor.

    Attributes
    ----------
    innovation : Float[np.ndarray, 'k r']
        (k, dim).
    jacobian : Float[np.ndarray, 'k r c']
        (k, dim, c) by the model's `columns` of the state's error.
    by_landmark : Float[np.ndarray, 'k r 3']
        (k, dim, 3) by the landmark, frame g.
    valid : Bool[np.ndarray, ' k']
        (k,).
    log_noise : Float[np.ndarray, ' k']
        (k,), as in `Linearisation`.
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
    points : Float[np.ndarray, 'k 3']
        (k, 3) m, frame g.
    jacobian : Float[np.ndarray, 'k 3 c']
        (k, 3, c) by the model's `columns` of the state's error.
    root : Float[np.ndarray, 'k 3 3']
        (k, 3, 3) lower triangular factor of the covariance that the sensor's noise alone gives the point, m.
    determined : Bool[np.ndarray, ' k']
        (k,) whether the measurement determines all three coordinates (not the depth of a far point).
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
        """The point (3, frame g) that explains a measurement from this state exactly.

        The landmark among the parameters is not read, only what accompanies it.
        """

    @abstractmethod
    def determined(self, measured: Expression, parameters: Expression) -> Expression:
        """Positive where one measurement constrains `landmark` well (the disparity is large against its noise)."""

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
        """Landmarks initialised from one measurement each, at a common point (m,) or one each (k, m).

        The result holds their Jacobians by the state's error and their covariance factors due to the sensor's noise.
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
    def quick_observation_rows(self) -> Vectorised:
        """`observation_rows` in half the time, to rounding: all rows are multiplied by reciprocals of the noise and the depth."""
        return Vectorised(self.observation_rows.function, reciprocals=True)

    @built_property
    def observation_innovations(self) -> Vectorised:
        """Whitened innovations, validity (positive where valid) and noise determinant, from `observation_rows`' inputs."""
        x, p, z = self._symbols
        state = self.layout.unpack(x)
        whitening, _ = self._whitening_expression(x, p)
        away = whitening @ self.innovation(self.symbolic(state, p), z)
        outputs = [away, self.valid(state, p), self._noise_determinant(x, p)]
        return Vectorised(ca.Function(f"{self.name}_observation_innovations", [x, p[:3], p[3:], z], outputs))

    def _noise_determinant(self, x: ca.SX, p: ca.SX) -> ca.SX:
        return _determinant(ca.SX(self.noise_factor(self.layout.unpack(x), p)))

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
        """Whitening, innovation, and Jacobians by the model's columns and by the landmark.

        The Jacobians are those of the expected value, that is minus those of the innovation.
        """
        at, d = self._retract_symbol(x)
        expected = self.innovation(self.symbolic(at, p), z)
        here = self.innovation(self.symbolic(self.layout.unpack(x), p), z)
        jacobian = -error_derivative(expected, d, self.columns)
        return self._whitening_expression(x, p)[0], here, jacobian, -ca.jacobian(here, p)[:, :3]

    @built_property
    def _new_landmarks(self) -> Compiled:
        x, p, z = self._symbols
        at, d = self._retract_symbol(x)
        state = self.layout.unpack(x)
        point = self.landmark(state, z, p)
        jacobian = error_derivative(self.landmark(at, z, p), d, self.columns)
        spread = ca.jacobian(point, z) @ ca.SX(self.noise_factor(state, p))
        root = ca.qr(spread.T)[1].T
        valid = ca.fmin(self.determined(z, p), self.valid(state, ca.vertcat(point, p[3:])))
        outputs = [point, row_by_row(jacobian), row_by_row(root), valid]
        return self._function("new_landmarks", [x, p, z], outputs)
