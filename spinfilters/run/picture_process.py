"""Pictures of a run by further processes, which draw what is known while the estimators run.

A process is sent data and the names of pictures, one at a time. What shows estimates alone is drawn as soon as these are made, and
kept there until the run is written. All other pictures are drawn from the run folder. Whatever ends a process early, the one that
asked draws what is missing, and meets and reports the cause itself.
"""

import json
import os
import subprocess
import sys
import tempfile
import threading
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from jaxtyping import Float

from spinfilters.core.errors import InputError
from spinfilters.evaluation.estimator_evaluation import Evaluation
from spinfilters.inference.setup import Setup
from spinfilters.io.output_files import write_bytes
from spinfilters.io.stated_values import NumberRange
from spinfilters.plots.figures import FigureData, draw_run, drawn_pictures, early_pictures, figure_names
from spinfilters.run.run_folder import read_estimates, read_figure_data, write_estimates

MOST_PROCESSES: Final = 3
"""In addition to the one that asks; a run has about ten pictures."""
PROCESSES: Final = "SPINFILTERS_PICTURE_PROCESSES"
"""Environment variable that states another number, 0 for none."""
STATED_PROCESSES: Final = NumberRange(0, 99, whole=True)
LAST_PICTURE: Final = 5.0
"""Seconds that a process which is ended has for the picture at which it is, so that no half file stays."""
LONGEST_PICTURE: Final = 60.0
"""Seconds that a picture of another process may still take where no further one is left to draw."""
LARGEST_SENT: Final = 32_000_000
"""Bytes of covariances that are sent to another process; pictures of more are drawn from the run folder."""
DRAWN_WHILE_LOADING: Final = 2
"""Pictures that a process draws while another one loads what draws."""
_ENVIRONMENT: Final = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MPLBACKEND": "agg"}
_READY: Final = b"ready\n"


class PictureProcess:
    """A process that draws pictures of a run on request.

    It ends with its input, hence with the process that started it.
    """

    def __init__(self) -> None:
        paths = [str(Path(__file__).parents[2]), *filter(None, [os.environ.get("PYTHONPATH")])]
        self._process = subprocess.Popen(
            [sys.executable, "-m", __name__],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env={**_ENVIRONMENT, **os.environ, "PYTHONPATH": os.pathsep.join(paths)},
            start_new_session=True,  # Ctrl-C is for the process that asked
        )
        self._is_writing = False

    def open(self, folder: Path) -> bool:
        """Whether it has read a run folder; waits until what draws is loaded."""
        return self._answers("open", _text(folder))

    def draw(self, name: str) -> bool:
        """Whether it has drawn a picture of that folder."""
        return self._writes("draw", name)

    def keep(self, folder: Path, estimators: Sequence[str], name: str) -> bool:
        """Whether it has drawn a picture of these estimators of a folder of `write_estimates`, which it keeps."""
        return self._answers("keep", _text(folder), *estimators, name)

    def write(self, name: str, folder: Path) -> bool:
        """Whether it has written a picture that it kept."""
        return self._writes("write", name, _text(folder))

    def close(self) -> None:
        """End it, at once or after the picture that it writes."""
        process = self._process
        assert process.stdin is not None
        assert process.stdout is not None
        with suppress(OSError):
            process.stdin.close()
        with suppress(subprocess.TimeoutExpired):
            process.wait(LAST_PICTURE if self._is_writing else 0.0)
        process.kill()
        process.wait()
        process.stdout.close()

    def _writes(self, *request: str) -> bool:
        """Whether it has answered a request that writes a file."""
        self._is_writing = True
        done = self._answers(*request)
        self._is_writing = False
        return done

    def _answers(self, *request: str) -> bool:
        stdin, stdout = self._process.stdin, self._process.stdout
        assert stdin is not None
        assert stdout is not None
        try:
            stdin.write(json.dumps(request).encode() + b"\n")
            stdin.flush()
            return stdout.readline(len(_READY)) == _READY
        except (OSError, ValueError):  # it has ended, or was ended
            return False


def _text(folder: Path) -> str:
    """A folder for a process whose working directory may be another."""
    return os.fspath(folder.absolute())


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
            for _ in range(count):
                processes.append(PictureProcess())
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


class _Kept(NamedTuple):
    """A picture that a process draws or has drawn, and of which data."""

    figure_data: FigureData
    process: PictureProcess


class EarlyPictures:
    """Pictures of estimates, drawn by further processes while the run goes on.

    Parameters
    ----------
    processes : sequence of PictureProcess
        Each draws one picture after the other, until the block ends or `end` is called.
    estimators : sequence of str
        Of the run.
    """

    def __init__(self, processes: Sequence[PictureProcess], estimators: Sequence[str]) -> None:
        self.processes = processes
        self._estimators = estimators
        self._offered: set[str] = set()
        self._waiting: deque[tuple[FigureData, str]] = deque()
        self._kept: dict[str, _Kept] = {}
        self._one_writes = threading.Lock()
        self._folder: tempfile.TemporaryDirectory[str] | None = None
        self._changed, self._has_ended = threading.Condition(), False
        self._threads = {
            process: threading.Thread(target=self._serve, args=(process,), daemon=True)
            for process in processes
        }
        for thread in self._threads.values():
            thread.start()

    def __enter__(self) -> "EarlyPictures":
        return self

    def __exit__(self, *_: object) -> None:
        self._stop()
        with self._one_writes, suppress(OSError):
            if self._folder is not None:
                self._folder.cleanup()

    def take(
        self,
        setup: Setup,
        evaluations: Sequence[Evaluation],
        maps: Mapping[str, Float[np.ndarray, "k 3"]],
    ) -> None:
        """Have drawn what shows the estimates made so far (`spinfilters.run.estimation.OnEstimate`)."""
        if not self._threads or sum(each.history.factor.nbytes for each in evaluations) > LARGEST_SENT:
            return
        made = {each.name: each for each in evaluations}
        for shown, names in early_pictures(self._estimators, list(made)):
            new = [name for name in names if name not in self._offered]
            if not new:
                continue
            self._offered.update(new)
            figure_data = FigureData(setup.dataset, [made[name] for name in shown], maps.get(shown[0]))
            with self._changed:
                self._waiting.extend((figure_data, name) for name in new)
                self._changed.notify_all()

    def end(self, figure_data: FigureData) -> dict[PictureProcess, list[str]]:
        """Begin no further one; names by process of those that it keeps, or is about to keep, and that show these estimates."""
        self._stop()
        final = {each.name: each for each in figure_data.evaluations}
        found: dict[PictureProcess, list[str]] = {process: [] for process in self.processes}
        for name, (early, process) in self._kept.items():
            if all(each.has_estimates_of(final[each.name]) for each in early.evaluations):
                found[process].append(name)
        return found

    def wait_for(self, process: PictureProcess) -> None:
        """Wait until a process has ended the picture at which it is."""
        self._threads[process].join()

    def _stop(self) -> None:
        with self._changed:
            self._has_ended = True
            self._waiting.clear()
            self._changed.notify_all()

    def _serve(self, process: PictureProcess) -> None:
        """Hand pictures to a process as they come, while it draws them."""
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._has_ended or self._waiting)
                if self._has_ended:
                    return
                figure_data, name = self._waiting.popleft()
                self._kept[name] = _Kept(figure_data, process)
            if not self._is_kept(process, figure_data, name):
                return

    def _is_kept(self, process: PictureProcess, figure_data: FigureData, name: str) -> bool:
        """Whether a process has drawn a picture of these data, which go through files."""
        try:
            with self._one_writes:
                self._folder = self._folder or tempfile.TemporaryDirectory(prefix="spinfilters-")
                folder = Path(self._folder.name)
                write_estimates(folder, figure_data)
        except (InputError, OSError):  # no room: all is drawn when the run is written
            return False
        return process.keep(folder, [each.name for each in figure_data.evaluations], name)


def draw_together(
    figure_data: FigureData,
    folder: Path,
    progress: Callable[[int, int], None],
    early: EarlyPictures,
) -> list[str]:
    """Bring all pictures of a written run into its folder, those drawn early and all others; names of the files.

    Others are drawn here and by the processes of `early`. Errors: `draw_run`.
    """
    names = [f"{name}.png" for name in figure_names(figure_data)]
    kept = {
        process: [name for name in every if name in names]
        for process, every in early.end(figure_data).items()
    }
    left = deque(name for name in names if not any(name in every for every in kept.values()))
    drawn, processes = list[str](), early.processes

    def report() -> None:
        progress(len(drawn), len(names))

    def draw_elsewhere(process: PictureProcess) -> None:
        """Let a process write what it keeps, then hand it pictures, from the last on, while it draws them."""
        early.wait_for(process)
        for name in kept[process]:
            (drawn if process.write(name, folder) else left).append(name)
        if not left or not process.open(folder):
            return
        while left:
            try:
                name = left.pop()
            except IndexError:
                return
            if not process.draw(name):
                left.append(name)
                return
            drawn.append(name)

    threads = [threading.Thread(target=draw_elsewhere, args=(process,), daemon=True) for process in processes]
    for thread in threads:
        thread.start()
    try:
        _draw_here(figure_data, folder, left, drawn, report, _worth_drawing(processes))
        for process, thread in zip(processes, threads, strict=True):
            thread.join(LONGEST_PICTURE)
            process.close()  # a thread that still waits for an answer gets none, and gives its picture back
            thread.join()
        _draw_here(figure_data, folder, left, drawn, report)
    finally:
        left.clear()
    progress(len(names), len(names))
    return names


def _worth_drawing(processes: Sequence[PictureProcess]) -> int:
    """Pictures that must be left for this process to draw one: the others do them while it loads what draws, if it has yet to."""
    return 1 if "matplotlib.figure" in sys.modules else 1 + DRAWN_WHILE_LOADING * len(processes)


def _draw_here(
    figure_data: FigureData,
    folder: Path,
    left: deque[str],
    drawn: list[str],
    report: Callable[[], None],
    fewest: int = 1,
) -> None:
    """Draw what is left, from the first on, while there are at least so many."""
    while len(left) >= fewest:
        try:
            name = left.popleft()
        except IndexError:  # another took the last
            return
        report()
        draw_run(figure_data, folder, lambda *_: None, [name])
        drawn.append(name)


class _Painter:
    """What a picture process does, request by request (`PictureProcess`)."""

    def __init__(self) -> None:
        self._run: FigureData | None = None
        self._folder = Path()
        self._estimates: FigureData | None = None
        self._kept: dict[str, bytes] = {}

    def open(self, folder: str) -> None:
        """Read a run folder."""
        self._folder, self._run = Path(folder), read_figure_data(Path(folder))

    def draw(self, name: str) -> None:
        """Draw a picture of the run into its folder."""
        assert self._run is not None
        draw_run(self._run, self._folder, lambda *_: None, [name])

    def keep(self, folder: str, *names: str) -> None:
        """Draw a picture of some estimators, whose names stand before its own, and keep it."""
        *estimators, name = names
        self._estimates = read_estimates(Path(folder), estimators, self._estimates)
        self._kept.update(drawn_pictures(self._estimates, lambda *_: None, [name]))

    def write(self, name: str, folder: str) -> None:
        """Write a picture that was kept into a folder."""
        write_bytes(Path(folder) / name, self._kept.pop(name))


def main() -> None:
    """Load what draws, then do what the input asks for: lines of JSON, each a request and what it is about."""
    from spinfilters.plots.style import note_figure, picture_bytes

    lines = iter(sys.stdin.buffer)
    with suppress(KeyboardInterrupt, BrokenPipeError):
        from spinfilters.plots import scene, summary, time_courses  # noqa: F401 - loaded while the first estimator runs

        picture_bytes(note_figure("fonts are found and loaded"), "png", dpi=50)
        painter = _Painter()
        requests: dict[str, Callable[..., None]] = {
            "open": painter.open,
            "draw": painter.draw,
            "keep": painter.keep,
            "write": painter.write,
        }
        for line in lines:
            request, *about = json.loads(line)
            requests[request](*about)
            sys.stdout.buffer.write(_READY)
            sys.stdout.buffer.flush()


if __name__ == "__main__":
    main()
