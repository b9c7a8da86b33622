"""An MJCF in the place of the URDF: the same answers at every command."""

import json
import re
from pathlib import Path

import pytest

from idim_iv_ros.configuration import load_configuration
from idim_iv_ros.report.section import read_nominal
from tests.cli.conftest import CONFIG, refused, write_arm
from tests.model.test_mjcf import ARM2


def as_mjcf(config, folder: Path) -> Path:
    """Arm2's configuration with the MJCF, which holds the armature too."""
    (folder / "arm2.xml").write_text(ARM2, encoding="utf-8")
    path = config(
        (f"urdf: {CONFIG / 'arm2.urdf'}", f"mjcf: {folder / 'arm2.xml'}"),
        ("simulator:\n  armature: [0.25, 0.1]   # kg m², joint side\n", ""),
    )
    return path.rename(folder / "mjcf.yaml")


def answer(path: Path) -> object:
    """What a diagnosis says, without times, paths and configuration."""
    document = json.loads(path.read_text())
    keys = ("verdict", "causes", "stages", "unexplained", "refit_parameters", "given_parameters")
    return {key: document[key] for key in keys if key in document}


def close(one: object, other: object) -> bool:
    """Whether two documents agree, numbers to a millionth."""
    if isinstance(one, dict) and isinstance(other, dict):
        return one.keys() == other.keys() and all(close(one[k], other[k]) for k in one)
    if isinstance(one, list) and isinstance(other, list):
        return len(one) == len(other) and all(map(close, one, other))
    if isinstance(one, float) and isinstance(other, float):
        return abs(one - other) <= 1e-6 * max(abs(one), abs(other), 1e-6)
    return one == other


def test_the_same_arm_as_urdf_and_mjcf_has_the_same_diagnosis(run, config, record, tmp_path):
    bag, answers = write_arm(tmp_path / "short.mcap", record, slice(0, 5000)), []
    for name, path in (("mjcf", as_mjcf(config, tmp_path)), ("urdf", config())):
        run("diagnose", bag, "--config", path, "--out", tmp_path / name, status=0)
        answers.append(answer(tmp_path / name / "gap.json"))
        document = json.loads((tmp_path / name / "gap.json").read_text())
        assert read_nominal(document["configuration"]).skeleton is not None
    page = (tmp_path / "mjcf" / "report.html").read_text()
    assert "joint_1@frictionloss" in page and "joint_2@armature" in page
    assert "simulator.armature[" not in page and "/dynamics@" not in page
    assert answers[0]["verdict"] == "parametric"  # type: ignore[index]
    assert close(*answers), answers


def test_a_first_configuration_names_an_mjcf_and_can_be_used(run, bag, tmp_path: Path) -> None:
    (tmp_path / "arm2.xml").write_text(ARM2, encoding="utf-8")
    out = tmp_path / "arm.yaml"
    run("init", bag, "--urdf", tmp_path / "arm2.xml", "--out", out, status=0)
    assert re.search(r"^  mjcf: arm2\.xml", out.read_text(), flags=re.MULTILINE)
    assert load_configuration(out).robot.joints == ["joint_1", "joint_2"]
    for command in ("check", "identify"):
        more = ("--out", tmp_path / command) if command == "identify" else ()
        run(command, bag, "--config", out, *more, status=0)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("  joints: [", "  mjcf: arm2.xml\n  joints: [", ("urdf", "mjcf")),
        (f"urdf: {CONFIG / 'arm2.urdf'}", "mjcf: nothing.xml", ("robot.mjcf", "nothing.xml")),
    ],
)
def test_an_mjcf_beside_a_urdf_or_that_is_missing_is_refused(run, config, bag, old, new, words):
    refused(run("check", bag, "--config", config((old, new))), 2, *words)
