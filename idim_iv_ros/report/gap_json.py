"""gap.json: a diagnosis as plain values, in the order of the design."""

from idim_iv_ros.diagnosis.result import FORMAT, Cause, Gap, GapResult, Stage
from idim_iv_ros.report.json_result import Document, document_text, plain


def gap_document(result: GapResult) -> Document:
    """Return the content of gap.json.

    Everything is a plain Python value; numbers that do not exist (None, NaN, infinite) are
    None. The order of the keys is always the same. Series, for figures only, are left out.

    Parameters
    ----------
    result : GapResult
        What `diagnose` found.
    """
    document: Document = plain(
        {
            "format": FORMAT,
            "robot": result.robot,
            "joints": result.joints,
            "bags": result.bags,
            "session": result.session,
            "software": result.software,
            "without": result.without,
            "verdict": result.verdict,
            "summary": result.summary,
            "causes": [_cause(cause) for cause in result.causes],
            "unexplained": result.unexplained,
            "parameter_errors": result.parameter_errors,
            "signal_chain": result.signal_chain,
            "where": {"joints": result.joint_gaps, "regimes": result.regimes},
            "findings": result.findings,
            "not_testable": result.not_testable,
            "stages": [_stage(stage) for stage in result.stages],
            "notes": result.notes,
            "extended_parameters": result.extended_parameters,
            "configuration": result.configuration,
            "timing": result.timing,
        }
    )
    return document


def gap_text(result: GapResult) -> str:
    """Return gap.json as text."""
    return document_text(gap_document(result))


def _cause(cause: Cause) -> Document:
    return {
        "effect": cause.effect,
        "kind": cause.kind,
        "joint": cause.joint,
        "other_joint": cause.other_joint,
        "sentence": cause.sentence,
        "parameters": cause.parameters,
        "evidence": cause.evidence,
        "indistinguishable_from": cause.indistinguishable_from,
        "torque_gap": cause.torque_gap,
        "joint_gaps": cause.joint_gaps,
        "simulation_gap": _simulation_gap(cause.simulation_gap),
    }


def _simulation_gap(gap: Gap | None) -> Document | None:
    if gap is None:
        return None
    return {
        "before": gap.before,
        "after": gap.after,
        "shrinkage": gap.shrinkage,
        "ci95": gap.ci95,
    }


def _stage(stage: Stage) -> Document:
    return {
        "stage": stage.name,
        "torque_rms": stage.torque_rms,
        "torque_ci95": stage.torque_ci95,
        "tracking_rms": stage.tracking_rms,
        "note": stage.note,
    }
