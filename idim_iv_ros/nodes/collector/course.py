"""The course of one goal: what is done now, what is said of it, and why it is to end."""

import threading
import time
from collections.abc import Callable

from idim_iv_ros.errors import DataError, IdimError, UsageError
from idim_iv_ros.nodes.entry import Result, in_thread

LOOK = 0.02  # s between two looks at the robot
_SIGN_OF_LIFE = 0.5  # s between two words on what is done

Say = Callable[[str, float, float, str], None]


class Course:
    """Passes the time for a collection, and raises in it what ends it.

    Parameters
    ----------
    timeout
        s from now.
    allowed
        Whether the robot may be moved.
    gone
        Whether nobody waits for the goal any more.
    say
        Takes stage, share done, largest tracking error so far in the stage and its joint.

    Attributes
    ----------
    done, whole : float
        Expected duration of what is done, and of all, s.
    trouble : callable
        Says what else ends the course; empty if all is well.
    """

    def __init__(
        self,
        timeout: float,
        allowed: Callable[[], bool],
        gone: Callable[[], bool],
        say: Say,
    ) -> None:
        self._timeout, self._deadline = timeout, time.monotonic() + timeout
        self._allowed, self._gone, self._say = allowed, gone, say
        self._cancelled = ""
        self._stage, self._worst, self._joint = "", 0.0, ""
        self._said = 0.0
        self.done, self.whole = 0.0, 1.0
        self.trouble: Callable[[], str] = str

    def cancel(self, why: str) -> None:
        """End the course; in any thread."""
        self._cancelled = self._cancelled or why

    def reason_to_end(self) -> str:
        """Why nothing more is to be done; empty if all is well."""
        if self._cancelled:
            return self._cancelled
        if not self._allowed():
            return "allow_motion was set to false"
        if time.monotonic() > self._deadline:
            return f"not finished within {self._timeout:g} s"
        if self._gone():
            return "who asked is gone"
        return self.trouble()

    def begin(self, stage: str) -> None:
        """Say what is done from now on."""
        self._stage, self._worst, self._joint = stage, 0.0, ""
        self._speak(at_once=True)

    def deviates(self, size: float, joint: str) -> None:
        """Keep the largest tracking error of the stage, rad (m)."""
        if size > self._worst:
            self._worst, self._joint = size, joint

    def proceed(self, done: float, stage: str = "") -> None:
        """Say from time to time how far it is; a stage of somebody else at once.

        Parameters
        ----------
        done
            Expected duration of what is done, s.
        """
        self.done = done
        self._stage = stage or self._stage
        self._speak(at_once=bool(stage))

    def tick(self) -> None:
        """Let a little time pass.

        Raises
        ------
        DataError
            Nothing more is to be done, and why.
        """
        time.sleep(LOOK)
        reason = self.reason_to_end()
        if reason:
            raise DataError(reason)
        self._speak()

    def pause(self, seconds: float) -> None:
        """Let some time pass."""
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            self.tick()

    def wait(self, holds: Callable[[], bool], seconds: float, what: str) -> None:
        """Wait until something holds.

        Raises
        ------
        UsageError
            It took too long; `what` says what is waited for.
        """
        _wait(holds, seconds, what, self.tick)

    def compute(
        self, compute: Callable[[Callable[[str, float], None]], Result], expected: float
    ) -> Result:
        """Compute in another thread, so that what happens meanwhile is noticed.

        Parameters
        ----------
        compute
            Takes where it reports its progress, which raises when it is to end.
        expected
            Its duration, in the unit of `whole`.
        """
        begun = self.done
        given_up = threading.Event()

        def look(stage: str, share: float) -> None:
            if given_up.is_set():
                raise UsageError("given up")
            self.done = max(self.done, begun + share * expected)

        answer = in_thread(lambda: compute(look), "computation")
        try:
            while not answer.done():
                self.tick()
        except IdimError:
            given_up.set()
            raise
        self.done = begun + expected
        return answer.result()

    def _speak(self, at_once: bool = False) -> None:
        now = time.monotonic()
        if at_once or now > self._said + _SIGN_OF_LIFE:
            self._said = now
            self._say(self._stage, min(self.done / self.whole, 1.0), self._worst, self._joint)


def wait_whatever_happens(holds: Callable[[], bool], seconds: float, what: str) -> None:
    """Wait as `Course.wait` for what has to be done in any case: a bag that is open is closed."""
    _wait(holds, seconds, what, lambda: time.sleep(LOOK))


def _wait(holds: Callable[[], bool], seconds: float, what: str, tick: Callable[[], None]) -> None:
    until = time.monotonic() + seconds
    while not holds():
        tick()
        if time.monotonic() > until:
            raise UsageError(f"{what} did not come within {seconds:g} s")
