"""Campaigns of runs: a study's table of factors times seeds, as a data frame."""

import os
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from spinfilters.api.arguments import CampaignArguments
from spinfilters.core.errors import InputError
from spinfilters.io.argument_checks import called, checked_arguments, one_of, optional, path
from spinfilters.io.input_file import value_text

if TYPE_CHECKING:
    from spinfilters.campaigns.engine import Advance, Progress
    from spinfilters.campaigns.study import Study


AnyStudy = Mapping[str, Any] | str | os.PathLike[str]
"""The tables of a study file, or the path of one."""


@checked_arguments(
    CampaignArguments,
    study=one_of(Mapping, path_of="a study file", cure="the path of a study file or a mapping of its tables"),
    output=optional(path("a folder")),
    progress=optional(called),
)
def campaign(
    study: AnyStudy,
    output: str | os.PathLike[str] | None = None,
    *,
    workers: int | None = None,
    scheduler: str | None = None,
    resume: bool = False,
    batch: bool = False,
    progress: "Progress | None" = None,
) -> Any:
    """Run every cell of a study with every seed, as ``spinfilters campaign`` does.

    Parameters
    ----------
    study : Mapping, str or os.PathLike
        The path of a study file, or a mapping of its tables such as
        ``{"study": {"name": "mine", "seeds": 20}, "factors": {"estimator": ["mekf"]}}``.
    output : str, os.PathLike or None
        Folder of the rows; None keeps none.
    workers : int or None
        Processes, by default one per processor.
    scheduler : str or None
        Address of a Dask scheduler whose workers make the runs instead.
    resume : bool
        Whether to go on with the rows that ``output`` has; none is made again.
    batch : bool
        Whether to make many runs at once, for filters of poses or attitudes with drawn beliefs; rows are then without verdicts.
    progress : Callable[[Advance], None] or None
        Called after every row.

    Returns
    -------
    pandas.DataFrame
        A row per run.

    Raises
    ------
    InputError
        What the command refuses with exit code 2; the text is one line that names the value and the cure.
    KeyboardInterrupt
        Ctrl-C; the rows so far are in ``output``, if given, for ``resume`` to go on from.
    """
    require_installed("pandas")
    if output is None:
        if resume:
            raise InputError("resume needs the folder of the rows; give output")
        with tempfile.TemporaryDirectory(prefix="spinfilters-") as place:
            return campaign(
                study, place, workers=workers, scheduler=scheduler, batch=batch, progress=progress
            )
    folder = Path(output)
    how = CampaignArguments(workers=workers, scheduler=scheduler, resume=resume, batch=batch)
    campaign_rows(study, folder, how, progress)
    from spinfilters.campaigns.rows_folder import read_rows

    checked = _study(study)
    return read_rows(folder, checked.columns, levels=checked.levels).to_pandas()


def campaign_rows(
    study: AnyStudy, folder: Path, how: CampaignArguments, progress: "Progress | None" = None
) -> "Advance":
    """Make the rows of a study that a folder lacks. Parameters and errors: `campaign`."""
    if how.workers is not None and how.scheduler is not None:
        raise InputError("workers are processes of this machine, a scheduler has its own; give one of both")
    if how.batch and how.scheduler is not None:
        raise InputError("batches are made on this machine; give a scheduler or batch, not both")
    for package in ("pyarrow", "distributed"):
        require_installed(package)
    from spinfilters.campaigns.batch import ROWS_TOGETHER, Batches
    from spinfilters.campaigns.dask_cluster import DaskCluster, usable_processors
    from spinfilters.campaigns.engine import run_campaign

    workers = how.workers or usable_processors()
    executor = Batches(workers) if how.batch else DaskCluster(how.scheduler, workers)
    together = ROWS_TOGETHER if how.batch else 1
    return run_campaign(_study(study), folder, executor, how.resume, progress or (lambda _: None), together)


def repeated_run(folder: Path, run: int, dataset_folder: Path | None) -> dict[str, Any]:
    """Repeat one run of a campaign and give its row; its data set is written where a folder is given.

    Raises
    ------
    InputError
        No campaign's folder, no such run, a folder that holds something else.
    """
    require_installed("pyarrow")
    from spinfilters.campaigns.rows_folder import read_folder
    from spinfilters.campaigns.runner import Runner
    from spinfilters.io.dataset_folder import write_dataset
    from spinfilters.io.output_files import output_folder

    study, _ = read_folder(folder)
    if run >= len(study):
        raise InputError(f"run {run} is none of the {len(study)} of {study.name}; give a number below that")
    runner = Runner(study)
    if dataset_folder is not None:
        with output_folder(dataset_folder, "campaign repeat") as place:
            write_dataset(runner.recording(study.run(run)), place)
    return runner.row(run)


def _study(study: AnyStudy) -> "Study":
    from spinfilters.campaigns.study import read_study, study_from

    if isinstance(study, Mapping):
        return study_from(study, "study")
    if isinstance(study, str | os.PathLike):
        return read_study(Path(study))
    raise InputError(
        f"study is {value_text(study)}; give the path of a study file or a mapping of its tables"
    )


def require_installed(package: str) -> None:
    """Refuse in one line where a package of the extra ``campaign`` is not installed."""
    from importlib.util import find_spec

    if find_spec(package) is None:
        raise InputError(f"campaigns need {package}, which is not installed; install 'spinfilters[campaign]'")
