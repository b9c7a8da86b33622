"""What the identifier says of its work, of every joint, and of parameters that drift."""

from collections.abc import Sequence

from diagnostic_msgs.msg import DiagnosticStatus

from idim_iv_interfaces.msg import (
    DriftComparison,
    DriftReport,
    IdentificationResult,
    ParameterDrift,
    PastIdentification,
)
from idim_iv_ros.nodes.entry import diagnostic_status, time_message
from idim_iv_ros.nodes.identifier.estimate_history import Comparison, PastEstimates
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
    drifting = any(comparison.drifting for comparison in comparisons)
    level = DiagnosticStatus.WARN if drifting else DiagnosticStatus.OK
    values: dict[str, object] = {}
    compared = [comparison for comparison in comparisons if comparison.drifts]
    if compared:
        # The kind that was identified last, unless another is the reason of the alarm.
        shown = next((each for each in reversed(compared) if each.drifting), compared[-1])
        values["bags"] = ", ".join(shown.newest.bags)
        values["limit (σ)"] = f"{shown.drifts[0].limit:.3f}"
        values.update(
            {f"{drift.parameter} (σ)": f"{drift.statistic:+.2f}" for drift in shown.drifts}
        )
    return diagnostic_status(level, f"{name}: drift", name, drift_sentence(comparisons), values)


def drift_sentence(comparisons: Sequence[Comparison]) -> str:
    """Say in one line which parameters changed, and since when."""
    parts = []
    for comparison in comparisons:
        if comparison.drifting:
            changed = "; ".join(
                f"{drift.parameter} {drift.first:.4g} → {drift.value:.4g} "
                f"({drift.statistic:+.1f} σ)"
                for drift in comparison.drifting
            )
            parts.append(
                f"{_kind(comparison, comparisons)}{changed}: changed since {_since(comparison)}"
            )
    if parts:
        return "; ".join(parts)
    compared = [comparison for comparison in comparisons if comparison.drifts]
    if not compared:
        return "no earlier identification to compare with"
    last = compared[-1]
    return f"no parameter differs from {_since(last)} by more than {last.drifts[0].limit:.2f} σ"


def drift_report(comparisons: Sequence[Comparison]) -> DriftReport:
    """Return what `~/drift` publishes."""
    report = DriftReport(
        drifting=any(comparison.drifting for comparison in comparisons),
        message=drift_sentence(comparisons),
        comparisons=[_comparison(comparison) for comparison in comparisons],
    )
    if comparisons:
        report.header.stamp = time_message(comparisons[-1].newest.stamp)
    return report


def past_identification(entry: PastEstimates) -> PastIdentification:
    """Return an entry of the history."""
    return PastIdentification(
        stamp=time_message(entry.stamp),
        robot=entry.robot,
        configuration=entry.configuration,
        estimator=entry.estimator,
        effort_unit=entry.effort_unit,
        bags=list(entry.bags),
        folder=entry.folder,
        baseline=entry.baseline,
        names=list(entry.values),
        values=[value for value, _ in entry.values.values()],
        stds=[std for _, std in entry.values.values()],
    )


def _since(comparison: Comparison) -> str:
    assert comparison.baseline is not None
    return ", ".join(comparison.baseline.bags)


def _kind(comparison: Comparison, comparisons: Sequence[Comparison]) -> str:
    """Name the kind where there are several."""
    if len(comparisons) == 1:
        return ""
    newest = comparison.newest
    parts = [part for part in (newest.configuration, newest.estimator) if part]
    return f"{', '.join(parts)}: "


def _comparison(comparison: Comparison) -> DriftComparison:
    newest, baseline = comparison.newest, comparison.baseline
    message = DriftComparison(
        robot=newest.robot,
        configuration=newest.configuration,
        estimator=newest.estimator,
        bags=list(newest.bags),
        drifting=bool(comparison.drifting),
        since=time_message((comparison.since or 0) if comparison.drifting else 0),
    )
    if baseline is not None:
        message.baseline_bags = list(baseline.bags)
        message.baseline_stamp = time_message(baseline.stamp)
        message.limit = comparison.drifts[0].limit
        message.parameters = [
            ParameterDrift(
                name=drift.parameter,
                before=drift.first,
                before_std=baseline.values[drift.parameter][1],
                now=drift.value,
                now_std=newest.values[drift.parameter][1],
                statistic=drift.statistic,
                drifts=drift.drifts,
            )
            for drift in comparison.drifts
        ]
    return message
