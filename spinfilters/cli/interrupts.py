"""Ctrl-C of a command: noted when pressed, raised as ever, and raised again where it was lost.

Python cannot raise in a finalizer or in a callback of C: it hands the exception to a hook and goes on. The hook presses again a
little later. A library may take a Ctrl-C for an error of its own; live runs therefore ask at every epoch whether it was pressed.
"""

import signal
import sys
from _thread import interrupt_main
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import make_dataclass
from threading import Timer, current_thread, main_thread
from types import FrameType
from typing import TYPE_CHECKING, Final, TypeVar

if TYPE_CHECKING:
    from sys import UnraisableHookArgs


T = TypeVar("T")
_pressed: list[int] = []
"""Not empty once Ctrl-C was pressed in the command that runs."""


AGAIN_S: Final = 0.1
"""Until a lost Ctrl-C is pressed again: long enough for a finalizer to end."""


@contextmanager
def noted_interrupts() -> Iterator[list[int]]:
    """Note every Ctrl-C, which a library may swallow; each is raised as ever."""
    _pressed.clear()

    def noted(number: int, frame: FrameType | None) -> None:
        """Note a Ctrl-C and raise it."""
        _pressed.append(number)
        signal.default_int_handler(number, frame)

    if (
        signal.getsignal(signal.SIGINT) is not signal.default_int_handler
        or current_thread() is not main_thread()
    ):
        yield _pressed
        return
    shown, again = sys.unraisablehook, list[Timer]()

    def quiet_of_interrupts(lost: "UnraisableHookArgs") -> None:
        """Say what Python cannot raise, but for a Ctrl-C: no trace of that is for the user, and it is pressed again."""
        if not issubclass(lost.exc_type, KeyboardInterrupt):
            shown(lost)
            return
        again.append(Timer(AGAIN_S, interrupt_main))
        again[-1].daemon = True
        again[-1].start()

    signal.signal(signal.SIGINT, noted)
    sys.unraisablehook = quiet_of_interrupts
    try:
        yield _pressed
    finally:
        for timer in again:
            timer.cancel()
        sys.unraisablehook = shown
        signal.signal(signal.SIGINT, signal.default_int_handler)
        # Python notes a Ctrl-C that hits while a dataclass is made, and ends ``python -m`` as by a signal; the next one clears that
        make_dataclass("Cleared", ())


def require_uninterrupted() -> None:
    """Raise a Ctrl-C that was pressed and got lost. KeyboardInterrupt: there was one."""
    if _pressed:
        raise KeyboardInterrupt


def until_interrupted(items: Iterable[T]) -> Iterator[T]:
    """The items, until Ctrl-C is pressed, even where that gets lost. KeyboardInterrupt: it was."""
    for item in items:
        require_uninterrupted()
        yield item
