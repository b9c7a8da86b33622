"""Ctrl-C on the command line: what is unfinished is removed, one line, exit status 130.

Python's own answer, a KeyboardInterrupt, does not work everywhere: imports of extension modules,
callbacks from C and compilers swallow it, turn it into another error, or print its traceback. The
handler below therefore ends the process itself. What must not be left behind says so with
`undone_if_interrupted`; what must not be cut in two is done under `uninterrupted`.
"""

import os
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from types import FrameType

STATUS = 130  # of a shell: 128 + SIGINT

_undo: list[Callable[[], object]] = []
_words: list[Callable[[], str]] = []
_holding = 0
_waiting = False


@contextmanager
def undone_if_interrupted(undo: Callable[[], object]) -> Iterator[None]:
    """Call `undo` before an interruption within the ``with`` ends the process."""
    _undo.append(undo)
    try:
        yield
    finally:
        _undo.remove(undo)


@contextmanager
def said_if_interrupted(words: Callable[[], str]) -> Iterator[None]:
    """Say in the line of an interruption within the ``with`` what became of the work."""
    _words.append(words)
    try:
        yield
    finally:
        _words.remove(words)


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Let an interruption wait until the end of the ``with``; for what takes milliseconds."""
    global _holding
    _holding += 1
    try:
        yield
    finally:
        _holding -= 1
        if _waiting and not _holding:
            _leave()


@contextmanager
def interruption_ends_process() -> Iterator[None]:
    """Answer SIGINT as above within the ``with``; where it is ignored (nohup), it stays so."""
    before = signal.getsignal(signal.SIGINT)
    if before is not signal.SIG_IGN:
        signal.signal(signal.SIGINT, _interrupted)
    try:
        yield
    finally:
        if signal.getsignal(signal.SIGINT) is _interrupted:
            signal.signal(signal.SIGINT, before)


def _interrupted(number: int, frame: FrameType | None) -> None:
    global _waiting
    if _holding:
        _waiting = True
    else:
        _leave()


def _leave() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    said = "".join(f": {words()}" for words in _words)
    for undo in reversed(_undo):
        with suppress(Exception):
            undo()
    # On a terminal a progress bar may be there: its line is cleared and the cursor shown again.
    clear = b"\r\x1b[2K\x1b[?25h" if sys.__stderr__ and sys.__stderr__.isatty() else b""
    with suppress(OSError):
        os.write(2, clear + f"idim-iv: interrupted{said}\n".encode())
    os._exit(STATUS)
