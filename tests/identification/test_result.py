"""The result of an identification: what is written, read back and remarked."""

import io
import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from jsonschema import Draft202012Validator
from rich.console import Console

from bags.simulated_arms import arm6
from idim_iv_ros.cli.identify import print_parameters, print_verdict
from idim_iv_ros.errors import UsageError
from idim_iv_ros.identification.identify import refined_result
from idim_iv_ros.identification.result import IMPOSSIBLE, NOT_SIGNIFICANT, IdentificationResult
from idim_iv_ros.model import build_inverse_model
from idim_iv_ros.report.page import report_html
from tests.report.sample_result import sample_result


def with_value(value: float, std: float, non_negative: bool) -> IdentificationResult:
    """Return a result whose first parameter, essential, has this value."""
    result = sample_result()
    first, *others = result.parameters
    changed = replace(
        first,
        name="FvX",
        value=value,
        std=std,
        essential=True,
        essential_value=value,
        essential_std=std,
        non_negative=non_negative,
    )
    return replace(result, parameters=(changed, *others))


def printed(*prints: Callable[[Console], None]) -> str:
    text = io.StringIO()
    for one in prints:
        one(Console(file=text, width=300))
    return text.getvalue()


@pytest.mark.parametrize(
    ("value", "std", "non_negative", "remark"),
    [
        (-0.5, 0.1, True, IMPOSSIBLE),
        (-0.1, 0.1, True, NOT_SIGNIFICANT),  # it may be zero
        (-0.5, 0.1, False, ""),  # a first moment, an offset
        (0.1, 0.4, True, NOT_SIGNIFICANT),  # σ of 400 %
        (0.5, 0.1, True, ""),
    ],
)
def test_a_value_says_why_not_to_rely_on_it(value, std, non_negative, remark, monkeypatch) -> None:
    monkeypatch.setattr("idim_iv_ros.cli.identify.LONGEST", None)
    result = with_value(value, std, non_negative)
    parameter = result.to_document()["parameters"][0]
    assert (parameter["remark"], parameter["essential_remark"]) == (remark, remark)
    text = printed(lambda console: print_parameters(console, result))
    (line,) = [line for line in text.splitlines() if "FvX" in line]
    html = report_html(result)
    row = html[html.index(">FvX<", html.index('<section id="parameters"')) :].split("</tr>")[0]
    for known_remark in (IMPOSSIBLE, NOT_SIGNIFICANT):
        assert (known_remark in line) == (known_remark == remark)
        assert (known_remark in row) == (known_remark == remark)
    assert ("Some values are physically impossible" in html) == (remark == IMPOSSIBLE)


def test_sums_of_masses_inertias_and_friction_may_not_be_negative() -> None:
    arm = arm6(seconds=1.0)
    urdf = arm.configuration.robot.urdf
    base = build_inverse_model(arm.configuration, urdf.read_text(), urdf.name).base
    forbidden = {name for name, never in zip(base.names, base.non_negative, strict=True) if never}
    kinds = ("Ia", "Fv", "Fc")
    assert {f"{kind}{k}" for kind in kinds for k in range(1, 7)} & set(base.names) <= forbidden
    assert not any(name.startswith(("off", "M", "XY", "XZ", "YZ")) for name in forbidden)
    sums = zip(base.names, base.expressions, strict=True)
    minus = {name for name, expression in sums if " - " in expression}
    assert minus
    assert not forbidden & minus
    # Of any robot that can be built they are not: random positive values.
    signed = ("XY", "XZ", "YZ", "MX", "MY", "MZ", "off")
    low = [-1.0 if parameter.kind in signed else 0.0 for parameter in base.layout.parameters]
    standard = np.random.default_rng(3).uniform(low, 1.0)
    values = dict(zip(base.names, base.from_standard(standard), strict=True))
    assert all(values[name] >= 0.0 for name in forbidden)


@pytest.mark.parametrize(("deviations", "essential"), [(2.9, True), (3.1, True), (9.0, False)])
def test_an_essential_parameter_that_whitening_moves_beyond_noise_is_named(deviations, essential):
    result = sample_result(2, "coloured")
    first, *others = result.refined.parameters
    parameter = replace(result.parameters[0], essential=essential)
    far = replace(
        first, value=parameter.value + deviations * float(np.hypot(parameter.std, first.std))
    )
    estimates = (far, *others)
    values = np.array([estimate.value for estimate in estimates])
    covariance = np.diag([estimate.std**2 for estimate in estimates])
    made = refined_result(values, covariance, (), (parameter, *result.parameters[1:]))
    assert made.moved == ((parameter.name,) if essential and deviations > 3.0 else ())


def test_the_relative_error_of_each_joint_is_printed_and_saved() -> None:
    result = sample_result()
    errors = {result.joints[0]: 12.3456, result.joints[1]: None}
    result = replace(result, fit=replace(result.fit, joint_relative_error_percent=errors))
    assert result.to_document()["fit"]["joint_relative_error_percent"] == errors
    text = printed(lambda console: print_verdict(console, result))
    assert f"{result.joints[0]} 12.3 %, {result.joints[1]} –" in text


CASES = ("white", "coloured", "rejected", "untested")


def test_numbers_that_do_not_exist_are_null_and_the_others_keep_every_digit() -> None:
    result = sample_result(1, "white")
    odd = replace(result.parameters[0], value=np.float64(0.1) + 0.2, std=np.nan, given_value=np.inf)
    result = replace(
        result,
        parameters=(odd, *result.parameters[1:]),
        fit=replace(result.fit, condition_number=np.inf, samples=np.int64(7)),
        converged=np.bool_(True),
    )
    document = json.loads(result.to_json())
    assert document["parameters"][0]["value"] == 0.1 + 0.2
    assert document["parameters"][0]["std"] is None
    assert document["parameters"][0]["relative_std_percent"] is None
    assert document["parameters"][0]["given_value"] is None
    assert document["fit"]["condition_number"] is None
    assert document["fit"]["samples"] == 7
    assert document["converged"] is True


def test_what_has_no_place_in_json_is_refused() -> None:
    with pytest.raises(TypeError, match="object has no place"):
        replace(sample_result(1), configuration={"key": object()}).to_json()


@pytest.mark.parametrize("case", CASES)
def test_what_is_written_is_read_back(tmp_path: Path, case: str) -> None:
    result = sample_result(2, case)
    path = tmp_path / "result.json"
    result.write(path)
    read = IdentificationResult.read(path)
    assert read == result
    np.testing.assert_array_equal(read.covariance, result.covariance)
    assert read.to_json() == path.read_text(encoding="utf-8")
    assert read.series == ()
    assert read.residuals[0].acf.size == 0


def test_a_gap_json_is_no_identification(tmp_path: Path) -> None:
    path = tmp_path / "gap.json"
    path.write_text('{"format": "idim_iv_ros/gap/1"}')
    with pytest.raises(UsageError, match=r"gap.json: not an identification: .*idim_iv_ros/gap/1"):
        IdentificationResult.read(path)


@pytest.mark.parametrize("case", CASES)
def test_the_committed_schema_describes_what_is_written(case: str) -> None:
    folder = Path(__file__).resolve().parents[2] / "docs" / "schemas"
    schema = json.loads((folder / "result.schema.json").read_text(encoding="utf-8"))
    validator = Draft202012Validator(schema)
    document = sample_result(2, case).to_document()
    validator.validate(document)
    assert not validator.is_valid({**document, "later": 1})
    for key in document:
        assert not validator.is_valid(
            {other: document[other] for other in document if other != key}
        )
