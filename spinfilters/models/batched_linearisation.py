"""Batched linearisation of the process over a trajectory (`RotationIntegrator.linearise`).

A smoother linearises the dynamics about every frame in every iteration. The substeps here are those of the integrator, from the
same expressions and with the same control of their number, evaluated in lanes.
"""

from contextlib import suppress
from dataclasses import dataclass

import casadi as ca
import numpy as np
from jaxtyping import Float, Int

from spinfilters.core.attitude_expressions import (
    Expression,
    conjugate,
    product,
    quaternion_from_mrp,
    short_mrp_from_quaternion,
)
from spinfilters.core.errors import InputError
from spinfilters.core.vectorised import VectorisedScan
from spinfilters.core.working_time import built_property
from spinfilters.io.disturbances import DISTURBANCES
from spinfilters.models.rotation_integrator import (
    FEWEST,
    IntegrationError,
    LinearisedSteps,
    RotationIntegrator,
    boole_weights,
    rotation_difference,
    rotation_parameters,
    substep_numbers,
    turn_limits,
)
from spinfilters.models.state_layout import StateLayout

ROTATION = 7
"""Numbers of (q, w)."""
ALIKE = 8.0
"""Ratio of turns whose steps are integrated side by side."""
SMALLEST_TURN = 1e-3
"""Rad in a step, for which the fewest substeps are enough."""


@dataclass(frozen=True)
class StepBatch:
    """Steps of ``dt`` seconds from ``here`` to about ``there``; Jacobians are evaluated at ``about``.

    The points ``about`` are those of ``here``, possibly with other constants.

    Attributes
    ----------
    speeds : Float[np.ndarray, ' k']
        (k,) |w| here, rad/s.
    """

    here: Float[np.ndarray, "k m"]
    there: Float[np.ndarray, "k m"]
    about: Float[np.ndarray, "k m"]
    dt: Float[np.ndarray, " k"]
    speeds: Float[np.ndarray, " k"]

    def chosen(self, rows: Int[np.ndarray, " r"]) -> "StepBatch":
        """Some of them."""
        return StepBatch(
            self.here[rows], self.there[rows], self.about[rows], self.dt[rows], self.speeds[rows]
        )


@dataclass(frozen=True, eq=False)
class StepsScan:
    """Compiled scan of linearised steps, for other compiled code to call.

    Its arguments are points here, points there, points about, dt, the length of a substep, and the densities of white noise; its
    results the errors of integration, defects, transitions and noise factors, these row by row.

    Attributes
    ----------
    scan : int
        Its address.
    error_dim, noise_dim : int
        Components of the error of integration, and columns of the noise factor.
    limits : Float[np.ndarray, ' c']
        Largest turn of a step (rad) that ``fewest``, twice and four times as many substeps take.
    numbers : tuple[np.ndarray, ...]
        `substep_numbers` of each of these.
    rate : int
        Place of the body rate in a point.
    tolerance : float
        Bound on every component of the error of integration.
    alike, smallest_turn : float
        Ratio of turns whose steps are integrated side by side, and the turn below which they do not differ.
    densities : Float[np.ndarray, ' p']
        Of the white noise.
    """

    scan: int
    error_dim: int
    noise_dim: int
    limits: Float[np.ndarray, " c"]
    numbers: tuple[Float[np.ndarray, "_ 2"], ...]
    fewest: int
    rate: int
    tolerance: float
    alike: float
    smallest_turn: float
    densities: Float[np.ndarray, " p"]


class BatchedLinearisation:
    """Linearised steps from many states; see `RotationIntegrator`."""

    def __init__(self, layout: StateLayout, integrator: RotationIntegrator) -> None:
        self._layout = layout
        self._integrator = integrator

    def linearise(
        self,
        here: Float[np.ndarray, "k m"],
        there: Float[np.ndarray, "k m"],
        dt: Float[np.ndarray, " k"],
        densities: Float[np.ndarray, " p"],
        about: Float[np.ndarray, "k m"] | None = None,
    ) -> LinearisedSteps:
        """Defects, error transitions and noise factors of steps; see `TorqueFreeProcess.linearise_steps`.

        Raises
        ------
        InputError
            When a time step is not positive and finite. Steps beyond the integrator's budget are NaN: a trial
            that turns so fast is refused by its cost.
        """
        wrong = dt[~(np.isfinite(dt) & (dt > 0))]
        if len(wrong):
            raise InputError(f"time step is {wrong[0]} s; it must be positive and finite")
        speeds = self._integrator.speeds(here)
        steps = StepBatch(here, there, here if about is None else about, dt, speeds)
        with np.errstate(over="ignore", invalid="ignore"):
            groups = _group_steps(speeds * dt)
        if len(groups) == 1:
            with suppress(IntegrationError):
                return self._linearise_evenly(steps, densities)
            groups = []  # none of them can be integrated
        n, q = self._layout.error_dim, self._integrator.noise_dim
        shapes = ((len(dt), n), (len(dt), n, n), (len(dt), n, q))
        defect, transition, noise = (np.full(shape, np.nan) for shape in shapes)
        for rows in groups:
            with suppress(IntegrationError):
                defect[rows], transition[rows], noise[rows] = self._linearise_evenly(
                    steps.chosen(rows), densities
                )
        return LinearisedSteps(defect, transition, noise)

    def steps_scan(self, densities: Float[np.ndarray, " p"]) -> StepsScan | None:
        """The scan of `linearise`; None where it is not compiled."""
        scan, limits = self._scan.loop, turn_limits(self._integrator.tolerance)
        if scan is None:
            return None
        return StepsScan(
            scan,
            *(self._scan.output_widths[0], self._integrator.noise_dim, np.array(list(limits.values()))),
            *(tuple(map(substep_numbers, limits)), FEWEST, self._layout.mean_slice("w").start),
            *(self._integrator.tolerance, ALIKE, SMALLEST_TURN, densities),
        )

    def _linearise_evenly(self, steps: "StepBatch", densities: Float[np.ndarray, " p"]) -> LinearisedSteps:
        """`linearise` with as many substeps for all as the longest turn needs."""
        here, dt = steps.here, steps.dt[:, None]
        count = self._integrator.count_at(float(steps.speeds.max()), float(dt.max())) if len(here) else 0
        while True:
            error, defect, transition, noise = self._scan(
                here,
                steps.there,
                steps.about,
                dt,
                dt / max(count, 1),
                densities[None],
                each=substep_numbers(count),
            )
            if self._integrator.good(error, count):
                break
            count *= 2
        k, n = defect.shape
        return LinearisedSteps(defect, transition.reshape(k, n, n), noise.reshape(k, n, noise.shape[1] // n))

    @built_property
    def _scan(self) -> VectorisedScan:
        """The scan over substeps.

        Its state is [(q, w) in substeps of h | (q, w) in substeps of 2 h, for the error estimate | the sums of the
        linearisation].
        """
        inputs = self._inputs()
        begin = ca.Function("begin_steps", inputs, [*self._begin_rotation(inputs[0], inputs[2]), inputs[4]])
        state = ca.SX.sym("state", 2 * ROTATION + self._integrator.expressions.linear_substep.numel_in(0))
        end = ca.Function("end_steps", [*inputs, state], self._end(inputs, state))
        return VectorisedScan(begin, self._rotation_function(state), end, reciprocals=True)

    def _inputs(self) -> list[Expression]:
        points = [ca.SX.sym(name, self._layout.mean_dim) for name in ("here", "there", "about")]
        return [*points, ca.SX.sym("dt"), ca.SX.sym("h"), ca.SX.sym("psd", len(DISTURBANCES))]

    def _begin_rotation(self, here: Expression, about: Expression) -> list[Expression]:
        """The first state, and the constants of the rotation of both."""
        own, slopes = self._layout.unpack(here), self._layout.unpack(about)
        p, rotation = rotation_parameters(self._layout, own), ca.vertcat(own["q"], own["w"])
        rest = ca.vertcat(ca.SX.eye(6)[:], ca.SX.zeros(6 * p.numel() + 36))
        first = ca.vertcat(rotation, rotation, slopes["q"], slopes["w"], rest)
        return [first, p, rotation_parameters(self._layout, slopes)]

    def _rotation_function(self, state: Expression) -> ca.Function:
        substep, linear = (
            self._integrator.expressions.substep(),
            self._integrator.expressions.linear_substep,
        )
        p, slopes = ca.SX.sym("p", substep.numel_in(1)), ca.SX.sym("slopes", substep.numel_in(1))
        h, numbers = ca.SX.sym("h"), ca.SX.sym("numbers", 2)
        fine, coarse, sums = ca.vertsplit(state, [0, ROTATION, 2 * ROTATION, state.numel()])
        after = ca.vertcat(
            substep(fine, p, h), substep(coarse, p, numbers[1] * h), linear(sums, slopes, h, numbers[0])
        )
        return ca.Function("many_steps", [state, p, slopes, h, numbers], [after])

    def _end(self, inputs: list[Expression], state: Expression) -> list[Expression]:
        """Error of the integration, defect, transition and noise factor, the last two row by row."""
        here, there, about, dt, h, psd = inputs
        layout, n = self._layout, state.numel()
        fine, coarse, sums, noise = ca.vertsplit(state, [0, ROTATION, 2 * ROTATION, n - 36, n])
        error = rotation_difference(coarse, fine) / 15
        after = self._integrator.expressions.translated(layout.unpack(here), fine[:4], fine[4:], dt)
        last = ca.diagcat(ca.SX.zeros(3, 3), ca.SX.eye(3)) * h * boole_weights(FEWEST)[-1]
        _, transition, factor = self._integrator.expressions.assemble(
            about, dt, psd, sums, ca.reshape(noise, 6, 6) + last
        )
        turn, a = _turn_between(layout.unpack(there)["q"], layout.unpack(after)["q"]), layout.slice("a")
        transition[a, :], factor[a, :] = turn @ transition[a, :], turn @ factor[a, :]
        defect = layout.near_local_expression(there, after)  # of a body that is the same at both ends
        return [ca.densify(part) for part in (error, defect, transition.T[:], factor.T[:])]


def _group_steps(turns: Float[np.ndarray, " k"]) -> list[Int[np.ndarray, " r"]]:
    """Indices of steps grouped by the size of their rotations, rad.

    Rotations of up to `ALIKE` times the median form one group, which holds every step of an ordinary recording.
    """
    largest, smallest = turns.max(initial=0.0), float(turns.min(initial=np.inf))
    # whatever the median between them: it is not asked for where one group is sure
    if largest < ALIKE * max(smallest, SMALLEST_TURN) or not np.isfinite(turns).all():
        return [np.arange(len(turns))]
    relative = np.maximum(turns / max(float(np.median(turns)), SMALLEST_TURN), 1.0)
    size = np.floor(np.log(relative) / np.log(ALIKE)).astype(int)
    return [np.flatnonzero(size == each) for each in np.unique(size)]


def _turn_between(there: Expression, after: Expression) -> Expression:
    """Derivative of an attitude error about ``there`` by that about ``after``, 3 x 3."""
    e = ca.SX.sym("e", 3)
    error = short_mrp_from_quaternion(product(conjugate(there), product(after, quaternion_from_mrp(e))))
    return ca.substitute(ca.jacobian(error, e), e, 0)
