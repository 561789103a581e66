"""A motion that keeps the whole body in view, drawn until one does.

Whether a disturbed path leaves the view is nearly decided by its centre of mass, which nothing of the rotation moves: paths are
drawn first, and only those that can stay in view are integrated with their rotation. What is returned is distributed as the first
motion in view of many that are drawn whole.
"""

import numpy as np
from jaxtyping import Float

from spinfilters.data.sensor_format import dataset_kinds
from spinfilters.models.process import TorqueFreeProcess
from spinfilters.sensors.feature_tracks import could_stay_in_view, stays_in_view
from spinfilters.simulation.motion import Motion
from spinfilters.simulation.scenario import Scenario, first_state, inspector_of
from spinfilters.state.layout import FULL_BLOCKS, StateLayout

KICKS = 10
"""Of white noise per interval: the covariance that a path gathers over an interval is too large by 1 / (2 KICKS^2),
half a percent."""


def motion_in_view(scenario: Scenario, generator: np.random.Generator) -> Motion:
    """First motion in view of at most ``scenario.candidates``, or the last."""
    layout = StateLayout(FULL_BLOCKS)
    process = TorqueFreeProcess(layout, scenario.noise)
    start = first_state(scenario, layout)
    time = scenario.interval * np.arange(scenario.epochs)
    attempts = scenario.candidates if dataset_kinds()[scenario.kind].has_landmarks else 1
    inspector = inspector_of(scenario, time)
    offset = float(np.linalg.norm(scenario.center_of_mass_g))
    depth = float(start[layout.mean_slice("t")][2])
    for attempt in range(attempts):
        shape = (len(time) - 1, KICKS, 2, 3)
        pushes = generator.standard_normal(shape)
        last = attempt == attempts - 1
        path = _path(scenario, pushes)
        near = inspector is not None or could_stay_in_view(path, depth, scenario.radius_m, offset)
        if not last and not near:
            continue
        normal = np.concatenate([generator.standard_normal(shape), pushes], axis=-1)
        states = process.disturbed_path(start, scenario.interval, normal)
        motion = Motion(layout, time, states)
        if last or stays_in_view(motion.seen_from(inspector), scenario.radius_m):
            return motion
    raise AssertionError("a scenario has at least one candidate")


def _path(scenario: Scenario, normal: Float[np.ndarray, "n k 2 3"]) -> Float[np.ndarray, "n 3"]:
    """Centre of mass at every epoch but the first, m, frame i.

    Straight between the kicks of its velocity.
    """
    h = scenario.interval / normal.shape[1]
    kicks = np.sqrt(scenario.noise.force_psd * (h / 2)) * normal.reshape(-1, 2, 3)
    after = np.cumsum(kicks.sum(axis=1), axis=0) + np.array(scenario.velocity)
    moved = np.cumsum(after - kicks[:, 1], axis=0) * h
    return np.array([0.0, 0.0, scenario.range_m]) + moved[normal.shape[1] - 1 :: normal.shape[1]]
