"""From a simulated robot with an effect to its diagnosis and back, by the real commands."""

import json
from pathlib import Path

import numpy as np
import pytest

from tests.cli.conftest import CONFIG, refused, write_arm
from tests.cli.test_simulate import gap_file

ARM2 = CONFIG / "arm2.yaml"
RIPPLE = {
    "effect": "position_ripple",
    "joint": "joint_1",
    "parameters": {"wave_number_1": 21.0, "sine_1": 1.2, "cosine_1": 0.9},
}
NO_OFFSETS = {"off1": 0.0, "off2": 0.0}


@pytest.fixture
def rippled(run, tmp_path: Path):
    """Bags of an arm with ripple of 1.5 N m at joint 1, one for each seed of the noise."""

    def make(*seeds: int, seconds: int = 8) -> list[Path]:
        gap = gap_file(tmp_path / "truth.json", RIPPLE, parameters=NO_OFFSETS)
        bag = tmp_path / "arm.mcap"
        options = [word for seed in seeds for word in ("--seed", seed)]
        command = f"simulate --config {ARM2} --out {bag} --duration {seconds} --effects {gap}"
        run(command, *options, status=0)
        return [tmp_path / f"arm-{seed}.mcap" for seed in seeds] if len(seeds) > 1 else [bag]

    return make


def document(out: Path) -> dict:
    assert sorted(path.name for path in out.iterdir()) == ["gap.json", "report.html"]
    return json.loads((out / "gap.json").read_text(encoding="utf-8"))


def test_what_was_simulated_is_found_and_can_be_simulated_again(run, rippled, tmp_path) -> None:
    """One bag only: ripple within 10 %, then a robot with what was found."""
    (bag,) = rippled(1)
    out = tmp_path / "why"
    run("diagnose", bag, "--config", ARM2, "--out", out, status=0)
    result = document(out)
    (structural,) = [cause for cause in result["causes"] if cause["kind"] == "structural"]
    assert (structural["effect"], structural["joint"]) == ("position_ripple", "joint_1")
    assert result["verdict"] in ("structural", "both")
    assert "position ripple at joint_1" in result["summary"].lower()
    values = {name: cause["value"] for name, cause in structural["parameters"].items()}
    assert values["wave_number_1"] == pytest.approx(21.0, abs=0.3)
    assert np.hypot(values["sine_1"], values["cosine_1"]) == pytest.approx(1.5, rel=0.1)
    gap = structural["torque_gap"]
    assert gap["after"] < 0.6 * gap["before"]
    again = tmp_path / "again.mcap"
    command = f"simulate --config {ARM2} --out {again} --duration 2 --effects {out / 'gap.json'}"
    run(command, status=0)
    truth = json.loads((tmp_path / "again.truth.json").read_text())
    assert "position_ripple" in [effect["effect"] for effect in truth["effects"]]
    assert truth["MX1"] == pytest.approx(result["extended_parameters"]["MX1"]["value"])


def test_repeated_runs_give_a_floor_and_a_withheld_effect_is_not_named(run, rippled, tmp_path):
    bags = rippled(1, 2, seconds=5)
    out = tmp_path / "why"
    withheld = ("--without", "position_ripple")
    run("diagnose", *bags, "--config", ARM2, "--out", out, *withheld, status=0)
    result = document(out)
    assert result["without"] == ["position_ripple"]
    assert "position_ripple" not in [cause["effect"] for cause in result["causes"]]
    assert "on request: position_ripple" in result["summary"]
    assert [joint["floor_origin"] for joint in result["where"]["joints"]] == ["repeats"] * 2
    # White noise of 0.5 % of the limit, through a filter that passes a part of the band.
    for joint, noise in zip(result["where"]["joints"], (0.45, 0.175), strict=True):
        assert 0.1 * noise < joint["noise_floor"] < 0.6 * noise


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("reference: joint_reference", "reference: null", ("reference",)),
        ("  type: pd\n", "  type: unknown\n", ("names no control law", "fitted law")),
    ],
    ids=["no references", "unknown controller"],
)
def test_without_references_or_controller_it_ends_with_what_can_be_said(
    run, bag, config, tmp_path: Path, old: str, new: str, words: tuple[str, ...]
) -> None:
    gains = ()
    if "unknown" in new:
        gains = ("  kp: [1200.0, 250.0]   # N m/rad\n", "  kd: [52.0, 9.2]   # N m s/rad\n")
    out = tmp_path / "why"
    path = config((old, new), *((gain, "") for gain in gains))
    run("diagnose", bag, "--config", path, "--out", out, status=0)
    result = document(out)
    notes = " ".join(result["notes"]).lower()
    for word in words:
        assert word in notes, notes
    assert [stage["stage"] for stage in result["stages"]][:2] == ["given", "refit"]
    assert "controller_mismatch" not in [cause["effect"] for cause in result["causes"]]


def test_two_seconds_end_with_what_can_be_said(run, config, record, tmp_path: Path) -> None:
    short = write_arm(tmp_path / "short.mcap", record, slice(4000, 6000))
    out = tmp_path / "why"
    run("diagnose", short, "--config", config(), "--out", out, status=0)
    (note,) = [note for note in document(out)["notes"] if "record a minute" in note]
    assert note.startswith("only 2 s were recorded")
    page = (out / "report.html").read_text(encoding="utf-8")
    assert "from 2.00\N{NARROW NO-BREAK SPACE}s of recording" in page
    assert "structural" not in [cause["kind"] for cause in document(out)["causes"]]


def test_bad_input_is_one_line_and_leaves_nothing(run, bag, config, tmp_path: Path) -> None:
    """Beyond what every command refuses."""
    out, copy = tmp_path / "why", tmp_path / "copy.mcap"
    copy.write_bytes(bag.read_bytes())
    elsewhere = ("no topic /nowhere", "`reference: /joint_reference`")
    for status, bags, replacements, words in (
        (2, [bag, bag], (), ("the same recording", "give each one once")),
        (2, [bag, copy], (), ("copy.mcap", "arm2.mcap")),
        (1, [bag], [("joint_reference", "/nowhere")], elsewhere),
    ):
        arguments = (*bags, "--config", config(*replacements), "--out", out)
        refused(run("diagnose", *arguments), status, *words)
        assert not out.exists()
