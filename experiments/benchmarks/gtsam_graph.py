"""The smoothing problem as GTSAM's factors.

Its own for stereo observations, and the project's motion as custom factors.
GTSAM calls back into Python for every custom factor; `CallbackClock` tells how long that takes, so that a comparison can be judged.
Rows that were computed last are kept in each factor, so that linearising where the error was evaluated costs nothing more.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from experiments.benchmarks.gtsam_chart import (
    GtsamChart,
    constants_key,
    gtsam,
    landmark_key,
    pose_key,
    rates_key,
)
from experiments.benchmarks.motion_rows import MOVING, prior_rows, step_rows
from experiments.benchmarks.smoother_workload import PIXEL_STD, Workload
from experiments.benchmarks.stopwatch import now

Rows = tuple[Float[np.ndarray, " r"], Float[np.ndarray, "r c"]]
"""Whitened residual, and its derivative by the project's error."""


@dataclass
class CallbackClock:
    """Seconds and calls of the custom factors' Python.

    Calls that asked for derivatives are counted apart.
    """

    seconds: float = 0.0
    calls: int = 0
    linearisations: int = 0


class MotionFactors:
    """Makes the custom factors of one workload, whose time goes to one clock."""

    def __init__(self, workload: Workload, chart: GtsamChart) -> None:
        self.clock = CallbackClock()
        self._workload = workload
        self._chart = chart

    def prior(self) -> Any:
        """Prior of the first state, over X_0, V_0, C."""
        layout, prior = self._workload.layout, self._workload.prior
        return self._factor([0], lambda states: prior_rows(layout, states[0], prior), layout.error_dim)

    def step(self, frame: int) -> Any:
        """Step between epochs, over X_k, V_k, X_k+1, V_k+1, C."""
        process, timeline = self._workload.process, self._workload.timeline
        dt = timeline[frame + 1].time - timeline[frame].time
        return self._factor(
            [frame, frame + 1], lambda states: step_rows(process, states[0], states[1], dt), MOVING
        )

    def _factor(self, epochs: list[int], rows: Callable[[list[np.ndarray]], Rows], size: int) -> Any:
        pairs = [(pose_key(frame), rates_key(frame)) for frame in epochs]
        common, chart, clock = constants_key(), self._chart, self.clock
        last: dict[bytes, Rows] = {}

        def error(_: Any, values: Any, jacobians: Any) -> Float[np.ndarray, " r"]:
            """Whitened error of the factor, and its Jacobians."""
            begin = now()
            constants = values.atVector(common)
            states = [chart.state(values.atPose3(x), values.atVector(v), constants) for x, v in pairs]
            where = b"".join([state.tobytes() for state in states])
            if where not in last:
                last.clear()
                last[where] = rows(states)
            residual, by_error = last[where]
            if jacobians is not None:
                clock.linearisations += 1
                for k, block in enumerate(chart.by_variables(states, constants, by_error)):
                    jacobians[k] = block
            clock.calls += 1
            clock.seconds += now() - begin
            return residual

        keys = [key for pair in pairs for key in pair]
        return gtsam.CustomFactor(gtsam.noiseModel.Unit.Create(size), [*keys, common], error)


class StereoFactors:
    """Makes GTSAM's own factors of a workload's observations."""

    def __init__(self, workload: Workload) -> None:
        fx, fy, cx, cy, baseline = workload.calibration.tolist()
        self._camera = gtsam.Cal3_S2Stereo(fx, fy, 0.0, cx, cy, baseline)
        self._noise = gtsam.noiseModel.Isotropic.Sigma(3, PIXEL_STD)

    def observation(self, frame: int, landmark: int, pixels: Float[np.ndarray, " 3"]) -> Any:
        """Observation of the landmark with this key: (u_left, v_left, u_right) px."""
        return gtsam.GenericStereoFactor3D(
            _measured(pixels), self._noise, pose_key(frame), landmark, self._camera
        )

    def point(self, pose: Any, pixels: Float[np.ndarray, " 3"]) -> Float[np.ndarray, " 3"]:
        """Landmark of an observation from this pose X, m, frame g."""
        return gtsam.StereoCamera(pose, self._camera).backproject(_measured(pixels))


def whole_graph(workload: Workload, factors: MotionFactors) -> Any:
    """Every factor of a workload."""
    graph, stereo, seen = gtsam.NonlinearFactorGraph(), StereoFactors(workload), workload.observations
    graph.add(factors.prior())
    for frame in range(len(workload.timeline) - 1):
        graph.add(factors.step(frame))
    for frame, number, pixels in zip(seen.epoch, seen.landmark, workload.values, strict=True):
        graph.add(stereo.observation(int(frame), landmark_key(int(number)), pixels))
    return graph


def _measured(pixels: Float[np.ndarray, " 3"]) -> Any:
    u_left, v, u_right = pixels.tolist()
    return gtsam.StereoPoint2(u_left, u_right, v)
