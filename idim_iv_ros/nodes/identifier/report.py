"""What the identifier says on /diagnostics: its work, every joint, parameters that drift."""

from collections.abc import Sequence

from diagnostic_msgs.msg import DiagnosticStatus

from idim_iv_interfaces.msg import IdentificationResult
from idim_iv_ros.nodes.entry import diagnostic_status
from idim_iv_ros.nodes.identifier.job_queue import JobQueue
from idim_iv_ros.statistics.drift import Drift

_LEVELS = {
    "valid": DiagnosticStatus.OK,
    "autocorrelated": DiagnosticStatus.WARN,
    "inconclusive": DiagnosticStatus.WARN,
    "misspecified": DiagnosticStatus.ERROR,
}


def work_diagnosis(name: str, jobs: JobQueue, failure: str) -> DiagnosticStatus:
    """What is done now; an error if the last job failed, and why."""
    level, sentence = DiagnosticStatus.OK, "idle"
    if jobs.running is not None:
        sentence = f"{', '.join(jobs.running.names)}: {jobs.running.stage}"
    elif failure:
        level, sentence = DiagnosticStatus.ERROR, failure
    values: dict[str, object] = {
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


def drift_diagnosis(name: str, drifts: Sequence[Drift], bags: Sequence[str]) -> DiagnosticStatus:
    """Name the parameters that differ from their first estimate by more than chance."""
    found = [drift for drift in drifts if drift.drifts]
    level = DiagnosticStatus.WARN if found else DiagnosticStatus.OK
    if found:
        parts = [
            f"{drift.parameter} {drift.first:.4g} → {drift.value:.4g} ({drift.statistic:+.1f} σ)"
            for drift in found
        ]
        sentence = f"{'; '.join(parts)}: changed since {', '.join(found[0].since)}"
    elif drifts:
        sentence = (
            f"no parameter differs from {', '.join(drifts[0].since)} by more than "
            f"{drifts[0].limit:.2f} σ"
        )
    else:
        sentence = "no earlier identification to compare with"
    values: dict[str, object] = {"bags": ", ".join(bags)}
    if drifts:
        values["limit (σ)"] = f"{drifts[0].limit:.3f}"
    values.update({f"{each.parameter} (σ)": f"{each.statistic:+.2f}" for each in drifts})
    return diagnostic_status(level, f"{name}: drift", name, sentence, values)
