"""A true motion from kick to kick: noise-free steps between white disturbances, many of them in one compiled call."""

from functools import lru_cache

import casadi as ca
import numpy as np
from jaxtyping import Float

from spinfilters.models.rotation_steps import RotationIntegrator
from spinfilters.state.blocks.rigid_body import RATE, VELOCITY
from spinfilters.state.layout import StateLayout
from spinfilters.symbolic import Compiled, building

DISTURBED = (RATE.name, VELOCITY.name)
"""Blocks that disturbances kick, where a layout has them."""


class DisturbedSteps:
    """Steps of one or many states that are kicked before and after each (Strang splitting); see `RotationIntegrator`."""

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
        count = self._integrator.first_count(x, h)
        while True:
            after, error = self._folds(count, len(kicks))(x, h, np.moveaxis(flat, 0, -1))
            if self._integrator.good(error, count):
                return after
            count *= 2

    @building()
    def _build(self, count: int, steps: int) -> Compiled:
        """``steps`` steps of ``count`` substeps each; the error is the largest of a step."""
        into = ca.DM.zeros(self._layout.mean_dim, len(self.kicked))
        into[self.kicked, :] = ca.DM.eye(len(self.kicked))
        into = ca.sparsify(into)
        x, h = ca.MX.sym("x", self._layout.mean_dim), ca.MX.sym("h")
        kick = ca.MX.sym("kick", 2 * len(self.kicked))
        before, behind = ca.vertsplit(kick, len(self.kicked))
        moved, error = self._integrator.step_function(count)(x + into @ before, h)
        one = ca.Function("disturbed_step", [x, h, kick], [moved + into @ behind, error])
        kicks = ca.MX.sym("kicks", 2 * len(self.kicked), steps)
        every, errors = one.mapaccum("disturbed", steps)(x, ca.repmat(h, 1, steps), kicks)
        outputs = [every[:, -1], ca.mmax(errors)]
        return Compiled(ca.Function(f"disturbed_{steps}_{count}", [x, h, kicks], outputs))
