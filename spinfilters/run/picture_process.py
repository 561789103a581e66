"""Pictures of a run by further processes, which load what draws while the estimators run.

A process is sent a run folder and then the names of pictures, one at a time. Whatever ends it early, the process that asked draws
what is missing, and meets and reports the cause itself.
"""

import json
import os
import subprocess
import sys
import threading
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final

from spinfilters.core.errors import InputError
from spinfilters.io.stated_values import NumberRange
from spinfilters.plots.figures import FigureData, draw_run, figure_names
from spinfilters.run.run_folder import read_figure_data

MOST_PROCESSES: Final = 3
"""In addition to the one that asks; a run has about ten pictures."""
PROCESSES: Final = "SPINFILTERS_PICTURE_PROCESSES"
"""Environment variable that states another number, 0 for none."""
STATED_PROCESSES: Final = NumberRange(0, 99, whole=True)
LAST_PICTURE: Final = 5.0
"""Seconds that a process which is ended has for the picture at which it is, so that no half file stays."""
LONGEST_PICTURE: Final = 60.0
"""Seconds that a picture of another process may still take where no further one is left to draw."""
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
        self._is_drawing = False

    def open(self, folder: Path) -> bool:
        """Whether it has read a run folder; waits until what draws is loaded."""
        return self._answers(os.fspath(folder.absolute()))

    def draw(self, name: str) -> bool:
        """Whether it has drawn a picture of that folder."""
        self._is_drawing = True
        done = self._answers(name)
        self._is_drawing = False
        return done

    def close(self) -> None:
        """End it, at once or behind the picture at which it is."""
        process = self._process
        assert process.stdin is not None
        assert process.stdout is not None
        with suppress(OSError):
            process.stdin.close()
        with suppress(subprocess.TimeoutExpired):
            process.wait(LAST_PICTURE if self._is_drawing else 0.0)
        process.kill()
        process.wait()
        process.stdout.close()

    def _answers(self, text: str) -> bool:
        stdin, stdout = self._process.stdin, self._process.stdout
        assert stdin is not None
        assert stdout is not None
        try:
            stdin.write(json.dumps(text).encode() + b"\n")
            stdin.flush()
            return stdout.readline(len(_READY)) == _READY
        except (OSError, ValueError):  # it has ended, or was ended
            return False


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


def draw_together(
    figure_data: FigureData,
    folder: Path,
    progress: Callable[[int, int], None],
    processes: Sequence[PictureProcess],
) -> list[str]:
    """Draw all pictures of a written run here and by these processes; names of the files. Errors: `draw_run`."""
    names = [f"{name}.png" for name in figure_names(figure_data)]
    left, drawn = deque(names), list[str]()

    def draw_elsewhere(process: PictureProcess) -> None:
        """Hand pictures to a process, from the last on, while it draws them."""
        if not process.open(folder):
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
        _draw_here(figure_data, folder, left, drawn, lambda: progress(len(drawn), len(names)))
        for process, thread in zip(processes, threads, strict=True):
            thread.join(LONGEST_PICTURE)
            process.close()  # a thread that still waits for an answer gets none, and gives its picture back
            thread.join()
        _draw_here(figure_data, folder, left, drawn, lambda: progress(len(drawn), len(names)))
    finally:
        left.clear()
    progress(len(names), len(names))
    return names


def _draw_here(
    figure_data: FigureData, folder: Path, left: deque[str], drawn: list[str], report: Callable[[], None]
) -> None:
    """Draw what is left, from the first on."""
    while left:
        try:
            name = left.popleft()
        except IndexError:  # another took the last
            return
        report()
        draw_run(figure_data, folder, lambda *_: None, [name])
        drawn.append(name)


def main() -> None:
    """Load what draws, then draw what the input names: a run folder, and pictures of it."""
    from spinfilters.plots.style import note_figure, picture_bytes

    lines = iter(sys.stdin.buffer)
    with suppress(KeyboardInterrupt, BrokenPipeError):
        for module in ("energies", "scene", "summary", "time_courses"):
            __import__(f"spinfilters.plots.{module}")
        picture_bytes(note_figure("fonts are found and loaded"), "png", dpi=50)
        folder: Path | None = None
        figure_data: FigureData | None = None
        for line in lines:
            text = json.loads(line)
            if folder is None or figure_data is None:
                folder = Path(text)
                figure_data = read_figure_data(folder)
            else:
                draw_run(figure_data, folder, lambda *_: None, [text])
            sys.stdout.buffer.write(_READY)
            sys.stdout.buffer.flush()


if __name__ == "__main__":
    main()
