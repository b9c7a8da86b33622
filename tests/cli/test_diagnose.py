"""The command around a diagnosis; what it computes is made up here."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from idim_iv_ros.diagnosis.result import GapResult
from idim_iv_ros.errors import UsageError
from tests.report.sample_gap import CASES, Case, sample_gap


class StandIn:
    """Takes what the command passes on, and returns a diagnosis that was made before."""

    def __init__(self, case: Case = "both") -> None:
        self.case = case
        self.calls: list[tuple] = []

    def __call__(self, bags, configuration, *, without, against, nominal, progress):
        self.calls.append((tuple(bags), configuration.robot.joints, without))
        progress("candidates", 0.5)
        return sample_gap(2, self.case)


def test_verdict_causes_stages_and_limits_are_printed(diagnose, tmp_path: Path, capsys) -> None:
    diagnose(StandIn("both"), verbose=True)
    printed = " ".join(capsys.readouterr().out.split())
    result = sample_gap(2, "both")
    assert printed.index("Verdict: parametric and structural") < printed.index("Causes")
    assert " ".join(result.summary.split()) in printed
    for words in ("payload", "stribeck", "0.620 → 0.225 N m", "96 % (90 to 100)", "presliding"):
        assert words in printed
    for words in ("nominal model", "+ stribeck at joint_2", "noise floor", "torque saturation"):
        assert words in printed
    assert str(tmp_path / "why" / "report.html") in printed


def test_each_joint_has_its_own_units_and_what_slides_is_not_compared_with_what_turns(
    diagnose, capsys
) -> None:
    mixed = replace(sample_gap(2, "structural"), joint_types=("prismatic", "revolute"))
    diagnose(lambda *_, **__: mixed, verbose=True)
    printed = capsys.readouterr().out
    rows = [line.split() for line in printed.splitlines() if line.split()[:1] == ["refit"]]
    refit = next(stage for stage in mixed.stages if stage.name == "refit")
    tracking = refit.tracking_rms
    assert tracking is not None
    slides, turns = rows
    assert (slides[2], slides[4]) == ("N", "mm")
    assert (*turns[2:4], turns[5]) == ("N", "m", "mrad")
    assert float(slides[1]) == pytest.approx(refit.torque_rms["joint_1"], rel=0.01)
    assert float(slides[3]) == pytest.approx(1e3 * tracking["joint_1"], rel=0.01)
    assert float(turns[4]) == pytest.approx(1e3 * tracking["joint_2"], rel=0.01)


@pytest.mark.parametrize("case", CASES)
def test_every_verdict_is_written_and_fits_on_a_screen(diagnose, tmp_path, capsys, case) -> None:
    diagnose(StandIn(case))
    out = tmp_path / "why"
    assert sorted(path.name for path in out.iterdir()) == ["gap.json", "report.html"]
    assert GapResult.read(out / "gap.json").verdict == sample_gap(2, case).verdict
    assert 5 < len(capsys.readouterr().out.splitlines()) <= 40


def test_effects_are_left_out_once(diagnose) -> None:
    stand_in = StandIn()
    bags = [Path("a.mcap"), Path("b.mcap")]
    diagnose(stand_in, bags, without=["stribeck", "payload", "stribeck"])
    ((bags, joints, without),) = stand_in.calls
    assert bags == (Path("a.mcap"), Path("b.mcap"))
    assert joints == ["joint_1", "joint_2"]
    assert without == ("stribeck", "payload")


def test_an_effect_that_does_not_exist_is_refused_with_the_names(diagnose, tmp_path: Path) -> None:
    stand_in = StandIn()
    with pytest.raises(UsageError, match=r"strybeck.*payload.*stribeck") as refusal:
        diagnose(stand_in, without=["strybeck"])
    assert refusal.value.exit_status == 2
    assert "\n" not in str(refusal.value)
    assert stand_in.calls == []
    assert not (tmp_path / "why").exists()


def test_a_place_that_cannot_be_written_is_refused_before_the_work(diagnose, tmp_path) -> None:
    taken = tmp_path / "taken"
    (taken / "gap.json").mkdir(parents=True)
    stand_in = StandIn()
    with pytest.raises(UsageError, match=r"gap\.json is a folder"):
        diagnose(stand_in, out=taken)
    assert stand_in.calls == []


def test_brackets_in_names_are_printed_as_they_are(diagnose, tmp_path: Path, capsys) -> None:
    named = sample_gap(2, "structural", first="[red]arm[/]")
    diagnose(lambda *_, **__: named)
    assert "[red]arm[/]" in "".join(capsys.readouterr().out.split())
    document = json.loads((tmp_path / "why" / "gap.json").read_text(encoding="utf-8"))
    assert document["joints"][0] == "[red]arm[/]"
