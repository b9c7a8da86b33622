"""Does the robot follow?  What is measured beside what was asked for, when it should be there.

The controller begins some time after it was asked, which nobody says: until the robot moves, any
delay up to a limit is possible; then it is the one that fits best, and the robot must keep to it.
"""

from dataclasses import dataclass

import numpy as np

from idim_iv_ros.excitation import Trajectory
from idim_iv_ros.types import FloatArray

_SLACK = 0.1  # s around the delay that was found
_MOVED = 0.5  # of the allowed error: the robot has begun
_STEP = 0.01  # s between two delays that are tried
_UNSEEN = 1.0  # s that a motion is waited for which is too small to be seen


@dataclass(frozen=True)
class Deviation:
    """Largest distance from where the robot should be.

    Attributes
    ----------
    size : float
        rad (m).
    joint : str
        Where it is.
    """

    size: float
    joint: str


class Supervision:
    """Follows one trajectory.

    Parameters
    ----------
    motion : Trajectory
        What the robot was asked for.
    start : (n_joints,)
        Where it was then, rad (m).
    allowed : float
        Distance from which on it does not follow, rad (m).
    longest_delay : float
        Time until the controller begins at the latest, s.

    Attributes
    ----------
    delay : float or None
        Until the robot began to move, s; None before.
    """

    def __init__(
        self, motion: Trajectory, start: FloatArray, allowed: float, longest_delay: float
    ) -> None:
        self._motion, self._start = motion, start
        self._allowed, self._longest = allowed, longest_delay
        self.delay: float | None = None

    def look(self, elapsed: float, position: FloatArray) -> Deviation:
        """Compare a measured position (n_joints,) rad (m) with the motion.

        Parameters
        ----------
        elapsed
            Since the robot was asked, s.
        """
        moved = float(np.abs(position - self._start).max()) > _MOVED * self._allowed
        if self.delay is None and moved:
            _, self.delay = self._nearest(elapsed, position, 0.0, self._longest)
        if self.delay is None:
            low, high = 0.0, self._longest
        else:
            low, high = max(self.delay - _SLACK, 0.0), self.delay + _SLACK
        place, _ = self._nearest(elapsed, position, low, high)
        size = float(np.abs(position - place).max())
        # Which joint it is shows at the delay itself: the one that fits best makes them equal.
        due, _ = self._nearest(elapsed, position, self.delay or 0.0, self.delay or 0.0)
        return Deviation(size, self._motion.joints[int(np.argmax(np.abs(position - due)))])

    def ended(self, elapsed: float) -> bool:
        """Whether the robot should rest at the end by now."""
        delay = self._longest if self.delay is None else self.delay + _SLACK
        if self._motion_is_small():
            delay = min(delay, _UNSEEN)
        return elapsed > self._motion.duration + delay

    def planned(self, elapsed: float) -> tuple[FloatArray, FloatArray]:
        """Position and velocity (n_joints,) that the controller asks for now, rad, rad/s.

        Before the robot has begun, that is the beginning, at rest.
        """
        if self.delay is None:
            return self._motion.position[0], np.zeros_like(self._motion.velocity[0])
        sample = round((elapsed - self.delay) * self._motion.rate)
        sample = min(max(sample, 0), len(self._motion.position) - 1)
        return self._motion.position[sample], self._motion.velocity[sample]

    def _motion_is_small(self) -> bool:
        """Whether the robot could go through all of it without having moved, as seen here."""
        way = np.abs(self._motion.position - self._motion.position[0]).max()
        return bool(way <= _MOVED * self._allowed)

    def _nearest(
        self, elapsed: float, position: FloatArray, low: float, high: float
    ) -> tuple[FloatArray, float]:
        """Place of the motion that fits best among the delays, and that delay."""
        delays = low + _STEP * np.arange(round((high - low) / _STEP) + 1)
        samples = np.round((elapsed - delays) * self._motion.rate).astype(int)
        samples = np.clip(samples, 0, len(self._motion.position) - 1)
        places = self._motion.position[samples]
        best = int(np.argmin(np.abs(places - position).max(axis=1)))
        return places[best], float(delays[best])
