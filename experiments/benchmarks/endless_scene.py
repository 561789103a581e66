"""An endless tumbling body, made piece by piece.

Its past takes no memory.
Body, camera and front end are those of `Scenario.common_workload`, the centre of mass stands still. A landmark has its own
probability of
being known again, as there, but is numbered once and for all: a recording of any length has no more landmarks than the body.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Bool, Float

from spinfilters.core.conventions import RPM
from spinfilters.core.mass_distribution import from_inertia
from spinfilters.filters.estimator import Measurement
from spinfilters.filters.timeline import Epoch
from spinfilters.models.camera_landmarks import StereoLandmark, camera_parameters
from spinfilters.models.feature_tracks import RIG, FrontEnd, ball
from spinfilters.models.gauge import GAUGE_STD
from spinfilters.models.process import ProcessNoise, TorqueFreeProcess
from spinfilters.models.sensors.stereo import stereo_tracks
from spinfilters.models.state_layout import FULL_BLOCKS, StateLayout
from spinfilters.simulation.scenario import RICH_RPM, Motion, Scenario, simulate_motion
from spinfilters.smoother.priors import FirstStatePrior

LAYOUT: Final = StateLayout(FULL_BLOCKS)
CAMERA: Final = StereoLandmark(LAYOUT)
SCENARIO: Final = Scenario.common_workload(RICH_RPM)
BETA: Final = (0.45, 1.4)
"""Shapes of the distribution of a landmark's probability, as in the scenario's recognition."""
PIECE: Final = 50
"""Frames that are made at once."""


@dataclass(frozen=True)
class OwnProbability:
    """Re-detection of a landmark with a probability of its own.

    It is known again, or missed, for a whole appearance.
    """

    probability: Float[np.ndarray, " k"]

    def known(
        self, visible: Bool[np.ndarray, "n k"], generator: np.random.Generator
    ) -> Bool[np.ndarray, "n k"]:
        """The visible landmarks of those appearances in which they are known again."""
        begins = visible & ~np.vstack([np.zeros_like(visible[:1]), visible[:-1]])
        appearance = np.cumsum(begins, axis=0) - 1
        drawn = generator.random(visible.shape) < self.probability
        return visible & np.take_along_axis(drawn, np.maximum(appearance, 0), axis=0)


class EndlessScene:
    """Frames of stereo observations, and the truth behind the latest of them."""

    def __init__(self, seed: int) -> None:
        self._generator = np.random.default_rng(seed)
        self._surface = ball(SCENARIO.landmarks, SCENARIO.radius_m, self._generator)
        probability = self._generator.beta(*BETA, SCENARIO.landmarks)
        self._front_end = FrontEnd(
            SCENARIO.pixel_std, SCENARIO.detection, SCENARIO.facing_cosine, OwnProbability(probability)
        )
        self._process = TorqueFreeProcess(LAYOUT, ProcessNoise(force_psd=0.0, torque_psd=1e-7))
        self._next, self._number = _first_state(), 0
        self.prior = _prior(self._next)
        self.truth = self._next

    def epochs(self, count: int) -> Iterator[Epoch]:
        """The next frames; ``truth`` is that of the one that was given last."""
        for begin in range(0, count, PIECE):
            size = min(PIECE, count - begin)
            time = SCENARIO.interval * (self._number + np.arange(size + 1))
            states = simulate_motion(self._process, self._next, time, self._generator)
            motion = Motion(LAYOUT, time[:-1], states[:-1])
            self._next, self._number = states[-1], self._number + size
            stream, _ = stereo_tracks(self._front_end, self._surface, motion, self._generator)
            assert stream.ids is not None
            for at, self.truth in zip(motion.time, motion.states, strict=True):
                rows = stream.time == at
                parameters = camera_parameters(np.zeros((rows.sum(), 3)), RIG.calibration, SCENARIO.pixel_std)
                measured = Measurement(CAMERA, stream.values[rows], parameters, stream.ids[rows])
                yield Epoch(float(at), (measured,))


def _first_state() -> Float[np.ndarray, " m"]:
    x, c = LAYOUT.origin(), np.array(SCENARIO.center_of_mass_g)
    x[LAYOUT.mean_slice("t")] = np.array([0.0, 0.0, SCENARIO.range_m]) - c
    x[LAYOUT.mean_slice("w")] = np.array(RICH_RPM) * RPM
    x[LAYOUT.mean_slice("c")] = c
    x[LAYOUT.mean_slice("s")] = from_inertia(np.diag(SCENARIO.principal_moments))
    return x


def _prior(first: Float[np.ndarray, " m"]) -> FirstStatePrior:
    """Prior of a rotating sphere about the origin of g.

    It rotates about as the body does; g is where the body is at first.
    """
    mean = first.copy()
    for block in ("c", "s"):
        mean[LAYOUT.mean_slice(block)] = 0.0
    return FirstStatePrior(mean, np.repeat([GAUGE_STD, 0.05, 1.0, 0.05, 0.5], [6, 3, 3, 3, 5]))
