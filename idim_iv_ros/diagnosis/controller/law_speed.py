"""The speed that the control law really used, tried on its recorded command.

A drive computes its speed from differences of its encoder, mostly filtered, or has an observer. A
law whose speed is late looks like one with feedforward of the acceleration, of size kd times the
lateness; if one of these speeds explains the command, the law is as configured.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
import scipy

from idim_iv_ros.signals import JointSignals
from idim_iv_ros.types import FloatArray

# Share of the newest difference in a first-order filter: from a hardly filtered speed to one that
# is twenty samples late.
FACTORS = (1.0, 0.8, 0.65, 0.5, 0.4, 0.3, 0.2, 0.15, 0.1, 0.05)


@dataclass(frozen=True)
class LawSpeed:
    """One way to obtain the speed of a joint.

    Attributes
    ----------
    kind : str
        ``central`` differences of the position (no lateness), the ``recorded`` velocity, or
        backward differences through a first-order filter (``filtered``).
    factor : float
        Of the filter: v[k] = v[k-1] + factor (Δq[k] / Δt − v[k-1]); 1 is no filter.
    """

    kind: Literal["central", "recorded", "filtered"] = "central"
    factor: float = 1.0

    def of(self, signals: JointSignals, joint: int) -> FloatArray:
        """Speed (n_samples,) of one joint, rad/s (m/s)."""
        if self.kind == "recorded" and signals.velocity is not None:
            return signals.velocity[:, joint]
        position = signals.position[:, joint]
        if self.kind != "filtered":
            return np.gradient(position, 1.0 / signals.rate)
        difference = np.diff(position, prepend=position[:1]) * signals.rate
        if len(difference) > 1:
            difference[0] = difference[1]
        rest = (1.0 - self.factor) * difference[0]
        filtered, _ = scipy.signal.lfilter(
            [self.factor], [1.0, self.factor - 1.0], difference, zi=[rest]
        )
        return np.asarray(filtered)

    @property
    def words(self) -> str:
        """What it is, for the report."""
        if self.kind == "recorded":
            return "the recorded velocity"
        if self.kind == "central":
            return "central differences of the position"
        if self.factor == 1.0:
            return "backward differences of the position"
        return (
            "backward differences of the position through a first-order filter of factor "
            f"{self.factor:.2g}"
        )


def law_speeds(recorded: bool) -> tuple[LawSpeed, ...]:
    """Ways to try, the plain one first; `recorded`: whether all recordings hold velocities."""
    first = (LawSpeed(), *((LawSpeed("recorded"),) if recorded else ()))
    return (*first, *(LawSpeed("filtered", factor) for factor in FACTORS))
