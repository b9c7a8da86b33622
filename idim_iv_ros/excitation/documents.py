"""Figures of motions as JSON documents and as a table of segments."""

import csv
import io
from collections.abc import Sequence

from idim_iv_ros.excitation.diagnosis import Diagnosis
from idim_iv_ros.excitation.limit_use import LimitUse
from idim_iv_ros.excitation.limits import MotionLimits
from idim_iv_ros.excitation.segment import NOT_REVEALED, Segment

FORMAT = "idim_iv_ros/excitation/1"


def diagnosis_document(
    robot: str, limits: MotionLimits, diagnosis: Diagnosis, seed: int
) -> dict[str, object]:
    """Figures of a motion for diagnosis: segments, effects, limits and what is used of them."""
    return {
        "format": FORMAT,
        "purpose": "diagnosis",
        "robot": robot,
        "joints": list(diagnosis.trajectory.joints),
        "settings": {"rate": diagnosis.trajectory.rate, "seed": seed},
        "duration": diagnosis.trajectory.duration,
        "loop_bandwidth": [float(f) for f in diagnosis.bandwidth],
        "loop_bandwidth_known": diagnosis.bandwidth_known,
        "segments": [segment.document() for segment in diagnosis.segments],
        "not_revealed": [
            {"effect": effect, "excitation_needed": needed}
            for effect, needed in NOT_REVEALED.items()
        ],
        "limits": limits_document(limits),
        "use": use_document(diagnosis.use),
    }


def segment_table(segments: Sequence[Segment]) -> str:
    """CSV of the segments: name, kind, start and end in s, effects separated by spaces."""
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(["name", "kind", "start", "end", "effects"])
    for segment in segments:
        plan = segment.plan
        ends = (f"{segment.start:.9g}", f"{segment.end:.9g}")
        table.writerow([plan.name, plan.kind, *ends, " ".join(segment.effects)])
    return text.getvalue()


def limits_document(limits: MotionLimits) -> dict[str, object]:
    """Limits for JSON, in rad, rad/s, rad/s², N m and m."""
    names = ("lower", "upper", "velocity", "acceleration", "torque")
    arrays = {name: [float(v) for v in getattr(limits, name)] for name in names}
    return {
        **arrays,
        "floor": limits.floor,
        "margin": limits.margin,
        "torque_checked": limits.torque_known,
    }


def use_document(use: LimitUse) -> dict[str, object]:
    """Shares of the limits for JSON."""
    shares = {
        name: None if values is None else [float(v) for v in values]
        for name, values in (
            ("position", use.position),
            ("velocity", use.velocity),
            ("acceleration", use.acceleration),
            ("torque", use.torque),
        )
    }
    return {**shares, "lowest_frame": use.lowest_frame, "lowest_height": use.lowest_height}
