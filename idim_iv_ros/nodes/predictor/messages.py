"""What the predictor says: its message, diagnostics of the residual, and spheres for RViz."""

import math
from collections.abc import Sequence

from diagnostic_msgs.msg import DiagnosticStatus
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from idim_iv_interfaces import msg
from idim_iv_ros.nodes.entry import diagnostic_status, time_message
from idim_iv_ros.prediction import IdentifiedModel, Prediction
from idim_iv_ros.prediction.rows import LIMIT, SHARE, JointLevel

_DIAMETER, _TEXT, _ABOVE = 0.14, 0.05, 0.12  # m
_GREY = (0.55, 0.55, 0.58)
# As good as the identification, twice its noise floor, four times or more.
_COLOURS = ((0.13, 0.60, 0.33), (0.95, 0.68, 0.10), (0.80, 0.12, 0.16))
_ALPHA = 0.75


def prediction_message(
    prediction: Prediction,
    identified: IdentifiedModel | None,
    robot: str,
    joints: Sequence[str],
    times: tuple[int, int],
) -> msg.Prediction:
    """Return a prediction as a message; `times` are when it was identified, and now, ns."""
    ended, now = times
    message = msg.Prediction(
        robot=robot if identified is None else identified.robot,
        valid=not prediction.reason,
        reason=prediction.reason,
        identified=time_message(0 if identified is None else ended),
        name=list(joints),
        measured=prediction.measured.tolist(),
        predicted=prediction.predicted.tolist(),
        residual=prediction.residual.tolist(),
        noise_floor=[float("nan")] * len(joints)
        if identified is None
        else identified.noise_floor.tolist(),
        noise_share=prediction.noise_share.tolist(),
        delay=(now - prediction.stamp) * 1e-9 if prediction.stamp else float("nan"),
    )
    message.header.stamp = time_message(prediction.stamp)
    return message


def prediction_diagnosis(name: str, reason: str, values: dict[str, object]) -> DiagnosticStatus:
    """Whether anything is predicted, and else why not."""
    level = DiagnosticStatus.WARN if reason else DiagnosticStatus.OK
    return diagnostic_status(level, f"{name}: prediction", name, reason or "predicting", values)


def joint_diagnosis(name: str, level: JointLevel) -> DiagnosticStatus:
    """Whether the residual of a joint is larger than its scatter explains."""
    values: dict[str, object] = {
        "unit": level.unit,
        f"residual, RMS ({level.unit})": f"{level.rms:.4g}",
        f"noise floor, RMS ({level.unit})": f"{level.noise_floor:.4g}",
        SHARE: f"{level.share:.3f}",
        LIMIT: "unknown" if level.limit is None else f"{level.limit:.3f}",
        "motion behind it (s)": f"{level.seconds:.1f}",
    }
    severity = DiagnosticStatus.WARN if level.beyond else DiagnosticStatus.OK
    return diagnostic_status(
        severity, f"{name}: {level.joint}", level.joint, level.sentence, values
    )


def colour_of(share: float) -> tuple[float, float, float]:
    """Red, green, blue of a share of the noise floor: green at 1, amber at 2, red from 4 on."""
    if not math.isfinite(share):
        return _GREY
    place = min(max(math.log2(max(share, 1e-9)), 0.0), 2.0)
    first = min(int(place), 1)
    part = place - first
    red, green, blue = (
        low + part * (high - low)
        for low, high in zip(_COLOURS[first], _COLOURS[first + 1], strict=True)
    )
    return red, green, blue


def residual_markers(
    links: Sequence[str], joints: Sequence[str], shares: Sequence[float]
) -> MarkerArray:
    """Return a sphere and a text for each joint, in the frame of its link, at its newest place."""
    markers = []
    for number, (link, joint, share) in enumerate(zip(links, joints, shares, strict=True)):
        red, green, blue = colour_of(share)
        sphere = _marker(link, "residual", number, Marker.SPHERE)
        sphere.scale.x = sphere.scale.y = sphere.scale.z = _DIAMETER
        sphere.color = ColorRGBA(r=red, g=green, b=blue, a=_ALPHA)
        text = _marker(link, "share", number, Marker.TEXT_VIEW_FACING)
        text.pose.position.z = _ABOVE
        text.scale.z = _TEXT
        text.color = ColorRGBA(r=1.0, g=1.0, b=1.0, a=1.0)
        text.text = f"{joint} {share:.1f}×" if math.isfinite(share) else f"{joint} –"
        markers += [sphere, text]
    return MarkerArray(markers=markers)


def _marker(frame: str, namespace: str, number: int, kind: int) -> Marker:
    marker = Marker(ns=namespace, id=number, type=kind, action=Marker.ADD, frame_locked=True)
    marker.header.frame_id = frame  # its stamp stays zero: where the link is now
    marker.pose.orientation.w = 1.0
    marker.lifetime.sec = 2
    return marker
