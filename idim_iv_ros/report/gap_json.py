"""gap.json: a diagnosis as plain values, in the order of the design."""

import json
from collections.abc import Mapping

from idim_iv_ros.gap.result import (
    FORMAT,
    Cause,
    EffectParameter,
    Gap,
    GapResult,
    JointGap,
    NotTestable,
    Regime,
    Rival,
    Stage,
    Unexplained,
)
from idim_iv_ros.report.json_result import Document, plain


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
            "software": result.software,
            "without": result.without,
            "verdict": result.verdict,
            "summary": result.summary,
            "causes": [_cause(cause) for cause in result.causes],
            "unexplained": _unexplained(result.unexplained),
            "where": {
                "joints": [_joint(joint) for joint in result.joint_gaps],
                "regimes": [_regime(regime) for regime in result.regimes],
            },
            "findings": result.findings,
            "not_testable": [_not_testable(each) for each in result.not_testable],
            "stages": [_stage(stage) for stage in result.stages],
            "notes": result.notes,
            "extended_parameters": _parameters(result.extended_parameters),
            "configuration": result.configuration,
            "timing": result.timing,
        }
    )
    return document


def gap_text(result: GapResult) -> str:
    """Return gap.json as text."""
    document = gap_document(result)
    return json.dumps(document, indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def _cause(cause: Cause) -> Document:
    return {
        "effect": cause.effect,
        "kind": cause.kind,
        "joint": cause.joint,
        "other_joint": cause.other_joint,
        "sentence": cause.sentence,
        "parameters": _parameters(cause.parameters),
        "evidence": {
            "statistic": cause.evidence.statistic,
            "p_value": cause.evidence.p_value,
            "held_out_gain": cause.evidence.held_out_gain,
            "folds_positive": cause.evidence.folds_positive,
        },
        "indistinguishable_from": [_rival(rival) for rival in cause.indistinguishable_from],
        "torque_gap": {
            "before": cause.torque_gap.before,
            "after": cause.torque_gap.after,
            "noise_floor": cause.torque_gap.noise_floor,
            "shrinkage": cause.torque_gap.shrinkage,
            "ci95": cause.torque_gap.ci95,
        },
        "simulation_gap": _simulation_gap(cause.simulation_gap),
    }


def _parameters(parameters: Mapping[str, EffectParameter]) -> Document:
    return {
        name: {"value": each.value, "std": each.std, "unit": each.unit}
        for name, each in parameters.items()
    }


def _rival(rival: Rival) -> Document:
    return {"effect": rival.effect, "joint": rival.joint, "correlation": rival.correlation}


def _simulation_gap(gap: Gap | None) -> Document | None:
    if gap is None:
        return None
    return {
        "before": gap.before,
        "after": gap.after,
        "shrinkage": gap.shrinkage,
        "ci95": gap.ci95,
    }


def _unexplained(unexplained: Unexplained | None) -> Document | None:
    if unexplained is None:
        return None
    return {
        "joint": unexplained.joint,
        "family": unexplained.family,
        "share": unexplained.share,
        "where": unexplained.where,
    }


def _joint(joint: JointGap) -> Document:
    return {
        "joint": joint.joint,
        "rms": joint.rms,
        "relative_percent": joint.relative_percent,
        "share": joint.share,
        "noise_floor": joint.noise_floor,
        "floor_origin": joint.floor_origin,
    }


def _regime(regime: Regime) -> Document:
    return {
        "joint": regime.joint,
        "axis": regime.axis,
        "low": regime.low,
        "high": regime.high,
        "unit": regime.unit,
        "energy_share": regime.energy_share,
        "occupancy": regime.occupancy,
        "lift": regime.lift,
        "ci95": regime.ci95,
    }


def _not_testable(each: NotTestable) -> Document:
    return {
        "effect": each.effect,
        "joint": each.joint,
        "reason": each.reason,
        "excitation_needed": each.excitation_needed,
        "smallest": each.smallest,
    }


def _stage(stage: Stage) -> Document:
    return {
        "stage": stage.name,
        "torque_rms": stage.torque_rms,
        "torque_ci95": stage.torque_ci95,
        "tracking_rms": stage.tracking_rms,
        "note": stage.note,
    }
