"""Writer of answers in its own thread.

A slow reader blocks no filter.
"""

import queue
import threading
from contextlib import suppress
from typing import TextIO

from spinfilters.live.answer import Answer, write_answer

MOST_WAITING = 1000
"""Answers that may wait to be read; what comes after that is not written."""
LAST_SECONDS = 2.0
"""For the answers that still wait in the end."""


class AnswerWriter:
    """Writes answers in their order.

    Attributes
    ----------
    dropped: answers that were not written, because too many waited.   broken: whether nobody reads any more.
    """

    def __init__(self, style: str, stream: TextIO) -> None:
        self._style, self._stream = style, stream
        self._waiting: queue.Queue[Answer | None] = queue.Queue(MOST_WAITING)
        self.dropped, self.broken = 0, False
        self._thread = threading.Thread(target=self._work, daemon=True)
        self._thread.start()

    def write(self, answer: Answer) -> None:
        """Queue an answer for writing, without waiting.

        Raises
        ------
        BrokenPipeError: nobody reads any more.
        """
        if self.broken:
            raise BrokenPipeError
        try:
            self._waiting.put_nowait(answer)
        except queue.Full:
            self.dropped += 1

    def close(self) -> None:
        """Write the queued answers, with a time limit."""
        with suppress(queue.Full):
            self._waiting.put(None, timeout=LAST_SECONDS)
        self._thread.join(LAST_SECONDS)
        self.dropped += max(self._waiting.qsize() - 1, 0) if self._thread.is_alive() else 0

    def _work(self) -> None:
        while (answer := self._waiting.get()) is not None:
            try:
                write_answer(answer, self._style, self._stream)
            except (BrokenPipeError, ValueError):
                self.broken = True
                return
