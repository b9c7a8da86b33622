"""Earlier identifications and what changed since, as messages."""

from collections.abc import Sequence

from idim_iv_interfaces.msg import DriftComparison, DriftReport, ParameterDrift, PastIdentification
from idim_iv_ros.nodes.entry import time_message
from idim_iv_ros.nodes.identifier.estimate_history import Comparison, PastEstimates


def drift_sentence(comparisons: Sequence[Comparison]) -> str:
    """Say in one line which parameters changed, and since when."""
    parts = []
    for each in comparisons:
        if each.drifting:
            changed = "; ".join(
                f"{drift.parameter} {drift.first:.4g} → {drift.value:.4g} "
                f"({drift.statistic:+.1f} σ)"
                for drift in each.drifting
            )
            parts.append(f"{_kind(each, comparisons)}{changed}: changed since {_since(each)}")
    if parts:
        return "; ".join(parts)
    compared = [each for each in comparisons if each.drifts]
    if not compared:
        return "no earlier identification to compare with"
    last = compared[-1]
    return f"no parameter differs from {_since(last)} by more than {last.drifts[0].limit:.2f} σ"


def drift_report(comparisons: Sequence[Comparison]) -> DriftReport:
    """Return what `~/drift` publishes."""
    report = DriftReport(
        drifting=any(each.drifting for each in comparisons),
        message=drift_sentence(comparisons),
        comparisons=[_comparison(each) for each in comparisons],
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


def _comparison(each: Comparison) -> DriftComparison:
    newest, baseline = each.newest, each.baseline
    message = DriftComparison(
        robot=newest.robot,
        configuration=newest.configuration,
        estimator=newest.estimator,
        bags=list(newest.bags),
        drifting=bool(each.drifting),
        since=time_message((each.since or 0) if each.drifting else 0),
    )
    if baseline is not None:
        message.baseline_bags = list(baseline.bags)
        message.baseline_stamp = time_message(baseline.stamp)
        message.limit = each.drifts[0].limit
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
            for drift in each.drifts
        ]
    return message
