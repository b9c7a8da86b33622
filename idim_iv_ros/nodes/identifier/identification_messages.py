"""From result.json to messages."""

from collections.abc import Sequence
from pathlib import Path

from builtin_interfaces.msg import Time

from idim_iv_interfaces.msg import (
    IdentificationResult,
    InstrumentTest,
    ParameterEstimate,
    ParameterEstimates,
    ResidualDiagnosis,
)
from idim_iv_ros.errors import DataError
from idim_iv_ros.files import IDENTIFICATION_FORMAT, REPORT, RESULT
from idim_iv_ros.nodes.identifier.documents import Document, number, read_document


def read_result(folder: Path) -> Document:
    """Return the content of the result.json in a folder.

    Raises
    ------
    DataError
        There is none, or it is of another format.
    """
    return read_document(folder / RESULT, IDENTIFICATION_FORMAT)


def result_message(
    document: Document, stamp: Time, bags: Sequence[str], folder: str
) -> IdentificationResult:
    """Return the result as a message.

    Parameters
    ----------
    document
        Content of result.json.
    stamp
        When the identification ended.
    bags
        Relative to the bag directory.
    folder
        Of the files, relative to the output directory.

    Raises
    ------
    DataError
        A key is missing or has another type.
    """
    try:
        return _result(document, stamp, bags, folder)
    except (KeyError, TypeError, AssertionError, ValueError) as error:
        raise DataError(f"{folder}/{RESULT}: cannot be sent as a message: {error!r}") from error


def _result(
    document: Document, stamp: Time, bags: Sequence[str], folder: str
) -> IdentificationResult:
    fit, refined = document["fit"], document["refined"]
    message = IdentificationResult(
        parameters=_estimates(document, stamp, bags),
        instruments=[_test(each) for each in document["instruments"]["tests"]],
        instruments_source=document["instruments"]["source"],
        specification=[_test(each) for each in document["specification"]["tests"]],
        exogeneity=[_test(each) for each in document["exogeneity"]["tests"]],
        residuals=[_residual(each) for each in document["residuals"]],
        verdict=document["verdict"]["sentence"],
        relative_error_percent=number(fit["relative_error_percent"]),
        condition_number=number(fit["condition_number"]),
        samples=fit["samples"],
        effort_unit=document["effort_unit"],
        refined=refined is not None,
        duration=float(sum(document["timing"].values())),
        files=[f"{folder}/{name}" for name in (RESULT, REPORT)],
    )
    if refined is not None:
        message.refined_estimates = [_parameter(each) for each in refined["parameters"]]
    return message


def _estimates(document: Document, stamp: Time, bags: Sequence[str]) -> ParameterEstimates:
    message = ParameterEstimates(
        robot=document["robot"],
        estimator=document["estimator"],
        converged=document["converged"],
        convergence_note=document["convergence_note"],
        iterations=0 if document["estimator"] == "idim-ls" else document["iterations"],
        estimates=[_parameter(each) for each in document["parameters"]],
        covariance=[number(each) for row in document["covariance"] for each in row],
        bags=list(bags),
    )
    message.header.stamp = stamp
    return message


def _parameter(each: Document) -> ParameterEstimate:
    numbers = ("value", "std", "relative_std_percent", "ls_value", "given_value")
    return ParameterEstimate(
        name=each["name"],
        expression=each["expression"],
        unit=each["unit"],
        essential=each["essential"],
        **{name: number(each[name]) for name in numbers},
    )


def _test(each: Document) -> InstrumentTest:
    outcomes = {
        None: InstrumentTest.NOT_RUN,
        True: InstrumentTest.ACCEPTED,
        False: InstrumentTest.REJECTED,
    }
    numbers = ("statistic", "p_value", "alpha", "max_deviation", "torque_deviation_percent")
    return InstrumentTest(
        null_hypothesis=each["null"],
        scope=each["scope"],
        outcome=outcomes[each["accepted"]],
        df=each["df"] or 0,
        df_denom=each["df_denom"] or 0,
        reason=each["reason"] or "",
        **{name: number(each[name]) for name in numbers},
    )


def _residual(each: Document) -> ResidualDiagnosis:
    colours = {
        None: ResidualDiagnosis.NOT_TESTED,
        True: ResidualDiagnosis.WHITE,
        False: ResidualDiagnosis.COLOURED,
    }
    numbers = ("rms", "relative_percent", "whiteness_p_value", "normality_p_value")
    return ResidualDiagnosis(
        joint=each["joint"],
        ar_order=each["ar_order"],
        colour=colours[each["white"]],
        verdict=each["verdict"],
        sentence=each["sentence"],
        **{name: number(each[name]) for name in numbers},
    )
