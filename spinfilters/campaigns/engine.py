"""A campaign: the outstanding runs of a study, made wherever an executor makes them, kept row by row."""

import time
from collections import Counter
from collections.abc import Callable, Generator, Iterator
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from spinfilters.campaigns.rows_folder import RowsFolder, keep_study, open_folder
from spinfilters.campaigns.runner import Row
from spinfilters.campaigns.study import Study
from spinfilters.io.output_files import make_folder
from spinfilters.run.run_lock import locked_run

Chunk = tuple[int, ...]
"""Runs of one recording, which one process makes one after another."""


@dataclass(frozen=True)
class Advance:
    """Progress of a campaign.

    Attributes
    ----------
    done : int
        Runs that have a row.
    total : int
        Runs of the study.
    faulty : int
        Rows of this call without a result.
    seconds_left : float or None
        Until the last row, s; None before the first of this call.
    commonest_reason : str
        Why most of the rows without a result have none.
    """

    done: int
    total: int
    faulty: int
    seconds_left: float | None
    commonest_reason: str = ""


Progress = Callable[[Advance], None]
"""Called after every row."""


class Executor(Protocol):
    """Place where runs are computed."""

    def rows(self, study: Study, chunks: list[Chunk]) -> Generator[Row, None, None]:
        """Rows of all runs, each once, in the order of completion.

        Parameters
        ----------
        study : Study
            Whose runs are made.
        chunks : list of Chunk
            Numbers of its runs, those of one recording together.
        """
        ...


def run_campaign(
    study: Study,
    folder: Path,
    executor: Executor,
    resume: bool = False,
    progress: Progress = lambda _: None,
    together: int = 1,
) -> Advance:
    """Compute the runs of a study that its folder lacks.

    Parameters
    ----------
    study : Study
        Its runs.
    folder : Path
        Of the rows; made where it does not exist.
    executor : Executor
        Place where runs are computed.
    resume : bool
        Go on with the rows that the folder has.
    progress : Progress
        Called before the first row and after every one.
    together : int
        Rows that are written at once (`RowsFolder`).

    Raises
    ------
    InputError
        As `open_folder`, `RowsFolder`, `keep_study` and the executor.
    KeyboardInterrupt
        Ctrl-C; every row that had come is kept.
    """
    make_folder(folder)
    with locked_run(folder):
        open_folder(folder, study, resume)
        with RowsFolder(folder, study.columns, study.levels, together) as rows:
            done = rows.done()
            keep_study(folder, study, done)
            chunks = list(_outstanding_chunks(study, done))
            pace = _Pace(len(done), sum(map(len, chunks)))
            advance = pace.advance(0, Counter())
            progress(advance)
            if not chunks:
                return advance
            reasons: Counter[str] = Counter()
            with closing(executor.rows(study, chunks)) as found:
                for count, row in enumerate(found, 1):
                    rows.append(row)
                    if row["outcome"] != "done":
                        reasons[str(row["reason"])] += 1
                    advance = pace.advance(count, reasons)
                    progress(advance)
            return advance


def _outstanding_chunks(study: Study, done: set[int]) -> Iterator[Chunk]:
    """Runs without a row, those of the same recording together."""
    together = study.estimators
    for first in range(0, len(study), together):
        if chunk := tuple(run for run in range(first, first + together) if run not in done):
            yield chunk


class _Pace:
    """Time left, from the rows of this call alone."""

    def __init__(self, before: int, total: int) -> None:
        self._before, self._total, self._begin = before, total, time.monotonic()

    def advance(self, count: int, reasons: Counter[str]) -> Advance:
        """Progress after ``count`` rows of this call; those without a result are counted by their reason."""
        spent = time.monotonic() - self._begin
        left = spent / count * (self._total - count) if count else None
        commonest = reasons.most_common(1)[0][0] if reasons else ""
        return Advance(self._before + count, self._before + self._total, reasons.total(), left, commonest)
