"""The simulated recording in place of the lost one: the thesis' body, motion, rig and noise, its smoother and its bound."""

from dataclasses import dataclass
from functools import cache
from typing import Final

import numpy as np
from jaxtyping import Float, Int

from spinfilters.core.attitude_conversions import matrix_from_quaternion
from spinfilters.evaluation.estimated_motion import Trajectory, body_history, trajectory_of
from spinfilters.evaluation.estimator_evaluation import Evaluation
from spinfilters.evaluation.recording_bound import cramer_rao_bound
from spinfilters.filters.history import EstimateHistory
from spinfilters.io.dataset import Dataset
from spinfilters.models.body import BodyEstimate
from spinfilters.run.comparison_run import compare_dataset
from spinfilters.settings.run_settings import Settings
from spinfilters.simulation.scenario import Scenario, simulate, without_map

FULL: Final = Scenario()
SHORT: Final = Scenario(epochs=30, landmarks=300)
"""Of tests."""
NO_BOUND: Final = "not computed: landmarks and poses of the truth do not fit the estimate's"


@dataclass(frozen=True, eq=False)
class SimulatedRecording:
    """A recording with what the smoother made of it, and its Cramer-Rao bound.

    Attributes
    ----------
    dataset : Dataset
        With truth and the true map.
    evaluation : Evaluation
        Of the smoother, without the map.
    points : (k, 3) float array
        Estimated landmarks in g, m.
    bound : EstimateHistory or None
        True states with the bound of their covariance.
    """

    dataset: Dataset
    evaluation: Evaluation
    points: Float[np.ndarray, "k 3"]
    bound: EstimateHistory | None

    @property
    def bounded_motion(self) -> Trajectory | None:
        """True motion with the bound of its deviations."""
        return None if self.bound is None else trajectory_of(self.bound)

    @property
    def bounded_body(self) -> BodyEstimate | None:
        """True body with the bound of its deviations after all epochs."""
        return None if self.bound is None else body_history(self.bound).at(-1)


@cache
def simulated_recording(scenario: Scenario = FULL) -> SimulatedRecording:
    """Simulate, smooth and bound a recording once.

    Parameters
    ----------
    scenario : Scenario
        With truth; its map is withheld from the smoother.
    """
    dataset = simulate(scenario)
    truth = dataset.truth
    assert truth is not None
    compared = compare_dataset(without_map(dataset), Settings(estimators=("smoother",)))
    evaluation = compared.evaluations[0]
    bound = cramer_rao_bound(compared.setup, truth, evaluation)
    return SimulatedRecording(dataset, evaluation, compared.maps["smoother"], bound)


def bound_cell(value: float | None, missing: str = NO_BOUND) -> float | str:
    """A bound for a row, or why there is none.

    Parameters
    ----------
    value : float or None
        In the unit of the row.
    missing : str
        Why there is none.
    """
    return missing if value is None or not np.isfinite(value) else float(value)


def landmark_bounds(dataset: Dataset, ids: Int[np.ndarray, " k"]) -> Float[np.ndarray, "k 3 3"]:
    """Covariances of landmarks in g, m^2, whose poses are all known: no estimate that must find the poses, too, does better.

    Parameters
    ----------
    dataset : Dataset
        Stereo tracks with truth and the true map, seen by a camera at rest.
    ids : (k,) int array
        Landmarks of the true map.
    """
    truth, known, rig = dataset.truth, dataset.known_map, dataset.rig
    assert truth is not None
    assert known is not None
    assert rig is not None
    assert truth.center_of_mass_g is not None
    stream = dataset.log.stream("stereo")
    assert stream.ids is not None
    fx, fy, _, _, baseline = rig.calibration[:5]
    information = np.zeros((len(known.ids), 3, 3))
    which = np.searchsorted(known.ids, stream.ids)
    rows = np.searchsorted(truth.time, stream.time - 1e-9)
    R = matrix_from_quaternion(truth.q_ig)[rows]
    points = known.points[which] - truth.center_of_mass_g
    x, y, z = (np.einsum("nij,nj->ni", R, points) + truth.center_of_mass[rows]).T
    zero = np.zeros_like(z)
    # rows of the Jacobian: u_left, v_left, u_right by the point in axes of the camera
    slopes = (
        np.stack(
            [
                np.stack([fx / z, zero, -fx * x / z**2], axis=1),
                np.stack([zero, fy / z, -fy * y / z**2], axis=1),
                np.stack([fx / z, zero, -fx * (x - baseline) / z**2], axis=1),
            ],
            axis=1,
        )
        @ R
    )
    np.add.at(information, which, np.swapaxes(slopes, 1, 2) @ slopes / PIXEL_STD**2)
    return np.linalg.inv(information[np.searchsorted(known.ids, ids)])


PIXEL_STD: Final = FULL.pixel_std
"""px (section 6.4)."""
