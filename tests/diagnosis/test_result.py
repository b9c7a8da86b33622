"""gap.json: what is written is what is read, and what is no gap.json is refused in one line."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from jsonschema import Draft202012Validator

from idim_iv_ros.diagnosis.result.document import GapResult, Regime, Where
from idim_iv_ros.diagnosis.result.recordings import Transmission
from idim_iv_ros.effects.cause import EffectParameter
from idim_iv_ros.errors import UsageError
from idim_iv_ros.report.write import write_report
from tests.report.sample_gap import CASES, sample_contrast, sample_gap

DOCS = Path(__file__).resolve().parents[2] / "docs" / "schemas"


def test_numbers_that_do_not_exist_are_null() -> None:
    result = sample_gap(2, "structural", floor=False)
    regime = Regime("joint_1", "speed", 0.6, np.inf, "rad/s", np.nan, 0.0, np.inf, None)
    first = replace(result.causes[0], torque_gap=replace(result.causes[0].torque_gap, ci95=None))
    result = replace(
        result,
        where=Where((), (regime,)),
        causes=(first,),
        timing={"fit": float("nan")},
        configuration={"limit": np.float32(np.inf), "path": Path("a/b"), "ids": (1, 2)},
    )
    text = result.to_json()
    assert "NaN" not in text
    assert "Infinity" not in text
    document = json.loads(text)
    (written,) = document["where"]["regimes"]
    assert (written["high"], written["energy_share"], written["lift"]) == (None, None, None)
    (read,) = GapResult.from_json(text, "gap.json").where.regimes
    assert (read.low, read.high, read.occupancy) == (0.6, np.inf, 0.0)
    assert np.isnan(read.energy_share)
    assert document["causes"][0]["torque_gap"]["noise_floor"] is None
    assert document["timing"] == {"fit": None}
    assert document["configuration"] == {"limit": None, "path": "a/b", "ids": [1, 2]}


def everything() -> GapResult:
    """A contrast, hints and a transmission."""
    stiffness, offset = EffectParameter(8e3, 40.0, "N m/rad"), EffectParameter(4e-4, 2e-5, "s")
    gear = Transmission(
        joint="joint_1", stiffness=stiffness, time_offset=offset, position_error=True
    )
    return replace(sample_contrast(), hints=sample_gap(2, "none").hints, transmissions=(gear,))


@pytest.mark.parametrize("result", [*(sample_gap(2, case) for case in CASES), everything()])
def test_what_is_written_passes_the_check_and_is_read_back(tmp_path, result: GapResult) -> None:
    written, page = write_report(result, tmp_path / "new")
    read = GapResult.read(written)
    assert read == result
    assert read.to_json() == written.read_text(encoding="utf-8")
    assert (read.series, read.tracking) == ((), ())
    assert page.name == "report.html"
    assert sorted(path.name for path in written.parent.iterdir()) == ["gap.json", "report.html"]


def _change(document: dict, keys: tuple, value: object) -> None:
    for key in keys[:-1]:
        document = document[key]
    if value is None:
        del document[keys[-1]]
    else:
        document[keys[-1]] = value


@pytest.mark.parametrize(
    ("keys", "value", "words"),
    [
        (("verdict",), "maybe", "verdict"),
        (("verdict",), None, "verdict"),
        (("causes", 0, "effect"), None, "causes.0.effect"),
        (("causes", 0, "kind"), "physical", "causes.0.kind"),
        (("causes", 0, "parameters", "speed", "value"), "0.1", "causes.0.parameters.speed.value"),
        (("where", "joints", 1, "rms"), "large", "where.joints.1.rms"),
        (("stages", 0, "torque_rms", "joint_1"), [1], "stages.0.torque_rms.joint_1"),
        (("format",), "idim_iv_ros/gap/2", "idim_iv_ros/gap/2"),
        (("format",), None, "not a diagnosis"),
        (("joint_types",), None, "key joint_types is missing; write it with this version's"),
        (("later",), 1, "unknown key later; write it"),
        (("causes", 0, "later"), 1, "unknown key causes.0.later"),
        (("causes", 0, "sen\ntence"), 1, "unknown key causes.0.sen tence"),
    ],
)
def test_a_file_of_another_format_is_refused_with_the_key(tmp_path, keys, value, words) -> None:
    document = sample_gap(2, "structural").to_document()
    _change(document, keys, value)
    path = tmp_path / "gap.json"
    path.write_text(json.dumps(document), encoding="utf-8")
    with pytest.raises(UsageError) as refusal:
        GapResult.read(path)
    assert words in str(refusal.value)
    assert str(path) in str(refusal.value)


@pytest.mark.parametrize("content", [b"", b"{", b"[]", b"\xff\xfe", b'{"format": NaN}', b"1"])
def test_what_is_no_diagnosis_is_refused_in_one_line(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "gap.json"
    path.write_bytes(content)
    with pytest.raises(UsageError):
        GapResult.read(path)
    with pytest.raises(UsageError, match="none"):
        GapResult.read(tmp_path / "none.json")


@pytest.mark.parametrize("joints", [2, 6])
@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("bare", [False, True])
def test_the_committed_schema_describes_what_is_written(joints, case, bare) -> None:
    schema = json.loads((DOCS / "gap.schema.json").read_text(encoding="utf-8"))
    validator = Draft202012Validator(schema)
    result = sample_gap(joints, case, given=not bare, floor=not bare, tracking=not bare)
    document = result.to_document()
    validator.validate(document)
    assert document["verdict"] == case
    assert [cause["effect"] for cause in document["causes"]] == [
        cause.effect for cause in result.causes
    ]
    assert all((stage["tracking_rms"] is None) == bare for stage in document["stages"])
    for wrong in ({**document, "later": 1}, {**document, "verdict": "maybe"}):
        assert not validator.is_valid(wrong)
    assert not validator.is_valid({key: document[key] for key in document if key != "stages"})
