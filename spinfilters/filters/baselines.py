"""Additive EKF and UKF of filterpy in global coordinates, as baselines."""

from abc import abstractmethod
from functools import cache

import casadi as ca
import numpy as np
from filterpy.kalman import ExtendedKalmanFilter, MerweScaledSigmaPoints, UnscentedKalmanFilter
from jaxtyping import Float

from spinfilters.core.attitude_expressions import (
    Expression,
    mrp_from_quaternion,
    quaternion_from_mrp,
    shadow_mrp,
)
from spinfilters.core.compiled import Compiled
from spinfilters.core.errors import InputError
from spinfilters.core.working_time import built_property
from spinfilters.filters.estimator import Estimator, Measurement, ProcessModel, Snapshot, UpdateReport
from spinfilters.filters.measurement_prediction import SigmaPointOptions, usable
from spinfilters.models.measurement import Linearisation
from spinfilters.models.state_blocks import ATTITUDE
from spinfilters.models.state_layout import Gaussian, StateLayout, error_derivative

LARGEST_MRP = 4.0
"""|a| at half a revolution: beyond it the shadow set is the shorter name of the same attitude."""


@cache
def global_coordinates(layout: StateLayout) -> "GlobalCoordinates":
    """Global coordinates of a layout, cached."""
    return GlobalCoordinates(layout)


class GlobalCoordinates:
    """Global coordinates xi (error_dim,) of the states of a layout.

    The 4 x MRP of q_ig, the numbers s, every other block itself.

    Errors of xi add; about a point they are C = d xi / d d times the layout's multiplicative error d, to first order. An attitude
    has two MRPs; which one is meant follows from the sign of the quaternion, which no step or sensor flips.
    """

    def __init__(self, layout: StateLayout) -> None:
        self.layout = layout

    def coordinates(self, x: Float[np.ndarray, "*batch m"]) -> Float[np.ndarray, "*batch n"]:
        """Global coordinates of states.

        On the MRP's branch of their quaternion's sign: |a| <= 4 where q_4 >= 0; singular at q_4 = -1.
        """
        return self._coordinates(x)[0]

    def point(self, xi: Float[np.ndarray, "*batch n"]) -> Float[np.ndarray, "*batch m"]:
        """Points of coordinates, the inverse of `coordinates`."""
        return self._point(xi)[0]

    def derivative(self, xi: Float[np.ndarray, " n"]) -> Float[np.ndarray, "n n"]:
        """C(xi): derivative of the coordinates with respect to the multiplicative error."""
        return self._derivative(xi)[0]

    def shortened(
        self, xi: Float[np.ndarray, " n"], covariance: Float[np.ndarray, "n n"]
    ) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n n"]]:
        """Mean and covariance after a switch to the shadow MRP where |a| > 4, unchanged elsewhere."""
        if not self.layout.has(ATTITUDE) or np.linalg.norm(xi[self.layout.slice("a")]) <= LARGEST_MRP:
            return xi, covariance
        switched, jacobian = self._shadow(xi)
        return switched, jacobian @ covariance @ jacobian.T

    def from_belief(self, belief: Gaussian) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n n"]]:
        """Mean and covariance of a belief in global coordinates, |a| <= 4.

        What a later switch to the shadow set needs is built here.
        """
        if self.layout.has(ATTITUDE):
            self._shadow.build()
        x = belief.mean.copy()
        if self.layout.has(ATTITUDE):
            q = self.layout.mean_slice("a")
            x[q] *= np.copysign(1.0, x[q.stop - 1])
        xi = self.coordinates(x)
        factor = self.derivative(xi) @ belief.factor
        return xi, factor @ factor.T

    def to_belief(self, xi: Float[np.ndarray, " n"], covariance: Float[np.ndarray, "n n"]) -> Gaussian:
        """Belief with the covariance C^-1 P C^-T.

        Raises
        ------
        numpy.linalg.LinAlgError: when the covariance is not finite or not positive definite; it is not repaired.
        """
        C = self.derivative(xi)
        half = np.linalg.solve(C, (covariance + covariance.T) / 2)
        P = np.linalg.solve(C, half.T)
        scale = np.sqrt(np.maximum(np.diag(P), 0.0))
        if not np.all(np.isfinite(scale) & (scale > 0)):
            raise np.linalg.LinAlgError(f"covariance has the diagonal {np.diag(P).tolist()}")
        P = (P + P.T) / 2 / np.outer(scale, scale)
        return Gaussian(self.layout, self.point(xi), scale[:, None] * np.linalg.cholesky(P))

    @built_property
    def _coordinates(self) -> Compiled:
        x = ca.SX.sym("x", self.layout.mean_dim)
        return Compiled(ca.Function("coordinates", [x], [self._coordinates_of(x)], ["x"], ["xi"]))

    def _coordinates_of(self, x: Expression) -> Expression:
        values = self.layout.unpack(x)
        if "q" in values:
            values["q"] = mrp_from_quaternion(values["q"])
        return self.layout.pack(values)

    @built_property
    def _point(self) -> Compiled:
        xi = ca.SX.sym("xi", self.layout.error_dim)
        return Compiled(ca.Function("point", [xi], [self._point_of(xi)], ["xi"], ["x"]))

    def _point_of(self, xi: Expression) -> Expression:
        values = {block.symbol: xi[self.layout.slice(block.name)] for block in self.layout.members}
        if self.layout.has(ATTITUDE):
            values[ATTITUDE.symbol] = quaternion_from_mrp(values[ATTITUDE.symbol])
        return self.layout.pack(values)

    @built_property
    def _derivative(self) -> Compiled:
        xi, d = ca.SX.sym("xi", self.layout.error_dim), ca.SX.sym("d", self.layout.error_dim)
        moved = self._coordinates_of(self.layout.retract_expression(self._point_of(xi), d))
        return Compiled(ca.Function("chart_derivative", [xi], [error_derivative(moved, d)], ["xi"], ["C"]))

    @built_property
    def _shadow(self) -> Compiled:
        xi, a = ca.SX.sym("xi", self.layout.error_dim), self.layout.slice("a")
        switched = ca.vertcat(xi[: a.start], shadow_mrp(xi[a]), xi[a.stop :])
        outputs = [switched, ca.jacobian(switched, xi)]
        return Compiled(ca.Function("shadow", [xi], outputs, ["xi"], ["switched", "jacobian"]))


LOG_2_PI = float(np.log(2 * np.pi))


class FilterpyFilter(Estimator):
    """Common part of both baselines: the chart, and the choice of usable values.

    A value is left out where it is not finite or the sensor is not valid at the mean.
    """

    def __init__(self, process: ProcessModel, wrapped: ExtendedKalmanFilter | UnscentedKalmanFilter) -> None:
        super().__init__(process)
        self._chart = global_coordinates(self.layout)
        self._filter = wrapped

    def start(self, belief: Gaussian) -> None:
        """Begin with a belief. InputError: blocks other than the process'."""
        if belief.layout != self.layout:
            raise InputError(
                f"belief has the blocks {belief.layout.blocks}, the process has {self.layout.blocks}"
            )
        self._filter.x, self._filter.P = self._chart.from_belief(belief)

    @property
    def belief(self) -> Gaussian:
        """Latest belief on the manifold, from the chart's mean and covariance."""
        return self._chart.to_belief(self._filter.x, self._filter.P)

    def predict(self, dt: float) -> None:
        """Predict the chart's mean and covariance ``dt`` seconds ahead."""
        xi = self._filter.x
        moved, transition, noise = self.process.linearise(self._chart.point(xi), dt)
        after = self._chart.coordinates(moved)
        C = self._chart.derivative(after)
        factor = C @ noise
        self._filter.Q = factor @ factor.T
        self._advance(dt, after, C @ transition)
        self._filter.x, self._filter.P = self._chart.shortened(self._filter.x, self._filter.P)

    def update(self, measurement: Measurement) -> UpdateReport:
        """Update by the usable values of a measurement."""
        model, count = measurement.model, len(measurement.values)
        about = model.linearise(self._chart.point(self._filter.x), measurement.parameters, measurement.values)
        keep = usable(about.innovation, about.valid)
        used = int(np.count_nonzero(keep))
        if not used:
            return UpdateReport(0.0, 0, 0, count)
        kept = Measurement(model, measurement.values[keep], measurement.parameters[keep])
        log_root = self._correct(kept, Linearisation(*[part[keep] for part in about]))
        innovation, dof = self._filter.y, used * model.dim
        nis = float(innovation @ self._filter.SI @ innovation)
        log_noise = float(about.log_noise[keep].sum())
        return UpdateReport(
            nis, dof, used, count - used, -0.5 * (nis + dof * LOG_2_PI) - log_root - log_noise
        )

    def snapshot(self) -> Snapshot:
        """Copies of the chart's mean and covariance."""
        return {"mean": np.array(self._filter.x), "covariance": np.array(self._filter.P)}

    def restore(self, snapshot: Snapshot) -> None:
        """Take mean and covariance from a `snapshot`."""
        self._filter.x, self._filter.P = snapshot["mean"].copy(), snapshot["covariance"].copy()

    @abstractmethod
    def _advance(
        self, dt: float, after: Float[np.ndarray, " n"], half_transition: Float[np.ndarray, "n n"]
    ) -> None:
        """Filterpy's prediction to the coordinates ``after``; its Q is set; ``half_transition`` is C(after) Phi."""

    @abstractmethod
    def _correct(self, measurement: Measurement, about: Linearisation) -> float:
        """Filterpy's update with usable values, linearised at the mean; returns half the log determinant of S."""


class FilterpyEkf(FilterpyFilter):
    """filterpy's extended Kalman filter: transition C(x') Phi C(x)^-1, Jacobian H C(x)^-1."""

    name = "filterpy-ekf"

    def __init__(self, process: ProcessModel) -> None:
        self._ekf = _ChartEkf(dim_x=process.layout.error_dim, dim_z=1)
        super().__init__(process, self._ekf)

    def _advance(
        self, dt: float, after: Float[np.ndarray, " n"], half_transition: Float[np.ndarray, "n n"]
    ) -> None:
        self._ekf.F = half_transition @ np.linalg.inv(self._chart.derivative(self._ekf.x))
        self._ekf.after = after
        self._ekf.predict()

    def _correct(self, measurement: Measurement, about: Linearisation) -> float:
        inverse = np.linalg.inv(self._chart.derivative(self._ekf.x))
        rows = about.jacobian.reshape(-1, about.jacobian.shape[-1])
        H, covariance = rows @ inverse[measurement.model.columns], self._ekf.P
        expected = -about.innovation.reshape(-1)
        self._ekf.update(np.zeros(len(H)), lambda _: H, lambda _: expected, R=np.eye(len(H)))
        return _half_log_determinant(covariance @ (H.T @ H))


class _ChartEkf(ExtendedKalmanFilter):
    """filterpy's EKF with a nonlinear prediction of the mean, by its documented override."""

    after: Float[np.ndarray, " n"]

    def predict_x(self, u: object = 0) -> None:
        """Set the mean to the one predicted outside; ``u`` is unused."""
        self.x = self.after


class FilterpyUkf(FilterpyFilter):
    """filterpy's unscented Kalman filter, on the same scaled points (Van der Merwe) as the multiplicative UKF."""

    name = "filterpy-ukf"

    def __init__(self, process: ProcessModel, options: SigmaPointOptions | None = None) -> None:
        options, n = options or SigmaPointOptions(), process.layout.error_dim
        self._points = MerweScaledSigmaPoints(n, options.alpha, options.beta, options.kappa, _upper_root)
        self._ukf = UnscentedKalmanFilter(n, 1, 0.0, hx=None, fx=self._propagate_point, points=self._points)
        super().__init__(process, self._ukf)

    def _propagate_point(self, xi: Float[np.ndarray, " n"], dt: float) -> Float[np.ndarray, " n"]:
        """One sigma point dt seconds later, on the branch that it reaches continuously from the mean's."""
        return self._chart.coordinates(self.process.step(self._chart.point(xi), dt))

    def _advance(
        self, dt: float, after: Float[np.ndarray, " n"], half_transition: Float[np.ndarray, "n n"]
    ) -> None:
        self._ukf.predict(dt=dt)

    def _correct(self, measurement: Measurement, about: Linearisation) -> float:
        model, parameters, values = measurement.model, measurement.parameters, measurement.values
        whitening = model.whitening(self._chart.point(self._ukf.x), parameters)

        def expected(xi: Float[np.ndarray, " n"]) -> Float[np.ndarray, " k"]:
            """Innovation at a point of the chart."""
            innovation, _ = model.innovations(self._chart.point(xi), parameters, values)
            return -np.einsum("kij,kj->ki", whitening, innovation).reshape(-1)

        # filterpy keeps the points of its last prediction: a second sensor at one time needs those of the present belief.
        self._ukf.sigmas_f = self._points.sigma_points(self._ukf.x, self._ukf.P)
        size = values.shape[0] * model.dim
        self._ukf.update(np.zeros(size), R=np.eye(size), hx=expected)
        deviations = self._ukf.sigmas_h - self._points.Wm @ self._ukf.sigmas_h
        return _half_log_determinant((self._points.Wc[:, None] * deviations) @ deviations.T)


def _upper_root(P: Float[np.ndarray, "n n"]) -> Float[np.ndarray, "n n"]:
    """U with U'U = P, by NumPy.

    SciPy's meets NaN with a ValueError that `run` would not take for a failed filter.
    """
    return np.linalg.cholesky(P).T


def _half_log_determinant(A: Float[np.ndarray, "r r"]) -> float:
    """Half log determinant of S by that of I + A, A = P H'H (Sylvester)."""
    return float(np.linalg.slogdet(np.eye(len(A)) + A)[1]) / 2
