"""The command around a diagnosis; what it computes is made up here."""

from dataclasses import replace
from pathlib import Path

import pytest

from idim_iv_ros.cli.diagnose import separated_sets
from idim_iv_ros.errors import UsageError
from idim_iv_ros.report.advice import contrast_headline
from tests.cli.conftest import refused
from tests.report.sample_gap import Case, sample_contrast, sample_gap


class StandIn:
    """Takes what the command passes on, and returns a diagnosis that was made before."""

    def __init__(self, case: Case = "both") -> None:
        self.case = case
        self.calls: list[tuple] = []

    def __call__(self, bags, configuration, *, without, against, progress):
        self.calls.append((tuple(bags), configuration.robot.joints, without))
        progress("candidates", 0.5)
        return sample_gap(2, self.case)


def test_verdict_causes_and_gaps_are_printed(diagnose, tmp_path: Path, capsys) -> None:
    diagnose(StandIn("both"))
    printed = " ".join(capsys.readouterr().out.split())
    assert printed.index("Verdict: parametric and structural") < printed.index("stribeck")
    for words in ("payload", "0.620 → 0.225 N m", "96 % (90 to 100)", "→ refit with causes"):
        assert words in printed
    assert "1 note" in printed and "2 untestable effects" in printed
    assert str(tmp_path / "why" / "report.html") in printed


def test_each_joint_has_its_own_units_and_what_slides_is_not_compared_with_what_turns(
    diagnose, capsys
) -> None:
    mixed = replace(sample_gap(2, "structural"), joint_types=("prismatic", "revolute"))
    diagnose(lambda *_, **__: mixed)
    rows = {line.split()[0]: line.split() for line in capsys.readouterr().out.splitlines()}
    first, last = mixed.stages[0], mixed.stages[-1]
    for joint, units in (("joint_1", ["N", "mm"]), ("joint_2", ["N", "m", "mrad"])):
        row = rows[joint]
        assert [word for word in row if word.isalpha() and word != "→"] == [
            *units[:-1], *units[:-1], units[-1]
        ]  # fmt: skip
        numbers = [float(word) for word in row[1:] if word[0].isdigit()]
        torques = [stage.torque_rms[joint] for stage in (first, last)]
        motions = [1e3 * stage.tracking_rms[joint] for stage in (first, last)]
        assert [*numbers[:2], *numbers[3:]] == pytest.approx([*torques, *motions], rel=0.01)


def test_an_effect_that_does_not_exist_is_refused_with_the_names(diagnose, tmp_path: Path) -> None:
    stand_in = StandIn()
    with pytest.raises(UsageError, match=r"strybeck.*payload.*stribeck") as refusal:
        diagnose(stand_in, without=["strybeck"])
    assert refusal.value.exit_status == 2
    assert stand_in.calls == []
    assert not (tmp_path / "why").exists()


@pytest.mark.parametrize(
    ("given", "read"),
    [
        ("a --against b c --out d", "a --against b --against c --out d"),
        ("--against b c -q", "--against b --against c -q"),
        ("--against b --against c", "--against b --against c"),
        ("--against b -- a c", "--against b -- a c"),
        ("a b --out d", "a b --out d"),
    ],
)
def test_names_behind_against_belong_to_it_up_to_the_next_option(given: str, read: str) -> None:
    assert list(separated_sets(given.split())) == read.split()


def test_what_changed_is_printed_before_the_reference_by_itself(diagnose, capsys) -> None:
    calls = []

    def stand_in(bags, configuration, *, without=(), against=(), progress=None):
        calls.append(tuple(against))
        return sample_contrast()

    sets = [Path("a.mcap")], [Path("b1.mcap"), Path("b2.mcap")]
    diagnose(stand_in, sets[0], against=sets[1])
    assert calls == [tuple(sets[1])]
    printed = " ".join(capsys.readouterr().out.split())
    result = sample_contrast()
    sentence = " ".join(" ".join(contrast_headline(result.contrast)).split())
    assert printed.count(sentence) == 1
    assert printed.index("Contrast:") < printed.index("Verdict:")
    assert "payload" in printed and "mass\xa0=\xa00.81" in printed.replace(" ", "\xa0")


def test_a_recording_in_both_sets_is_refused(run, bag: Path, config, tmp_path: Path) -> None:
    outcome = run(f"diagnose {bag} --against {bag} --config {config()} --out {tmp_path / 'why'}")
    refused(outcome, 2, "arm2.mcap")
    assert not (tmp_path / "why" / "gap.json").exists()
