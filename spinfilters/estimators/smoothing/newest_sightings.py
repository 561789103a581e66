"""What is believed of the newest frame of a window, whose guess may be poor and whose landmarks may be wrong."""

from dataclasses import replace

import numpy as np

from spinfilters.estimators.smoothing.problem import Point, Problem, Stage
from spinfilters.estimators.smoothing.revival import revived
from spinfilters.estimators.smoothing.robust_kernels import RobustKernel
from spinfilters.estimators.smoothing.sightings import SIGHTINGS_NEEDED, linearise_sightings

STRANGE = 0.3
"""Share of the newest frame's sightings without weight from which the frame's guess, not the sightings, is taken to be wrong."""
WIDTH = 5.0
"""Standard deviations within which sightings' own points agree."""


def is_strange(problem: Problem, here: Point, kernel: RobustKernel) -> bool:
    """Whether the kernel loses most of the newest frame."""
    if here.linear is None or problem.sightings is None:
        return False
    newest = np.flatnonzero(problem.sightings.frame == problem.unknowns.frames - 1)
    lost = kernel.weight(here.linear.square[newest]) == 0
    return bool(len(lost)) and float(np.mean(lost)) > STRANGE


def with_landmarks_put_right(problem: Problem, here: Point, stage: Stage) -> Point:
    """With landmarks placed anew of whose sightings fewer than two are believed."""
    if problem.sightings is None or here.linear is None:
        return here
    believed = stage.kernel.weight(here.linear.square) > 0
    if believed.all():
        return here
    landmark, count = problem.sightings.landmark, problem.sightings.landmarks
    every, good = np.bincount(landmark, minlength=count), np.bincount(landmark[believed], minlength=count)
    if not ((every > SIGHTINGS_NEEDED) & (good < SIGHTINGS_NEEDED)).any():
        return here
    points = revived(problem.sightings, here.trajectory, here.points, believed, WIDTH)
    if points is None:
        return here
    linear = linearise_sightings(problem.sightings, here.trajectory, points)
    return replace(here, points=points, linear=linear)
