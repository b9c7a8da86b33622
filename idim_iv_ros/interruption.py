"""Ctrl-C and other signals that end the command: what is unfinished is removed, and one line.

The exit status is that of a shell, 128 and the number of the signal.

Python's own answer, a KeyboardInterrupt, is swallowed by imports of extension modules, callbacks
from C and compilers: the handler below ends the process itself. What must not be left behind says
so with `undone_if_interrupted`; what must not be cut in two is done under `uninterrupted`.
"""

import os
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from types import FrameType
from typing import TypeVar

T = TypeVar("T")

STATUS = 130  # 128 + SIGINT
SIGNALS = {  # and what is said of them
    signal.SIGINT: "interrupted",
    signal.SIGTERM: "terminated",
    signal.SIGHUP: "the terminal is gone",
}

_undo: list[Callable[[], object]] = []
_words: list[Callable[[], str]] = []
_holding = 0
_waiting: int | None = None  # the signal that waits


def undone_if_interrupted(undo: Callable[[], object]) -> AbstractContextManager[None]:
    """Call `undo` before an interruption within the ``with`` ends the process."""
    return _listed(_undo, undo)


def said_if_interrupted(words: Callable[[], str]) -> AbstractContextManager[None]:
    """Say in the line of an interruption within the ``with`` what became of the work."""
    return _listed(_words, words)


@contextmanager
def _listed(calls: list[T], call: T) -> Iterator[None]:
    calls.append(call)
    try:
        yield
    finally:
        calls.remove(call)


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Let an interruption wait until the end of the ``with``; for what takes milliseconds."""
    global _holding
    _holding += 1
    try:
        yield
    finally:
        _holding -= 1
        if _waiting is not None and not _holding:
            _leave(_waiting)


@contextmanager
def interruption_ends_process() -> Iterator[None]:
    """Answer the signals as above within the ``with``; one that is ignored (nohup) stays so."""
    before = {number: signal.getsignal(number) for number in SIGNALS}
    for number, handler in before.items():
        if handler is not signal.SIG_IGN:
            signal.signal(number, _interrupted)
    try:
        yield
    finally:
        for number, handler in before.items():
            if signal.getsignal(number) is _interrupted:
                signal.signal(number, handler)


def _interrupted(number: int, frame: FrameType | None) -> None:
    """Answer a signal now, or when the last ``with`` that holds signals back has ended."""
    global _waiting
    if _holding:
        _waiting = number
    else:
        _leave(number)


def _leave(number: int) -> None:
    for ignored in SIGNALS:
        signal.signal(ignored, signal.SIG_IGN)
    said = "".join(f": {words()}" for words in _words)
    for undo in reversed(_undo):
        with suppress(Exception):
            undo()
    # On a terminal a progress bar may be there: its line is cleared and the cursor shown again.
    clear = b"\r\x1b[2K\x1b[?25h" if sys.__stderr__ and sys.__stderr__.isatty() else b""
    with suppress(OSError):
        os.write(2, clear + f"idim-iv: {SIGNALS[signal.Signals(number)]}{said}\n".encode())
    os._exit(128 + number)
