"""What is known of a running robot at one moment, gathered from the nodes' topics."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from idim_iv_ros.prediction.rows import LIMIT, SHARE

GOOD, BEYOND, UNKNOWN = "good", "beyond", "unknown"


@dataclass(frozen=True)
class JointView:
    """One joint.

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
        The same over ten seconds, and how much of it is explained; NaN where not known.
    level : str
        ``good``, ``beyond`` the limit, or ``unknown``.
    sentence : str
        Of the predictor's diagnostics.
    """

    name: str
    unit: str
    measured: float
    predicted: float
    residual: float
    share: float
    level_share: float
    limit: float
    level: str
    sentence: str


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


@dataclass(frozen=True)
class JointJudgement:
    """What the predictor's diagnostics say of one joint."""

    unit: str
    share: float
    limit: float
    warns: bool
    sentence: str

    @classmethod
    def of(cls, values: Mapping[str, str], warns: bool, sentence: str) -> "JointJudgement":
        """Read it from the key-value pairs of the message."""
        share, limit = (_number(values.get(key, "")) for key in (SHARE, LIMIT))
        return cls(values.get("unit", ""), share, limit, warns, sentence)


def joint_views(
    names: Sequence[str],
    numbers: Sequence[Sequence[float]],
    judgements: Mapping[str, JointJudgement],
) -> tuple[JointView, ...]:
    """Join predictions with what is said of each joint.

    Parameters
    ----------
    names
    numbers
        Measured, predicted, residual and share, (n_joints,) each.
    judgements
        By joint.
    """
    views = []
    for name, *values in zip(names, *numbers, strict=True):
        said = judgements.get(name, JointJudgement("", math.nan, math.nan, False, ""))
        known = math.isfinite(said.limit) or said.warns
        level = BEYOND if said.warns else GOOD if known else UNKNOWN
        measured, predicted, residual, share = values
        views.append(
            JointView(
                name=name,
                unit=said.unit,
                measured=measured,
                predicted=predicted,
                residual=residual,
                share=share,
                level_share=said.share,
                limit=said.limit,
                level=level,
                sentence=said.sentence,
            )
        )
    return tuple(views)


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:  # "unknown", or nothing
        return math.nan


def _finite(number: float) -> float | None:
    return float(f"{number:.6g}") if math.isfinite(number) else None
