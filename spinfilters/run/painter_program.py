"""The program of a picture process (`spinfilters.run.picture_process`), which answers requests with the contents of files."""

import gc
import os
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from spinfilters.plots.figures import FigureData, drawn_pictures

# what reads a run folder loads every reader and estimator: it is imported where it is needed, which is rarely


class _Work:
    """What the process does, request by request."""

    def __init__(self) -> None:
        self._parts: list[Any] = []
        self._shown: FigureData | None = None

    def show(
        self,
        new: Sequence[Any],
        places: Sequence[int],
        map_points: Float[np.ndarray, "k 3"] | None,
        conditions: Sequence[str],
    ) -> bytes:
        """Take data: new parts, and the places of all that are shown among the parts sent so far."""
        self._parts += new
        dataset, *evaluations = (self._parts[place] for place in places)
        self._shown = FigureData(dataset, evaluations, map_points, conditions)
        return b""

    def open(self, folder: str) -> bytes:
        """Read a run folder."""
        from spinfilters.run.run_folder import read_figure_data

        self._shown = read_figure_data(Path(folder))
        return b""

    def draw(self, name: str) -> bytes:
        """Content of a picture's file."""
        assert self._shown is not None
        ((_, content),) = drawn_pictures(self._shown, lambda *_: None, [name])
        return content


def main() -> None:
    """Load what draws, then do what the socket at its input asks for: requests, each with what it is about."""
    gc.disable()  # all that is loaded stays; after every picture garbage is looked for anyway
    from spinfilters.plots.style import picture_bytes

    with suppress(KeyboardInterrupt, BrokenPipeError, EOFError):
        # loaded while the first estimator runs
        from spinfilters.plots import scene, summary, time_courses  # noqa: F401

        figure, _ = scene.space_figure(2.0, 2.0)
        figure.suptitle(summary.RATIO_LABELS[0])
        picture_bytes(figure, "png", dpi=50)  # fonts are found, and what a first picture needs is loaded
        own = sys.stdin.fileno()
        for other in map(int, sys.argv[1:]):  # the place of a twin's connection
            is_twin = os.fork() == 0  # nothing else runs in this process
            os.close(own if is_twin else other)
            own = other if is_twin else own
        connection, painter = Connection(own), _Work()
        answer: dict[str, Callable[..., bytes]] = {
            "show": painter.show,
            "open": painter.open,
            "draw": painter.draw,
        }
        while True:
            request, *about = connection.recv()
            connection.send(answer[request](*about))


if __name__ == "__main__":
    main()
