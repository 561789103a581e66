"""Ctrl-C of a command: noted when pressed, raised where it is not lost, and raised again where it was.

Python cannot raise in a finalizer or in a callback of C: it hands the exception to a hook and goes on. The hook presses again a
little later. CasADi asks Python methods for shapes and values while it converts arguments, and drops whatever these raise: there a
Ctrl-C waits until the call is over. A library may take a Ctrl-C for an error of its own; live runs therefore ask at every epoch
whether it was pressed.
"""

import signal
import sys
from _thread import interrupt_main
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from threading import Timer, current_thread, main_thread
from types import FrameType
from typing import TYPE_CHECKING, Final, TypeVar

if TYPE_CHECKING:
    from sys import UnraisableHookArgs


T = TypeVar("T")
INTERRUPTED: Final = "interrupted; nothing unfinished is left behind, run the command again"
_pressed: list[int] = []
"""Not empty once Ctrl-C was pressed in the command that runs."""


AGAIN_S: Final = 0.1
"""Until a lost Ctrl-C is pressed again: long enough for a finalizer to end."""
CALL_S: Final = 0.01
"""Until a Ctrl-C that came within a call of CasADi is pressed again: most calls take less."""
LOSES: Final = "casadi"
"""Package that drops the errors of Python methods that it calls."""


@contextmanager
def noted_interrupts() -> Iterator[list[int]]:
    """Note every Ctrl-C, which a library may swallow; each is raised, within a call of CasADi when that is over."""
    _pressed.clear()
    again = list[Timer]()

    def press_again(seconds: float) -> None:
        """Press Ctrl-C once more, so many seconds later."""
        again.append(Timer(seconds, interrupt_main))
        again[-1].daemon = True
        again[-1].start()

    def noted(number: int, frame: FrameType | None) -> None:
        """Note a Ctrl-C and raise it, later where it would be lost."""
        _pressed.append(number)
        if _would_be_lost(frame):
            press_again(CALL_S)
        else:
            signal.default_int_handler(number, frame)

    if (
        signal.getsignal(signal.SIGINT) is not signal.default_int_handler
        or current_thread() is not main_thread()
    ):
        yield _pressed
        return
    shown = sys.unraisablehook

    def quiet_of_interrupts(lost: "UnraisableHookArgs") -> None:
        """Say what Python cannot raise, but for a Ctrl-C: no trace of that is for the user, and it is pressed again."""
        if issubclass(lost.exc_type, KeyboardInterrupt):
            press_again(AGAIN_S)
        else:
            shown(lost)

    signal.signal(signal.SIGINT, noted)
    sys.unraisablehook = quiet_of_interrupts
    try:
        yield _pressed
    finally:
        for timer in again:
            timer.cancel()
        sys.unraisablehook = shown
        signal.signal(signal.SIGINT, signal.default_int_handler)
        if _pressed:
            from dataclasses import make_dataclass

            # Python notes a Ctrl-C that hits while a dataclass is made, and ends ``python -m`` as by a signal: the next one
            # clears that
            make_dataclass("Cleared", ())


def _would_be_lost(frame: FrameType | None) -> bool:
    """Whether a frame, or one that has called it, is of the package that drops errors."""
    while frame is not None:
        if str(frame.f_globals.get("__name__", "")).partition(".")[0] == LOSES:
            return True
        frame = frame.f_back
    return False


def require_uninterrupted() -> None:
    """Raise a Ctrl-C that was pressed and got lost. KeyboardInterrupt: there was one."""
    if _pressed:
        raise KeyboardInterrupt


def until_interrupted(items: Iterable[T]) -> Iterator[T]:
    """The items, until Ctrl-C is pressed, even where that gets lost. KeyboardInterrupt: it was."""
    for item in items:
        require_uninterrupted()
        yield item
