"""Pictures of a run by further processes, which draw what is known while the estimators run.

A process is sent data and the names of pictures, one at a time, and answers with the content of a file. What shows estimates alone
is drawn as soon as these are made, and the rest when the verdicts are. The process that asked writes the files. Whatever ends a
further process early, the one that asked draws what is missing, and meets and reports the cause itself.
"""

import os
import subprocess
import sys
import threading
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from functools import partial
from multiprocessing import Pipe
from pathlib import Path
from typing import Any, Final, Protocol

import numpy as np
from jaxtyping import Float

from spinfilters.core.errors import InputError
from spinfilters.evaluation.estimator_evaluation import Evaluation
from spinfilters.inference.setup import Setup
from spinfilters.io.output_files import write_bytes
from spinfilters.io.stated_values import NumberRange
from spinfilters.models.state_layout import StateLayout
from spinfilters.plots.figures import FigureData, draw_run, early_pictures, figure_names

MOST_PROCESSES: Final = 3
"""In addition to the one that asks; a run has about ten pictures."""
PROCESSES: Final = "SPINFILTERS_PICTURE_PROCESSES"
"""Environment variable that states another number, 0 for none."""
STATED_PROCESSES: Final = NumberRange(0, 99, whole=True)
PROGRAM: Final = "spinfilters.run.painter_program"
"""Module that a further process runs."""
LONGEST_PICTURE: Final = 60.0
"""Seconds that a picture of another process may still take where no further one is left to draw."""
LARGEST_SENT: Final = 32_000_000
"""Bytes of covariances that are sent to another process; it reads more from the run folder."""
DRAWN_WHILE_LOADING: Final = 2
"""Pictures that a process draws while another one loads what draws."""
_ENVIRONMENT: Final = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MPLBACKEND": "agg"}


@dataclass(frozen=True, eq=False)
class PictureSource:
    """What a picture shows: data that are sent, or else the run folder that holds them.

    Attributes
    ----------
    figure_data : FigureData or None
        The data; None of a folder.
    folder : Path or None
        The folder; None of data.
    """

    figure_data: FigureData | None = None
    folder: Path | None = None

    def is_same(self, other: "PictureSource | None") -> bool:
        """Whether both are the same data, or the same folder."""
        return other is not None and (self.figure_data is other.figure_data and self.folder == other.folder)


class ConnectionEnd(Protocol):
    """An end of a connection between two processes, of the kind that the system has."""

    def send(self, obj: Any, /) -> None:
        """Send an object."""

    def recv(self) -> Any:
        """The next object. EOFError: the other end is closed."""


class Painter:
    """What draws pictures of a run on request, in another process, at the end of a connection.

    Parameters
    ----------
    connection : ConnectionEnd
        The process ends with it.
    """

    def __init__(self, connection: ConnectionEnd) -> None:
        self._connection = connection
        self._source: PictureSource | None = None
        self._sent: list[object] = []

    def drawn(self, name: str, source: PictureSource) -> bytes | None:
        """Content of a picture's file; None where the process has ended, or cannot be sent what it shows."""
        if not source.is_same(self._source):
            if source.folder is not None and self._open(source.folder) is None:
                return None
            if source.figure_data is not None and self._show(source.figure_data) is None:
                return None
            self._source = source
        return self._answer("draw", name)

    def _open(self, folder: Path) -> bytes | None:
        """Let it read a run folder; its working directory may be another."""
        return self._answer("open", os.fspath(folder.absolute()))

    def _show(self, figure_data: FigureData) -> bytes | None:
        """Send it data; a part that was sent before is not sent again."""
        new = list[object]()

        def place(part: object, as_sent: Callable[[], object]) -> int:
            """Where a part is among those sent; a new one is the next."""
            for number, each in enumerate(self._sent):
                if each is part:
                    return number
            self._sent.append(part)
            new.append(as_sent())
            return len(self._sent) - 1

        places = [place(figure_data.dataset, lambda: figure_data.dataset)]
        places += [place(each, partial(_without_models, each)) for each in figure_data.evaluations]
        return self._answer("show", new, places, figure_data.map_points, figure_data.conditions)

    def _answer(self, *request: object) -> bytes | None:
        """What it answers to a request; None for no answer."""
        # It has ended, or a plug-in's data cannot be sent: the process that asked meets the cause when it draws.
        with suppress(Exception):
            self._connection.send(request)
            return self._connection.recv()
        return None


class PictureProcess(Painter):
    """A process that draws pictures of a run on request, and ends with the process that started it.

    Parameters
    ----------
    has_twin : bool
        Whether it makes a copy of itself when what draws is loaded, where systems copy processes safely.

    Attributes
    ----------
    twin : Painter or None
        The copy: a second painter, which costs no time unless it draws.
    """

    def __init__(self, has_twin: bool = False) -> None:
        paths = [str(Path(__file__).parents[2]), *filter(None, [os.environ.get("PYTHONPATH")])]
        own, its_end = Pipe()
        super().__init__(own)
        twins, its_twins_end = Pipe()
        self.twin = Painter(twins) if has_twin and sys.platform == "linux" else None
        passed = [] if self.twin is None else [its_twins_end.fileno()]
        with its_end, its_twins_end:
            self._process = subprocess.Popen(
                [sys.executable, "-m", PROGRAM, *map(str, passed)],
                stdin=its_end.fileno(),
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                pass_fds=passed,
                env={**_ENVIRONMENT, **os.environ, "PYTHONPATH": os.pathsep.join(paths)},
                start_new_session=True,  # Ctrl-C is for the process that asked
            )

    def close(self) -> None:
        """End it at once; what waits for its answer gets none. Its twin ends with the connection."""
        self._process.kill()
        self._process.wait()


def _without_models(evaluation: Evaluation) -> Evaluation:
    """An evaluation without the functions of its layout and blocks: no picture needs them, and compiled ones take long to send."""
    bare = StateLayout(evaluation.history.layout.blocks)
    sent = replace(evaluation, history=replace(evaluation.history, layout=bare))
    sent.__dict__["body"] = evaluation.body
    return sent


@contextmanager
def picture_processes(wanted: bool) -> Iterator[list[PictureProcess]]:
    """Processes in addition to this one, one for each further core; none where not wanted or where none can be started.

    Raises
    ------
    InputError
        The environment variable `PROCESSES` is not a whole number in its range.
    """
    processes: list[PictureProcess] = []
    count = _further_processes() if wanted else 0
    try:
        with suppress(OSError):  # no memory or no right for another: this one draws
            for number in range(count):
                processes.append(PictureProcess(has_twin=number == 0))
        yield processes
    finally:
        for process in processes:
            process.close()


def _further_processes() -> int:
    """One for each core but that of this process, within the most."""
    stated = os.environ.get(PROCESSES, "")
    try:
        most = STATED_PROCESSES.parsed(stated) if stated else MOST_PROCESSES
    except ValueError as error:
        raise InputError(f"environment variable {PROCESSES}: {error}, or unset it") from None
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return min(cores - 1, int(most))


@dataclass(frozen=True, eq=False)
class _Picture:
    """A picture that was asked for, and what it shows."""

    name: str
    source: PictureSource


class EarlyPictures:
    """Pictures of a run, drawn by further processes while the run goes on, and by twins of theirs when its verdicts are made.

    Parameters
    ----------
    processes : sequence of PictureProcess
        Each draws one picture after the other, until the block ends.
    estimators : sequence of str
        Of the run.
    """

    def __init__(self, processes: Sequence[PictureProcess], estimators: Sequence[str]) -> None:
        self.processes = processes
        self._twins = [process.twin for process in processes if process.twin is not None]
        self._estimators = estimators
        self._shown = {
            name: shown for shown, names in early_pictures(estimators, estimators) for name in names
        }
        self._changed, self._has_ended = threading.Condition(), False
        # What follows is read and changed while `_changed` is held.
        self._waiting: deque[_Picture] = deque()
        self._begun: dict[Painter, _Picture] = {}
        self._drawn: dict[_Picture, bytes] = {}
        self._serving = 0
        self._start(processes)

    def __enter__(self) -> "EarlyPictures":
        return self

    def __exit__(self, *_: object) -> None:
        with self._changed:
            self._has_ended = True
            self._changed.notify_all()

    def take(
        self,
        setup: Setup,
        evaluations: Sequence[Evaluation],
        maps: Mapping[str, Float[np.ndarray, "k 3"]],
    ) -> None:
        """Have drawn what shows the estimates made so far (`spinfilters.run.estimation.OnEstimate`)."""
        made = [each.name for each in evaluations]
        figure_data = FigureData(setup.dataset, tuple(evaluations), maps.get(made[0]))
        if not self.processes or not _can_be_sent(figure_data):
            return
        ready = {name for _, names in early_pictures(self._estimators, made) for name in names}
        possible = [name for name in _files_of(figure_data) if name in ready]
        with self._changed:
            offered = {each.name for each in self._every()}
            source = PictureSource(figure_data)
            self._waiting.extend(_Picture(name, source) for name in possible if name not in offered)
            self._changed.notify_all()

    def take_all(self, figure_data: FigureData, folder: Path | None = None) -> None:
        """Have drawn all pictures of a run whose verdicts are made, but those that show its estimates already.

        Parameters
        ----------
        folder : Path or None
            Where the run is written, for data that are too large to be sent; None as long as it is not.
        """
        source = PictureSource(figure_data) if _can_be_sent(figure_data) else PictureSource(folder=folder)
        with self._changed:
            valid = {
                each
                for each in self._every()
                if each.source.is_same(source) or self._is_of(each, figure_data)
            }
            names = {each.name for each in valid}
            missing = [name for name in _files_of(figure_data) if name not in names]
            # The summary is among the missing ones, and takes longest of what is left.
            is_there = source.figure_data is not None or folder is not None
            first = [_Picture(name, source) for name in missing] if is_there else []
            self._waiting = deque([*first, *(each for each in self._waiting if each in valid)])
            self._begun = {process: each for process, each in self._begun.items() if each in valid}
            self._drawn = {each: content for each, content in self._drawn.items() if each in valid}
            self._start(self._twins)
            self._twins.clear()
            self._changed.notify_all()

    def next_drawn(self) -> "tuple[str, bytes | None] | None":
        """The next picture of all that were taken, when it is drawn.

        Returns
        -------
        tuple of str and (bytes or None), or None
            Name and content; no content where this process is to draw it, because several others wait. None where no picture is
            left, or where the process that draws the last ones gives no answer.
        """
        with self._changed:
            self._changed.wait_for(
                lambda: self._drawn or self._is_for_this or not self._begun, LONGEST_PICTURE
            )
            if self._drawn:
                picture, content = self._drawn.popitem()
                return picture.name, content
            return (self._waiting.pop().name, None) if self._waiting else None

    @property
    def _is_for_this(self) -> bool:
        """Whether so many pictures wait that this process draws one, too.

        The others draw some while it loads what draws, if it has yet to.
        """
        is_loaded = "matplotlib.figure" in sys.modules
        return len(self._waiting) > (0 if is_loaded else DRAWN_WHILE_LOADING * self._serving)

    def _every(self) -> Iterator[_Picture]:
        yield from self._waiting
        yield from self._begun.values()
        yield from self._drawn

    def _is_of(self, picture: _Picture, final: FigureData) -> bool:
        """Whether a picture of early data shows estimates alone, and those of the run."""
        shown = picture.source.figure_data
        if shown is None or picture.name not in self._shown:
            return False
        early, late = ({each.name: each for each in data.evaluations} for data in (shown, final))
        return all(early[name].has_estimates_of(late[name]) for name in self._shown[picture.name])

    def _start(self, painters: Sequence[Painter]) -> None:
        """Let these draw, too."""
        self._serving += len(painters)
        for painter in painters:
            threading.Thread(target=self._serve, args=(painter,), daemon=True).start()

    def _serve(self, process: Painter) -> None:
        """Hand pictures to a process as they come, while it draws them."""
        content: bytes | None = b""
        while content is not None:
            with self._changed:
                self._changed.wait_for(lambda: self._has_ended or self._waiting)
                if self._has_ended:
                    return
                picture = self._begun[process] = self._waiting.popleft()
            content = process.drawn(picture.name, picture.source)
            with self._changed:
                wanted = self._begun.pop(process, None) is picture
                if content is None:
                    self._serving -= 1
                    self._waiting.extendleft([picture] if wanted else [])
                elif wanted:
                    self._drawn[picture] = content
                self._changed.notify_all()


def _can_be_sent(figure_data: FigureData) -> bool:
    return sum(each.history.factor.nbytes for each in figure_data.evaluations) <= LARGEST_SENT


def _files_of(figure_data: FigureData) -> list[str]:
    """Files of all pictures of a run."""
    return [f"{name}.png" for name in figure_names(figure_data)]


def draw_together(
    figure_data: FigureData,
    folder: Path,
    progress: Callable[[int, int], None],
    early: EarlyPictures,
) -> list[str]:
    """Bring all pictures of a written run into its folder, those drawn early and all others; names of the files.

    Others are drawn here and by the processes of `early`. Errors: `draw_run`.
    """
    names, written = _files_of(figure_data), list[str]()

    def write(name: str, content: bytes | None = None) -> None:
        """Write a picture, drawn here where it has no content yet."""
        progress(len(written), len(names))
        if content is None:
            draw_run(figure_data, folder, lambda *_: None, [name])
        else:
            write_bytes(folder / name, content)
        written.append(name)

    early.take_all(figure_data, folder)
    while (picture := early.next_drawn()) is not None:
        write(*picture)
    for name in names:
        if name not in written:
            write(name)
    progress(len(names), len(names))
    return names
