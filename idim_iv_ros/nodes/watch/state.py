"""What is known of a running robot at one moment, gathered from the nodes' topics."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from idim_iv_ros.prediction.rows import LIMIT, SHARE

GOOD, BEYOND, UNKNOWN = "good", "beyond", "unknown"


@dataclass(frozen=True)
class JointView:
    """One joint: what the predictor's diagnostics say of it, and its newest prediction.

    Attributes
    ----------
    name, unit : str
        `unit` is empty before the predictor has said it.
    measured, predicted, residual : float
        In `unit`; NaN where there is none.
    share : float
        RMS of the residual over the last second of motion, over the noise floor of the
        identification; NaN where not known.
    level_share, limit : float
        RMS of the residual over ten seconds of motion, over the same noise floor, and how much of
        it is explained; NaN where not known.
    level : str
        ``good``, ``beyond`` the limit, or ``unknown``.
    sentence : str
        Of the predictor's diagnostics.
    """

    name: str
    unit: str = ""
    measured: float = math.nan
    predicted: float = math.nan
    residual: float = math.nan
    share: float = math.nan
    level_share: float = math.nan
    limit: float = math.nan
    level: str = UNKNOWN
    sentence: str = ""

    @classmethod
    def diagnosed(
        cls, name: str, values: Mapping[str, str], warns: bool, sentence: str
    ) -> "JointView":
        """Return a joint without a prediction, from the key-value pairs of its diagnostics."""
        share, limit = (_number(values.get(key, "")) for key in (SHARE, LIMIT))
        level = BEYOND if warns else GOOD if math.isfinite(limit) else UNKNOWN
        unit = values.get("unit", "")
        return cls(name, unit, level_share=share, limit=limit, level=level, sentence=sentence)


@dataclass(frozen=True)
class LiveView:
    """All joints, and what the nodes do.

    Attributes
    ----------
    robot : str
    stamp : float
        Of the sample, s.
    delay : float
        From the sample to its prediction, s.
    reason : str
        Why nothing is predicted; empty where something is.
    joints : tuple of JointView
    nodes : dict of str to str
        What recorder and identifier do and whether parameters drift, in words.
    """

    robot: str
    stamp: float
    delay: float
    reason: str
    joints: tuple[JointView, ...]
    nodes: dict[str, str] = field(default_factory=dict)

    def to_document(self) -> dict[str, object]:
        """Return plain values for JSON; numbers that do not exist are None."""
        return {
            "robot": self.robot,
            "stamp": self.stamp,
            "delay": _finite(self.delay),
            "reason": self.reason,
            "joints": [
                {
                    key: _finite(value) if isinstance(value, float) else value
                    for key, value in vars(joint).items()
                }
                for joint in self.joints
            ],
            "nodes": self.nodes,
        }


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:  # "unknown", or nothing
        return math.nan


def _finite(number: float) -> float | None:
    return float(f"{number:.6g}") if math.isfinite(number) else None
