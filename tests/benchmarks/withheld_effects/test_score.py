"""How answers of the benchmark of withheld effects are scored."""

import hashlib
import json
import shlex
import sys

import pytest

from benchmarks.withheld_effects.generate import LABELS, OPTIONS, SEAL
from benchmarks.withheld_effects.run import run
from benchmarks.withheld_effects.score import score
from benchmarks.withheld_effects.tables import page_lines
from benchmarks.withheld_effects.verdict import Verdict, judge


def truth(effect, joint="joint_1", rho=2.0, kind="structural", joints=()):
    return {
        "effect": effect,
        "kind": kind,
        "joint": joint,
        "joints": list(joints),
        "rho_wanted": rho,
        "rho": rho,
        "reached": True,
        "measure": "refit",
    }


def label(*effects, group="single", altered=True):
    return {
        "group": group,
        "robot": "arm2",
        "altered": altered,
        "motion": "rich",
        "without": None,
        "effects": list(effects),
        "residual_rms": {
            "with": {"joint_1": 0.2, "joint_2": 0.1},
            "without": {"joint_1": 0.1, "joint_2": 0.1},
        },
    }


def cause(effect, joint="joint_1", kind="structural", alike=(), before=0.2, after=0.1):
    return {
        "effect": effect,
        "kind": kind,
        "joint": joint,
        "indistinguishable_from": [
            {"effect": name, "joint": place, "correlation": 0.97} for name, place in alike
        ],
        "torque_gap": {"before": before, "after": after},
    }


def gap(*causes, verdict="structural", not_testable=()):
    return {
        "format": "idim_iv_ros/gap/1",
        "verdict": verdict,
        "causes": list(causes),
        "not_testable": [{"effect": name, "joint": None} for name in not_testable],
    }


def score_of(label, document):
    return judge(label, Verdict.read(document), 1.0)


ALIKE = [("time_delay", "joint_1")]
COUPLING = truth("joint_coupling", "joint_2", joints=["joint_2", "joint_1"])


@pytest.mark.parametrize(
    ("actual", "said", "first", "false_alarms", "shrinkage"),
    [
        (truth("stribeck"), cause("stribeck"), True, (), 1.0),
        (truth("stribeck"), cause("stribeck", "joint_2"), False, ("stribeck[joint_2]",), 0.0),
        (truth("time_delay"), cause("elasticity", alike=ALIKE), True, (), 1.0),
        (COUPLING, cause("joint_coupling", "joint_1"), True, (), None),
        (truth("stribeck"), cause("stribeck", before=1.0, after=0.625**0.5), True, (), 0.5),
    ],
)
def test_a_cause_is_right_at_its_joint_or_in_the_set_of_the_first(
    actual, said, first, false_alarms, shrinkage
):
    """Half of the possible shrinkage counts half."""
    result = score_of(label(actual), gap(said))
    assert result.first is first
    assert result.false_alarms == false_alarms
    assert result.shrinkage == pytest.approx(shrinkage)
    assert result.set_size == 1 + len(said["indistinguishable_from"])


def test_parametric_causes_are_true_of_an_altered_robot_only():
    payload = gap(cause("payload", None, kind="parametric"), verdict="parametric")
    assert not score_of(label(group="none"), payload).false_alarms
    assert score_of(label(group="none", altered=False), payload).false_alarms


@pytest.fixture
def benchmark(tmp_path):
    labels = {"a" * 12: label(truth("stribeck")), "b" * 12: label(group="none", altered=False)}
    for name in labels:
        folder = tmp_path / "cells" / name
        folder.mkdir(parents=True)
        (folder / "recording_1.mcap").touch()
    text = json.dumps({"cells": labels})
    (tmp_path / LABELS).write_text(text)
    (tmp_path / SEAL).write_text(hashlib.sha256(text.encode()).hexdigest() + "  labels\n")
    (tmp_path / OPTIONS).write_text(json.dumps({"b" * 12: ["--without", "spring"]}))
    return tmp_path


def command(tmp_path, body):
    script = tmp_path / "diagnose.py"
    script.write_text(
        "import json, pathlib, sys\n"
        "out = pathlib.Path(sys.argv[sys.argv.index('--out') + 1])\n" + body
    )
    return f"{shlex.quote(sys.executable)} {shlex.quote(str(script))}"


def test_a_run_is_scored_and_goes_on_where_it_was(benchmark):
    answer = gap(cause("stribeck"))
    always = command(
        benchmark,
        f"(out / 'gap.json').write_text({json.dumps(answer)!r})\n"
        "(out / 'called.json').write_text(json.dumps(sys.argv[1:]))\n",
    )
    assert run(benchmark, always) == 0
    called = json.loads((benchmark / "verdicts" / ("b" * 12) / "called.json").read_text())
    assert called[-2:] == ["--without", "spring"]
    assert called[0].endswith("recording_1.mcap")
    scored = score(benchmark)
    page = "\n".join(page_lines(scored))
    assert "| false alarm on none, given parameters | 100.0 % (1/1" in page
    assert "| right effect and joint first, ρ ≥ 0.6 | 100.0 % (1/1" in page
    assert "| none: none → stribeck | 1 |" in page
    # Judged already: a command that fails is not called again.
    assert run(benchmark, command(benchmark, "sys.exit(3)\n")) == 0


def test_labels_changed_after_the_first_verdict_are_refused(benchmark):
    always = command(benchmark, f"(out / 'gap.json').write_text({json.dumps(gap())!r})\n")
    run(benchmark, always)
    text = json.dumps({"cells": {}})
    (benchmark / LABELS).write_text(text)
    (benchmark / SEAL).write_text(hashlib.sha256(text.encode()).hexdigest() + "  labels\n")
    with pytest.raises(ValueError, match="other labels"):
        score(benchmark)
