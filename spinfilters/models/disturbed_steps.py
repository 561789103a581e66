"""Simulated true motion under white disturbances. Noise-free steps between them, many in one compiled call."""

from functools import lru_cache

import casadi as ca
import numpy as np
from jaxtyping import Float

from spinfilters.models.rotation_integrator import RotationIntegrator
from spinfilters.state.blocks.rigid_body import ATTITUDE, RATE, VELOCITY
from spinfilters.state.layout import StateLayout
from spinfilters.symbolic.compiled import Compiled
from spinfilters.symbolic.working_time import building

DISTURBED = (RATE.name, VELOCITY.name)
"""Blocks that disturbances kick, where a layout has them."""
TOGETHER = 16
"""Intervals of a path in one compiled call; the last call of a path goes on without disturbances, unseen."""


class DisturbedSteps:
    """Steps disturbed before and after each (Strang splitting).

    It serves one or many states; see `RotationIntegrator`.
    """

    def __init__(self, layout: StateLayout, integrator: RotationIntegrator) -> None:
        self._layout = layout
        self._integrator = integrator
        self._folds = lru_cache(maxsize=None)(self._build)

    @property
    def kicked(self) -> list[int]:
        """Places in a point of the components that are kicked, block after block."""
        every = np.arange(self._layout.mean_dim)
        blocks = (block for block in DISTURBED if block in self._layout.blocks)
        return np.concatenate([every[self._layout.mean_slice(block)] for block in blocks]).tolist()

    def run(
        self, x: Float[np.ndarray, "*batch m"], h: float, kicks: Float[np.ndarray, "n *batch 2 b"]
    ) -> Float[np.ndarray, "*batch m"]:
        """Points after n steps of h > 0 seconds.

        Parameters
        ----------
        kicks: what is added to the `kicked` components before and after each step.
        """
        flat = kicks.reshape(*kicks.shape[:-2], -1)
        columns = flat[0] if len(flat) == 1 else np.moveaxis(flat, 0, -1)  # one column is a vector
        count = self._integrator.first_count(x, h)
        while True:
            after, error = self._folds(count, len(kicks))(x, h, columns)
            if self._integrator.good(error, count):
                return after
            count *= 2

    def path(
        self, x: Float[np.ndarray, " m"], h: float, kicks: Float[np.ndarray, "n k 2 b"]
    ) -> Float[np.ndarray, "n_plus_1 m"]:
        """The point x and those after every k steps of h > 0 seconds; see `run`."""
        intervals, each = kicks.shape[:2]
        filled = -(-intervals // TOGETHER) * TOGETHER
        flat = np.zeros((filled, each, kicks.shape[2] * kicks.shape[3]))
        flat[:intervals] = kicks.reshape(intervals, each, -1)
        points, q = [x[np.newaxis]], self._layout.mean_slice(ATTITUDE.name)
        for begin in range(0, filled, TOGETHER):
            part = self._path_part(points[-1][-1], h, flat[begin : begin + TOGETHER])
            part[:, q] /= np.linalg.norm(part[:, q], axis=1, keepdims=True)
            points.append(part)
        return np.concatenate(points)[: 1 + intervals]

    def _path_part(
        self, x: Float[np.ndarray, " m"], h: float, kicks: Float[np.ndarray, "n k b"]
    ) -> Float[np.ndarray, "n m"]:
        count, steps = self._integrator.first_count(x, h), kicks.shape[0] * kicks.shape[1]
        columns = kicks.reshape(steps, -1).T
        while True:
            after, error = self._folds(count, steps, kicks.shape[1])(x, h, columns)
            if self._integrator.good(error, count):
                return after.T.copy()
            count *= 2

    @building()
    def _build(self, count: int, steps: int, kept: int | None = None) -> Compiled:
        """Build ``steps`` steps of ``count`` substeps each.

        The last point, or those after every ``kept`` steps, one a column.
        The error is the largest of a step.
        """
        into = ca.DM.zeros(self._layout.mean_dim, len(self.kicked))
        into[self.kicked, :] = ca.DM.eye(len(self.kicked))
        into = ca.sparsify(into)
        x, h = ca.MX.sym("x", self._layout.mean_dim), ca.MX.sym("h")
        kick = ca.MX.sym("kick", 2 * len(self.kicked))
        before, behind = ca.vertsplit(kick, len(self.kicked))
        moved, error = self._integrator.expressions.step(count)(x + into @ before, h)
        one = ca.Function("disturbed_step", [x, h, kick], [moved + into @ behind, error])
        kicks = ca.MX.sym("kicks", 2 * len(self.kicked), steps)
        every, errors = one.mapaccum("disturbed", steps)(x, ca.repmat(h, 1, steps), kicks)
        points = every[:, -1] if kept is None else every[:, kept - 1 :: kept]
        name = f"disturbed_{steps}_{count}" + ("" if kept is None else f"_{kept}")
        return Compiled(ca.Function(name, [x, h, kicks], [points, ca.mmax(errors)]))
