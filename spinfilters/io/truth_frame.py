"""A true motion expressed in another body-fixed frame g."""

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from spinfilters.core.attitude_conversions import inverse, multiply, rotate
from spinfilters.io.truth import Truth


def truth_in_moved_frame(truth: Truth, turn: Float[np.ndarray, "4"], shift: Float[np.ndarray, "3"]) -> Truth:
    """The truth in another frame g.

    Parameters
    ----------
    turn : Float[np.ndarray, '4']
        Maps the new g to that of the truth.
    shift : Float[np.ndarray, '3']
        Origin of the new g in that of the truth, m.
    """
    axes, centre, bias = truth.principal_axes_g, truth.center_of_mass_g, truth.gyro_bias
    back = inverse(turn)
    return replace(
        truth,
        q_ig=multiply(truth.q_ig, np.broadcast_to(turn, truth.q_ig.shape)),
        principal_axes_g=None if axes is None else rotate(back, axes),
        center_of_mass_g=None if centre is None else rotate(back, centre - shift),
        gyro_bias=None if bias is None else rotate(back, bias),
    )
