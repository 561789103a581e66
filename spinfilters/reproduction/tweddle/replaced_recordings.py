"""Recordings in place of the lost ones: a simulated one, and a rendered one for the lost images.

The simulated recording has the thesis' body, motion, rig and noise, its smoother and its bound. In the rendered one a satellite
goes through front end, smoother and dense model.
"""

import time
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

import numpy as np
from jaxtyping import Float, Int, UInt8
from PIL import Image

from spinfilters.core.attitude_conversions import matrix_from_quaternion
from spinfilters.evaluation.estimated_motion import Trajectory, body_history, trajectory_of
from spinfilters.evaluation.estimator_evaluation import Evaluation
from spinfilters.evaluation.prediction_errors import truth_in_frames_of
from spinfilters.evaluation.recording_bound import cramer_rao_bound
from spinfilters.filters.history import EstimateHistory
from spinfilters.io.camera import StereoRig
from spinfilters.io.dataset import Dataset
from spinfilters.io.truth import Truth
from spinfilters.lidar.mesh import TriangleMesh
from spinfilters.models.body import BodyEstimate
from spinfilters.run.comparison_run import compare_dataset
from spinfilters.run.reconstruction import Reconstruction, reconstruct
from spinfilters.run.run_folder import ANIMATION_FILE, RECONSTRUCTION_FOLDER, write_run
from spinfilters.settings.run_settings import Settings
from spinfilters.simulation.image_sequence import ImageScenario, Imaging, Pair, render
from spinfilters.simulation.scenario import RICH_RPM, Scenario, simulate, without_map
from spinfilters.vision.image_folder import LossCount, PairReader, read_pairs, stamped_pairs
from spinfilters.vision.rectification import Rectification, read_raw_rig
from spinfilters.vision.track_images import track_images

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


RADIUS: Final = 0.11
"""m, of the rendered satellite."""
PAIRS: Final = 30
FEW_PAIRS: Final = 10
"""Of a short sequence."""
TIME_LAPSE: Final = (0, 3, 6, 9)
"""Pairs that are shown."""
RENDERED: Final = (
    "The images are lost: 30 pairs of a rendered satellite on the rich motion, 0.4 s apart, go through front end, smoother and "
    "`spinfilters reconstruct`."
)


@dataclass(frozen=True, eq=False)
class RenderedRecording:
    """What the rendered recording gave.

    Attributes
    ----------
    reconstruction : Reconstruction
        The dense model.
    frames : list
        Of the animation beside the images.
    pairs : list
        Rectified pairs of `TIME_LAPSE`.
    rig : StereoRig
        Of the rectified images.
    evaluation : Evaluation
        Of the smoother.
    truth : Truth
        In the frames of the estimate.
    mesh : TriangleMesh
        That was rendered, m, in the true frame g.
    true_axes, true_center : (3, 3), (3,) float array
        Principal axes (rows) and centre of mass (m) in the true frame g.
    observations, landmarks : int
        That the front end found.
    association_s : float
        Time of processor that it took, s.
    seen, new : (p,) int array
        Observations in each pair, and landmarks that came in with it.
    bound : EstimateHistory or None
        True states with their Cramer-Rao bound.
    """

    reconstruction: Reconstruction
    frames: list[UInt8[np.ndarray, "h w"]]
    pairs: list[Pair]
    rig: StereoRig
    evaluation: Evaluation
    truth: Truth
    mesh: TriangleMesh
    true_axes: Float[np.ndarray, "3 3"]
    true_center: Float[np.ndarray, "3"]
    observations: int
    landmarks: int
    association_s: float
    seen: Int[np.ndarray, " p"]
    new: Int[np.ndarray, " p"]
    bound: EstimateHistory | None

    @property
    def bounded_body(self) -> BodyEstimate | None:
        """True body with the bound of its deviations after all pairs."""
        return None if self.bound is None else body_history(self.bound).at(-1)


@cache
def rendered_recording(pairs: int = PAIRS) -> RenderedRecording:
    """Render, track, smooth and reconstruct by the commands' own functions.

    Parameters
    ----------
    pairs : int
        Of the sequence.
    """
    scenario = ImageScenario(
        Scenario(radius_m=RADIUS, epochs=pairs, interval=0.4, rate_rpm=RICH_RPM),
        imaging=Imaging(oversampling=1, stars=0),
    )
    settings = Settings(estimators=("smoother",))
    with TemporaryDirectory() as place:
        images, run = Path(place) / "images", Path(place) / "run"
        images.mkdir()
        run.mkdir()
        render(scenario, images)
        begin = time.process_time()
        dataset = track_images(images).dataset
        association_s = time.process_time() - begin
        compared = compare_dataset(dataset, settings)
        write_run(run, compared, settings)
        found = reconstruct(run, images)
        frames = []
        with Image.open(run / RECONSTRUCTION_FOLDER / ANIMATION_FILE) as picture:
            for number in range(getattr(picture, "n_frames", 1)):
                picture.seek(number)
                frames.append(np.asarray(picture.convert("L")))
        rectification = Rectification(read_raw_rig(images))
        shown = _rectified_pairs(images, rectification)
    truth, evaluation = truth_in_frames_of(compared.evaluations[0]), compared.evaluations[0]
    told = dataset.truth
    assert truth is not None
    assert told is not None
    assert told.principal_axes_g is not None
    assert told.center_of_mass_g is not None
    (tracks,) = [stream for stream in dataset.log.streams if stream.sensor == dataset.sensor]
    assert tracks.ids is not None
    epoch = np.unique(tracks.time, return_inverse=True)[1]
    first = np.unique(tracks.ids, return_index=True)[1]
    return RenderedRecording(
        found,
        frames,
        shown,
        rectification.stereo,
        evaluation,
        truth,
        scenario.stage().body.mesh,
        told.principal_axes_g,
        told.center_of_mass_g,
        len(tracks),
        len(compared.maps["smoother"]),
        association_s,
        np.bincount(epoch),
        np.bincount(epoch[first], minlength=int(epoch.max()) + 1),
        cramer_rao_bound(compared.setup, told, evaluation),
    )


def _rectified_pairs(images: Path, rectification: Rectification) -> list[Pair]:
    """The pairs of `TIME_LAPSE`."""
    losses = LossCount()
    stamped = stamped_pairs(images, losses)
    reader = PairReader(rectification.rig.size, losses)
    chosen = read_pairs([stamped[k] for k in TIME_LAPSE], reader)
    return [rectification.images(pair.left, pair.right) for pair in chosen if pair is not None]
