"""One inertia of several runs of one body: what `fused.json` holds, and the file of the inertia.

Without common axes only the moments can be weighed (`spinfilters.run.segment_runs`). Where the axes g of all recordings are the
body's own, as those of a gyro that stayed mounted, all five numbers of the mass distribution are
(`spinfilters.evaluation.fused_inertia`).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from spinfilters.core.errors import InputError
from spinfilters.evaluation.fused_inertia import fuse_inertias, mass_belief
from spinfilters.inference.setup import knows_frames
from spinfilters.io.input_file import path_text, read_toml
from spinfilters.io.output_files import write_json, write_toml
from spinfilters.models.body import BodyEstimate, body_estimate
from spinfilters.models.state_blocks import MASS_DISTRIBUTION
from spinfilters.models.state_layout import Gaussian
from spinfilters.run.array_files import finite_document
from spinfilters.run.readers import read_dataset
from spinfilters.run.run_folder import (
    CONFIG_FILE,
    DATASET_FOLDER,
    last_belief,
)
from spinfilters.run.run_summary import read_summary
from spinfilters.run.segment_runs import pooled_moments

SCHEMA: Final = 1
FUSED_FILE, INERTIA_FILE = "fused.json", "inertia.toml"
UNDETERMINED: Final = "moments-undetermined"
"""The check of an estimate whose motion leaves moments open."""


@dataclass(frozen=True, eq=False)
class RunInertia:
    """Inertia that one run found.

    Attributes
    ----------
    name : str
        Folder and estimator.
    run : Path
        The run's folder.
    entry : dict
        Of the estimator in summary.json.
    belief : Gaussian
        About the mass distribution after the last epoch.
    """

    name: str
    run: Path
    entry: dict[str, Any]
    belief: Gaussian

    @property
    def body(self) -> BodyEstimate:
        """Moments and axes."""
        return body_estimate(self.belief)


def fuse_runs(folders: Sequence[Path], same_axes: bool) -> dict[str, Any]:
    """Content of `FUSED_FILE`.

    Parameters
    ----------
    folders : sequence of Path
        Runs, whose first estimator counts, or folders of estimators in runs; at least two.
    same_axes : bool
        Whether axes g are fixed to the body alike in all recordings.

    Raises
    ------
    InputError
        Fewer than two runs, the same twice, one that is damaged; none whose estimate is ``ok``; with common axes, a run whose g is
        defined by its first frame, or that began from a stated belief.
    """
    if len(folders) < 2:
        raise InputError("one run is nothing to fuse; give two or more runs of one body")
    runs = [_read_run(folder) for folder in folders]
    repeated = [each for k, each in enumerate(runs) if each.run in [other.run for other in runs[:k]]]
    if repeated:
        raise InputError(f"{path_text(repeated[0].run)}: stands twice; its measurements would count twice")
    prior_std = _common_prior(runs) if same_axes else None
    good = [each for each in runs if _is_usable(each.entry, same_axes)]
    left_out = {each.name: str(each.entry["status"]) for each in runs if each not in good}
    if not good:
        raise InputError("the moments of none of the runs are ok; look at their verdicts")
    found = _fuse_moments(good, len(runs)) if prior_std is None else _fuse_in_common_axes(good, prior_std)
    return {
        "schema": SCHEMA,
        "same_axes": same_axes,
        "runs": {each.name: _describe_body(each.body) for each in good},
        "left_out": left_out,
        **found,
    }


def write_fused(folder: Path, document: dict[str, Any]) -> None:
    """`FUSED_FILE`, and the inertia as ``compare --race`` takes it."""
    write_json(folder / FUSED_FILE, finite_document(document))
    keys = ("principal_moments", "principal_axes_g")
    write_toml(folder / INERTIA_FILE, {key: document[key] for key in keys if key in document})


def _is_usable(entry: dict[str, Any], same_axes: bool) -> bool:
    """Whether an estimate is ok; in common axes also one of which nothing is wrong but that its motion shows a part only."""
    failed = {each["name"] for each in entry["checks"]}
    return entry["status"] == "ok" or (same_axes and failed == {UNDETERMINED})


def _read_run(folder: Path) -> RunInertia:
    last = last_belief(folder)
    entry = read_summary(last.run)["estimators"][last.estimator]
    try:
        belief = mass_belief(last.belief)
    except InputError as error:
        raise InputError(f"{path_text(folder)}: {error}") from None
    return RunInertia(f"{last.run.name}/{last.estimator}", last.run, entry, belief)


def _describe_body(body: BodyEstimate) -> dict[str, Any]:
    return {
        "principal_moments": body.principal_moments.tolist(),
        "principal_moments_std": body.principal_moments_std.tolist(),
    }


def _fuse_moments(runs: Sequence[RunInertia], total: int) -> dict[str, Any]:
    pooled = pooled_moments([each.entry for each in runs], total)
    if pooled is None:
        raise InputError("none of the runs has moments with a finite covariance; look at their verdicts")
    covariance = np.zeros((3, 3))
    covariance[:2, :2] = pooled.widening**2 * pooled.covariance
    return {
        "principal_moments": [*pooled.ratios.tolist(), 1.0],
        "principal_moments_std": [*pooled.std.tolist(), 0.0],
        "principal_moments_cov": covariance.tolist(),
        "chi_square": pooled.chi_square,
        "degrees_of_freedom": pooled.degrees,
        "probability": pooled.probability,
        "widening": pooled.widening,
    }


def _fuse_in_common_axes(runs: Sequence[RunInertia], prior_std: float) -> dict[str, Any]:
    fused = fuse_inertias([each.belief for each in runs], prior_std)
    body = fused.body
    return {
        "principal_moments": body.principal_moments.tolist(),
        "principal_moments_std": body.principal_moments_std.tolist(),
        "principal_moments_cov": body.principal_moments_cov.tolist(),
        "principal_axes_g": body.principal_axes_g.tolist(),
        "principal_axes_std_rad": body.principal_axes_std.tolist(),
        "chi_square": fused.chi_square,
        "degrees_of_freedom": fused.degrees,
        "probability": fused.probability,
        "widening": fused.widening,
    }


def _common_prior(runs: Sequence[RunInertia]) -> float:
    """Deviation of the prior of all runs. InputError: as `_prior_std`, or different ones."""
    priors = {_prior_std(each) for each in runs}
    if len(priors) > 1:
        raise InputError("the runs have different initialisation.mass_std; run them with one prior")
    return priors.pop()


def _prior_std(run: RunInertia) -> float:
    """Deviation of the mass distribution's prior. InputError: frame g is not the body's, or the run began from a belief."""
    if not knows_frames(read_dataset(run.run / DATASET_FOLDER)):
        raise InputError(
            f"{path_text(run.run)}: its frame g is that of its first epoch, not the body's own; fuse without --same-axes"
        )
    told = read_toml(run.run / CONFIG_FILE).get("initialisation", {})
    if told.get("mean") or told.get("from_truth"):
        raise InputError(
            f"{path_text(run.run)}: began from a stated belief, which would count once a run; fuse without --same-axes"
        )
    return float(told.get(MASS_DISTRIBUTION.prior_option, MASS_DISTRIBUTION.prior_std))
