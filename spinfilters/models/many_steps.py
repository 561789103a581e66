"""The steps of a whole trajectory linearised side by side: what `RotationIntegrator.linearise` gives, for many states at once.

A smoother linearises the dynamics about every frame in every iteration. The substeps here are those of the integrator, from the
same expressions and with the same control of their number, evaluated in lanes.
"""

from functools import cached_property

import casadi as ca
import numpy as np
from jaxtyping import Float

from spinfilters.errors import InputError
from spinfilters.models.rotation_steps import (
    RotationIntegrator,
    boole_weights,
    rotation_constants,
    rotation_difference,
)
from spinfilters.state.layout import StateLayout
from spinfilters.symbolic import Fold, Lanes


class ManySteps:
    """Linearised steps from many states; see `RotationIntegrator`."""

    def __init__(self, layout: StateLayout, integrator: RotationIntegrator) -> None:
        self._layout = layout
        self._integrator = integrator

    def linearise(
        self, x: Float[np.ndarray, "k m"], dt: Float[np.ndarray, " k"], densities: Float[np.ndarray, " 2"]
    ) -> tuple[Float[np.ndarray, "k m"], Float[np.ndarray, "k n n"], Float[np.ndarray, "k n q"]]:
        """Points after dt, error transitions, and factors of the noise covariances.

        Raises
        ------
        InputError: when a time step is not positive and finite.
        """
        count = self._count(x, dt)
        if not len(x):
            n = self._layout.error_dim
            return x.copy(), np.zeros((0, n, n)), np.zeros((0, n, 12 if "t" in self._layout.blocks else 6))
        start, constants = self._begin(x, rows=(None,))
        while True:
            moved, error = self._moved(start, constants, dt[:, None] / count, count)
            if self._integrator.good(error, count):
                break
            count *= 2
        return self._assembled(x, dt[:, None], densities, moved, count)

    def step(self, x: Float[np.ndarray, "k m"], dt: Float[np.ndarray, " k"]) -> Float[np.ndarray, "k m"]:
        """Points after dt alone; raises as `linearise`."""
        count = self._count(x, dt)
        if not len(x):
            return x.copy()
        start, constants = self._begin(x, rows=(None,))
        while True:
            fine, error = self._rotated(start, constants, dt[:, None] / count, count)
            if self._integrator.good(error, count):
                break
            count *= 2
        return self._translated(x, fine, dt[:, None], rows=(None,) * 3)[0]

    def _rotated(
        self, start: np.ndarray, constants: np.ndarray, h: np.ndarray, count: int
    ) -> tuple[np.ndarray, np.ndarray]:
        """(q, w) after ``count`` substeps, and its error."""
        fine = self._plain(start, constants, h, each=np.ones(count))
        coarse = self._plain(start, constants, h, each=np.full(count // 2, 2.0))
        return fine, self._error(coarse, fine, rows=(None, None))[0]

    def _count(self, x: np.ndarray, dt: np.ndarray) -> int:
        wrong = dt[~(np.isfinite(dt) & (dt > 0))]
        if len(wrong):
            raise InputError(f"time step is {wrong[0]} s; it must be positive and finite")
        return self._integrator.first_count(x, float(dt.max())) if len(x) else 0

    def _moved(
        self, start: np.ndarray, constants: np.ndarray, h: np.ndarray, count: int
    ) -> tuple[np.ndarray, np.ndarray]:
        """(q, w, Psi, Theta, noise) after ``count`` substeps, and the error of (q, w)."""
        sums = np.zeros((len(start), self._linear.width))
        sums[:, :7] = start
        sums[:, 7:43] = np.eye(6).reshape(-1)
        sums = self._linear(sums, constants, h, each=boole_weights(count)[:count])
        coarse = self._plain(start, constants, h, each=np.full(count // 2, 2.0))
        (error,) = self._error(coarse, np.ascontiguousarray(sums[:, :7]), rows=(None, None))
        return sums, error

    def _assembled(
        self, x: np.ndarray, dt: np.ndarray, densities: np.ndarray, moved: np.ndarray, count: int
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        noise = moved[:, -36:].copy()
        noise[:, 21::7] += dt / count * boole_weights(count)[count]
        both = np.broadcast_to(densities, (len(x), 2))
        after, transition, factor = self._assemble(
            x, dt, both, np.ascontiguousarray(moved[:, :-36]), noise, rows=(None,) * 5
        )
        n = self._layout.error_dim
        return (
            after,
            transition.reshape(len(x), n, n).swapaxes(1, 2),
            factor.reshape(len(x), -1, n).swapaxes(1, 2),
        )

    @cached_property
    def _linear(self) -> Fold:
        return Fold(self._integrator.linear_substep())

    @cached_property
    def _plain(self) -> Fold:
        substep, share = self._integrator.substep(), ca.SX.sym("share")
        x, p, h = substep.sx_in()
        return Fold(ca.Function("many_substeps", [x, p, h, share], [substep(x, p, share * h)]))

    @cached_property
    def _assemble(self) -> Lanes:
        return Lanes(self._integrator.assemble())

    @cached_property
    def _error(self) -> Lanes:
        coarse, fine = ca.SX.sym("coarse", 7), ca.SX.sym("fine", 7)
        error = rotation_difference(coarse, fine) / 15
        return Lanes(ca.Function("rotation_error", [coarse, fine], [error]))

    @cached_property
    def _translated(self) -> Lanes:
        x, moved, dt = ca.SX.sym("x", self._layout.mean_dim), ca.SX.sym("moved", 7), ca.SX.sym("dt")
        values = self._layout.unpack(x)
        after = self._integrator.translated(values, moved[:4], moved[4:], dt)
        return Lanes(ca.Function("many_translated", [x, moved, dt], [after]))

    @cached_property
    def _begin(self) -> Lanes:
        x = ca.SX.sym("x", self._layout.mean_dim)
        values = self._layout.unpack(x)
        start = ca.vertcat(values["q"], values["w"])
        return Lanes(ca.Function("rotation_start", [x], [start, rotation_constants(values)]))
