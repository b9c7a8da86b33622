"""result.json: the result as plain values, in the order of the design."""

import dataclasses
import json
import math
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from idim_iv_ros.identification.result import (
    FORMAT,
    IdentificationResult,
    ParameterEstimate,
    RefinedEstimate,
)
from idim_iv_ros.statistics import HypothesisTest, JointVerdict, ResidualDiagnosis

Document = dict[str, Any]


def result_document(result: IdentificationResult) -> Document:
    """Return the content of result.json.

    Everything is a plain Python value; numbers that do not exist (None, NaN, infinite) are
    None. The order of the keys is always the same.

    Parameters
    ----------
    result : IdentificationResult
        What `identify` found.
    """
    document = {
        "format": FORMAT,
        "robot": result.robot,
        "joints": result.joints,
        "bags": result.bags,
        "software": result.software,
        "estimator": result.estimator,
        "iterations": result.iterations,
        "converged": result.converged,
        "convergence_note": result.convergence_note,
        "verdict": result.verdict,
        "parameters": [_parameter(each) for each in result.parameters],
        "instruments": {
            "accepted": result.instruments.accepted,
            "alpha": result.instruments.alpha,
            "source": result.instruments.source,
            "failures": result.instruments.failures,
            "notes": result.instruments.notes,
            "tests": [_test(test) for test in result.instruments.tests],
        },
        "specification": {
            "accepted": _accepted_overall(result.instruments.specification),
            "alpha": result.instruments.alpha,
            "tests": [_test(test) for test in result.instruments.specification],
        },
        "exogeneity": {
            "accepted": _accepted_overall(result.instruments.exogeneity),
            "alpha": result.instruments.alpha,
            "tests": [_test(test) for test in result.instruments.exogeneity],
        },
        "residuals": [
            _residual(residual, verdict)
            for residual, verdict in zip(result.residuals, result.verdicts, strict=True)
        ],
        "fit": result.fit,
        "refined": _refined(result),
        "processing": result.processing,
        "controller": result.controller,
        "effort_unit": result.effort_unit,
        "covariance": result.covariance,
        "configuration": result.configuration,
        "timing": result.timing,
    }
    plain_document: Document = plain(document)
    return plain_document


def result_text(result: IdentificationResult) -> str:
    """Return result.json as text."""
    return document_text(result_document(result))


def document_text(document: Document) -> str:
    """Return plain values as the text of a JSON file."""
    return json.dumps(document, indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def plain(value: object) -> Any:
    """Return the value with plain Python types only; what is not a finite number is None.

    A dataclass becomes a mapping of its fields, in their order.
    """
    if value is None or isinstance(value, (bool, int, str)):
        return value
    if isinstance(value, (float, np.floating)):
        return float(value) if math.isfinite(value) else None
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if dataclasses.is_dataclass(value):
        return {each.name: plain(getattr(value, each.name)) for each in dataclasses.fields(value)}
    if isinstance(value, Mapping):
        return {str(key): plain(each) for key, each in value.items()}
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, Iterable):
        return [plain(each) for each in value]
    raise TypeError(f"{type(value).__name__} has no place in result.json")


def _estimate(estimate: ParameterEstimate | RefinedEstimate) -> Document:
    return {
        "name": estimate.name,
        "expression": estimate.expression,
        "unit": estimate.unit,
        "value": estimate.value,
        "std": estimate.std,
        "relative_std_percent": estimate.relative_std_percent,
        "essential": estimate.essential,
    }


def _parameter(parameter: ParameterEstimate) -> Document:
    return {
        **_estimate(parameter),
        "ls_value": parameter.ls_value,
        "given_value": parameter.given_value,
        "white_std": parameter.white_std,
        "essential_value": parameter.essential_value,
        "essential_std": parameter.essential_std,
        "ls_std": parameter.ls_std,
        "ordinary_ls_value": parameter.ordinary_ls_value,
        "non_negative": parameter.non_negative,
        "remark": parameter.remark,
        "essential_remark": parameter.essential_remark,
    }


def _refined(result: IdentificationResult) -> Document | None:
    if result.refined is None:
        return None
    estimates = {parameter.name: parameter for parameter in result.parameters}
    return {
        "ar_orders": result.refined.ar_orders,
        "parameters": [
            _refined_parameter(each, estimates.get(each.name)) for each in result.refined.parameters
        ],
    }


def _refined_parameter(refined: RefinedEstimate, estimate: ParameterEstimate | None) -> Document:
    return {
        **_estimate(refined),
        "ls_value": None if estimate is None else estimate.ls_value,
        "given_value": None if estimate is None else estimate.given_value,
    }


def _test(test: HypothesisTest) -> Document:
    return {
        "scope": test.scope,
        "statistic": test.statistic,
        "df": test.df,
        "df_denom": test.df_denom,
        "p_value": test.p_value,
        "max_deviation": test.max_deviation,
        "accepted": test.accepted,
        "reason": test.reason,
        "null": test.null,
        "alpha": test.alpha,
        "torque_deviation_percent": test.torque_deviation_percent,
    }


def _accepted_overall(tests: tuple[HypothesisTest, ...]) -> bool | None:
    """Return the outcome over all rows, which is the one that speaks for the whole estimate."""
    return next((test.accepted for test in tests if test.scope == "all"), None)


def _residual(residual: ResidualDiagnosis, verdict: JointVerdict) -> Document:
    return {
        "joint": residual.joint,
        "rms": residual.rms,
        "relative_percent": residual.relative_percent,
        "ar_order": residual.ar_order,
        "white": residual.white,
        "whiteness_p_value": residual.whiteness.p_value,
        "normality_p_value": residual.normality.p_value,
        "verdict": verdict.verdict,
        "sentence": verdict.sentence,
        "predictable_share": residual.predictable_share,
        "sigma_understatement": residual.sigma_understatement,
        "largest_correlation_after": residual.largest_correlation_after,
        "skewness": residual.skewness,
        "excess_kurtosis": residual.excess_kurtosis,
        "whiteness": _test(residual.whiteness),
        "whiteness_after": _test(residual.whiteness_after),
        "normality": _test(residual.normality),
    }
