"""What the predictor says: its message, and diagnostics of the residual."""

from collections.abc import Sequence

from diagnostic_msgs.msg import DiagnosticStatus

from idim_iv_interfaces import msg
from idim_iv_ros.nodes.entry import diagnostic_status, time_message
from idim_iv_ros.prediction import IdentifiedModel, Prediction
from idim_iv_ros.prediction.rows import LIMIT, SHARE, JointLevel


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
