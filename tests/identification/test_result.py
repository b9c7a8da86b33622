"""result.json: what is written is what is read, and the keys of the design are there."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from jsonschema import Draft202012Validator

from idim_iv_ros.errors import UsageError
from idim_iv_ros.identification.result import IdentificationResult
from tests.report.sample_result import sample_result

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
