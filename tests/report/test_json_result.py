import json
from dataclasses import replace

import numpy as np
import pytest

from idim_iv_ros.report import result_document
from idim_iv_ros.report.json_result import plain, result_text
from tests.report.sample_result import sample_result

CASES = ("white", "coloured", "rejected", "untested")
PARAMETER = {
    "name",
    "expression",
    "unit",
    "value",
    "std",
    "relative_std_percent",
    "essential",
    "ls_value",
    "given_value",
}
TEST = {"scope", "statistic", "df", "df_denom", "p_value", "max_deviation", "accepted", "reason"}


@pytest.mark.parametrize("case", CASES)
def test_the_document_has_every_key_of_the_design(case: str) -> None:
    document = result_document(sample_result(2, case))
    assert document["format"] == "idim_iv_ros/identification/1"
    assert {"robot", "bags", "software", "estimator", "iterations", "converged"} <= set(document)
    assert {"instruments", "exogeneity", "fit", "refined", "timing"} <= set(document)
    for parameter in document["parameters"]:
        assert set(parameter) >= PARAMETER
    assert [row[k] ** 0.5 for k, row in enumerate(document["covariance"])] == pytest.approx(
        [parameter["std"] for parameter in document["parameters"]]
    )
    for part in ("instruments", "specification", "exogeneity"):
        assert set(document[part]) >= {"accepted", "alpha", "tests"}
        scopes = [test["scope"] for test in document[part]["tests"]]
        if part == "specification":
            families = ("position", "acceleration", "speed")
            assert scopes == [f"joint_{k}: {family}" for k in (1, 2) for family in families]
        else:
            assert scopes == ["all", "joint_1", "joint_2"]
        for test in document[part]["tests"]:
            assert set(test) >= TEST
    for residual in document["residuals"]:
        assert set(residual) >= {
            "joint",
            "rms",
            "relative_percent",
            "ar_order",
            "white",
            "whiteness_p_value",
            "normality_p_value",
            "verdict",
        }
    assert set(document["fit"]) >= {
        "relative_error_percent",
        "condition_number",
        "samples",
        "base_parameters",
        "essential_parameters",
    }


def test_refined_is_null_or_has_orders_and_parameters_with_all_columns() -> None:
    assert result_document(sample_result(2, "white"))["refined"] is None
    refined = result_document(sample_result(2, "coloured"))["refined"]
    assert len(refined["ar_orders"]) == 2
    assert all(set(parameter) >= PARAMETER for parameter in refined["parameters"])
    assert refined["parameters"][0]["ls_value"] is not None


def test_a_test_that_was_not_run_has_its_reason_and_null_numbers() -> None:
    document = result_document(sample_result(1, "untested"))
    assert document["instruments"]["accepted"] is None
    for test in document["instruments"]["tests"]:
        assert test["reason"] == "IDIM-LS uses no instruments"
        assert test["statistic"] is None
        assert test["p_value"] is None
        assert test["accepted"] is None


def test_numbers_that_do_not_exist_are_null_and_the_others_keep_every_digit() -> None:
    result = sample_result(1, "white")
    odd = replace(result.parameters[0], value=np.float64(0.1) + 0.2, std=np.nan, given_value=np.inf)
    result = replace(
        result,
        parameters=(odd, *result.parameters[1:]),
        fit=replace(result.fit, condition_number=np.inf, samples=np.int64(7)),
        converged=np.bool_(True),
    )
    document = json.loads(result_text(result))
    assert document["parameters"][0]["value"] == 0.1 + 0.2
    assert document["parameters"][0]["std"] is None
    assert document["parameters"][0]["relative_std_percent"] is None
    assert document["parameters"][0]["given_value"] is None
    assert document["fit"]["condition_number"] is None
    assert document["fit"]["samples"] == 7
    assert document["converged"] is True


def test_the_same_result_gives_the_same_text() -> None:
    assert result_text(sample_result(3)) == result_text(sample_result(3))


def test_a_document_is_its_own_json() -> None:
    document = result_document(sample_result(6, "rejected"))
    assert json.loads(json.dumps(document)) == document


def test_what_has_no_place_in_json_is_refused() -> None:
    with pytest.raises(TypeError, match="object has no place"):
        plain({"key": object()})
