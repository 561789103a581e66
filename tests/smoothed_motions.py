"""The motion about which a verdict linearises, of any setup and trajectory."""

import numpy as np
from jaxtyping import Float

from spinfilters.filters.timeline import times_of
from spinfilters.inference.setup import Setup
from spinfilters.verdict.model_errors.hypotheses import solved_near
from spinfilters.verdict.model_errors.smoothed_motion import SmoothedMotion
from spinfilters.verdict.model_tests import landmarks_placed, linear_problem


def motion_near(setup: Setup, trajectory: Float[np.ndarray, "k m"]) -> SmoothedMotion:
    """The most probable motion of the first epochs near a trajectory of them."""
    epochs = setup.timeline[: len(trajectory)]
    problem = linear_problem(setup, epochs)
    rows = solved_near(problem, trajectory, landmarks_placed(problem, trajectory))
    assert rows is not None
    return SmoothedMotion(times_of(epochs), rows)
