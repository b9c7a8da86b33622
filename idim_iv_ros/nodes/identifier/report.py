"""What the identifier says on /diagnostics: its work, every joint, parameters that drift."""

from collections.abc import Sequence

from diagnostic_msgs.msg import DiagnosticStatus

from idim_iv_interfaces.msg import IdentificationResult
from idim_iv_ros.nodes.entry import diagnostic_status
from idim_iv_ros.nodes.identifier.drift_messages import drift_sentence
from idim_iv_ros.nodes.identifier.estimate_history import Comparison
from idim_iv_ros.nodes.identifier.job_queue import JobQueue
from idim_iv_ros.nodes.identifier.managed_node import ACTIVE

_LEVELS = {
    "valid": DiagnosticStatus.OK,
    "autocorrelated": DiagnosticStatus.WARN,
    "inconclusive": DiagnosticStatus.WARN,
    "misspecified": DiagnosticStatus.ERROR,
}


def work_diagnosis(name: str, jobs: JobQueue, failure: str, state: str) -> DiagnosticStatus:
    """What is done now; an error if the last job failed, and why."""
    level, sentence = DiagnosticStatus.OK, "idle" if state == ACTIVE else state
    if jobs.running is not None:
        sentence = f"{', '.join(jobs.running.names)}: {jobs.running.stage}"
    elif failure:
        level, sentence = DiagnosticStatus.ERROR, failure
    values: dict[str, object] = {
        "state": state,
        "waiting": jobs.waiting,
        "worker (process id)": jobs.process_id or "none",
    }
    return diagnostic_status(level, f"{name}: identification", name, sentence, values)


def joint_diagnoses(name: str, result: IdentificationResult) -> list[DiagnosticStatus]:
    """The verdict on each joint, with its sentence."""
    bags = ", ".join(result.parameters.bags)
    return [
        diagnostic_status(
            _LEVELS[residual.verdict],
            f"{name}: {residual.joint}",
            residual.joint,
            residual.sentence,
            {
                "verdict": residual.verdict,
                "bags": bags,
                f"residual, RMS ({result.effort_unit})": f"{residual.rms:.4g}",
                "residual (%)": f"{residual.relative_percent:.3g}",
                "order of its autoregressive model": residual.ar_order,
            },
        )
        for residual in result.residuals
    ]


def drift_diagnosis(name: str, comparisons: Sequence[Comparison]) -> DiagnosticStatus:
    """Name the parameters that differ from their baseline by more than chance."""
    drifting = any(each.drifting for each in comparisons)
    level = DiagnosticStatus.WARN if drifting else DiagnosticStatus.OK
    values: dict[str, object] = {}
    compared = [each for each in comparisons if each.drifts]
    if compared:
        # The kind that was identified last, unless another is the reason of the alarm.
        shown = next((each for each in reversed(compared) if each.drifting), compared[-1])
        values["bags"] = ", ".join(shown.newest.bags)
        values["limit (σ)"] = f"{shown.drifts[0].limit:.3f}"
        values.update({f"{each.parameter} (σ)": f"{each.statistic:+.2f}" for each in shown.drifts})
    return diagnostic_status(level, f"{name}: drift", name, drift_sentence(comparisons), values)
