"""Data of all figures of a run."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from spinfilters.data.dataset import Dataset
from spinfilters.data.dataset_reader import read_dataset
from spinfilters.evaluation.estimator_evaluation import Evaluation, evaluate
from spinfilters.evaluation.rates import BodyRates, measured_rates, true_rates
from spinfilters.evaluation.trajectory import read_map_ply
from spinfilters.evaluation.trajectory_errors import Alignment
from spinfilters.geometry.camera_trajectory import CameraTrajectory
from spinfilters.pipeline.conditions import conditions_of, told_sentences
from spinfilters.pipeline.estimation import Comparison
from spinfilters.pipeline.setup import knows_frames
from spinfilters.plots.scene import DrawnCamera
from spinfilters.runs.run_folder import DATASET_FOLDER, MAP_FILE, read_histories
from spinfilters.runs.run_summary import not_whole, read_summary
from spinfilters.state.status import Verdict


@dataclass(frozen=True)
class FigureData:
    """Data of all figures of a run.

    Evaluations of one data set, the landmarks (k, 3) if any, and sentences on its conditions.
    """

    dataset: Dataset
    evaluations: Sequence[Evaluation]
    map_points: Float[np.ndarray, "k 3"] | None
    conditions: Sequence[str] = ()

    @property
    def true_moments(self) -> Float[np.ndarray, " 3"] | None:
        """Principal moments of the truth, None without one."""
        return None if self.dataset.truth is None else self.dataset.truth.principal_moments

    @property
    def reference(self) -> BodyRates | None:
        """True rates, or else what a gyro measured."""
        truth, errors = self.dataset.truth, self.evaluations[0].errors
        if truth is not None and errors is not None:
            return true_rates(truth, errors.frame)
        return measured_rates(self.dataset.log)

    @property
    def most_exact(self) -> Evaluation | None:
        """Evaluation of the smoother, else of the first estimator that has not failed."""
        usable = [each for each in self.evaluations if each.history.status.verdict is not Verdict.FAILED]
        return min(usable, key=lambda each: each.name != "smoother", default=None)

    @property
    def camera(self) -> DrawnCamera | None:
        """Camera of the data set, None without one."""
        rig = self.dataset.rig
        return None if rig is None else DrawnCamera(rig, CameraTrajectory.of(self.dataset.inspector))

    @classmethod
    def from_comparison(cls, comparison: Comparison) -> "FigureData":
        """Figure data of a run that has just ended."""
        setup, first = comparison.setup, comparison.evaluations[0].name
        conditions = conditions_of(setup).sentences
        return cls(setup.dataset, comparison.evaluations, comparison.maps.get(first), conditions)

    @classmethod
    def from_folder(cls, folder: Path) -> "FigureData":
        """Figure data of a run folder.

        Raises
        ------
        InputError: a folder that is no run, or a damaged one.
        """
        document = read_summary(folder)
        dataset = read_dataset(folder / DATASET_FOLDER)
        alignment = Alignment.NONE if knows_frames(dataset) else Alignment.FIRST_FRAME
        try:
            names = [str(name) for name in document["estimators"]]
            map_path = folder / names[0] / MAP_FILE
        except (KeyError, IndexError, TypeError, ValueError) as error:
            raise not_whole(folder, error) from None
        histories = read_histories(folder, names)
        evaluations = [evaluate(history, dataset.truth, alignment) for history in histories]
        points = read_map_ply(map_path) if map_path.exists() else None
        return cls(dataset, evaluations, points, told_sentences(document))
