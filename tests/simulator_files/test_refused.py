"""What is not exported: one line that says why, and nothing written."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from idim_iv_ros.configuration import load_configuration
from idim_iv_ros.errors import UsageError
from tests.simulator_files.cases import CONFIG, Case, case, cause


@pytest.fixture
def arm(tmp_path: Path) -> Case:
    return case(tmp_path, "arm2")


def refused(arm: Case, out: Path, match: str) -> None:
    with pytest.raises(UsageError, match=match) as refusal:
        arm.export(out)
    assert "\n" not in str(refusal.value)
    assert not out.exists()


def moved(arm: Case, folder: Path, old: str, new: str) -> Case:
    """The same result, and a URDF that was changed since."""
    urdf = arm.configuration.robot.urdf
    assert urdf is not None
    text = urdf.read_text(encoding="utf-8")
    assert old in text
    other = folder / "arm2.urdf"
    other.write_text(text.replace(old, new, 1), encoding="utf-8")
    section = arm.configuration.robot.model_copy(update={"urdf": other})
    return replace(arm, configuration=arm.configuration.model_copy(update={"robot": section}))


def test_a_result_of_another_robot(arm: Case, tmp_path: Path) -> None:
    other = replace(arm, configuration=load_configuration(CONFIG / "double_pendulum.yaml"))
    refused(other, tmp_path / "out", "joint_1, joint_2.*shoulder, elbow: another robot")


def test_a_urdf_whose_joints_were_moved_since(arm: Case, tmp_path: Path) -> None:
    changed = moved(arm, tmp_path, '<origin xyz="0.42 0 0"', '<origin xyz="0.43 0 0"')
    refused(changed, tmp_path / "out", "joints are placed or turned differently; run `idim-iv di")


def test_a_urdf_whose_masses_were_changed_since(arm: Case, tmp_path: Path) -> None:
    mass = arm.model.robot.given.inertial[1, 0]
    changed = moved(arm, tmp_path, f'<mass value="{mass:g}"', f'<mass value="{2 * mass:g}"')
    refused(changed, tmp_path / "out", "the nominal model changed since: ")


@pytest.mark.parametrize(
    ("planted", "words"),
    [
        (cause("magnetism", "joint_1", field=1.0), "magnetism@joint_1 is unknown to this"),
        (cause("time_delay", None, delay=3600.0), "a delay of 3600 s is no drive's"),
    ],
)
def test_effects_that_no_robot_of_this_version_has(
    planted: dict[str, Any], words: str, tmp_path: Path
) -> None:
    refused(case(tmp_path, "arm2", [planted]), tmp_path / "out", words)


def test_a_result_without_physical_parameters_says_why(arm: Case, tmp_path: Path) -> None:
    without = arm.with_gap(physical=None, why_no_physical="efforts are in A")
    refused(without, tmp_path / "out", "efforts are in A; then run `idim-iv diagnose` again")
    older = arm.with_gap(physical=None, kinematics="")
    refused(older, tmp_path / "out", "was written before .*; then run `idim-iv diagnose` again")


@pytest.mark.parametrize("content", ["", "{}", "[1]", '{"format": "idim_iv_ros/check/1"}'])
def test_what_is_no_result(arm: Case, tmp_path: Path, content: str) -> None:
    arm.path.write_text(content, encoding="utf-8")
    refused(arm, tmp_path / "out", str(arm.path))


def test_a_diagnosis_of_another_version_is_to_be_made_again(arm: Case, tmp_path: Path) -> None:
    text = arm.path.read_text(encoding="utf-8")
    arm.path.write_text(text.replace("idim_iv_ros/gap/1", "idim_iv_ros/gap/0"), encoding="utf-8")
    refused(arm, tmp_path / "out", "idim_iv_ros/gap/0.*`idim-iv diagnose`")


def test_a_folder_that_cannot_be_written(arm: Case, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("", encoding="utf-8")
    with pytest.raises(UsageError, match=r"cannot be written: .*; give another --out"):
        arm.export(tmp_path / "file" / "out")
    assert (tmp_path / "file").read_text(encoding="utf-8") == ""


def test_files_of_somebody_else_stay(arm: Case, tmp_path: Path) -> None:
    out = tmp_path / "out"
    out.mkdir()
    (out / "changes.md").write_text("mine", encoding="utf-8")
    with pytest.raises(UsageError, match="exists, and is not of an earlier export"):
        arm.export(out)
    assert [path.name for path in out.iterdir()] == ["changes.md"]
    arm.export(out, force=True)
    arm.export(out)  # its own files are replaced
    assert (out / "changes.md").read_text(encoding="utf-8") != "mine"


def test_a_disk_that_is_full_leaves_nothing(
    arm: Case, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    refused(arm, tmp_path / "out", "No space left on device")


def test_a_configuration_without_a_urdf(arm: Case, tmp_path: Path) -> None:
    section = arm.configuration.robot.model_copy(update={"urdf": None})
    without = replace(arm, configuration=arm.configuration.model_copy(update={"robot": section}))
    refused(without, tmp_path / "out", "robot.urdf is not given")


def test_a_physical_key_that_lacks_a_parameter(arm: Case, tmp_path: Path) -> None:
    content = json.loads(arm.path.read_text(encoding="utf-8"))
    del content["physical"]["parameters"][3]
    arm.path.write_text(json.dumps(content), encoding="utf-8")
    refused(arm, tmp_path / "out", "physical.parameters: YY1 is missing; run `idim-iv diagnose`")


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("Fv1", -0.1, "Fv1 is .*which no robot has"),
        ("YY2", 1e300, "YY2 is .*which no robot has"),
        ("Ia1", -1e-3, "Ia1 is .*which no robot has"),
        ("YY2", -1.0, "link link_2: no body is left for it"),
    ],
)
def test_numbers_that_no_robot_has(
    arm: Case, tmp_path: Path, name: str, value: float, words: str
) -> None:
    assert arm.gap.physical is not None
    parameters = tuple(
        replace(parameter, value=value) if parameter.name == name else parameter
        for parameter in arm.gap.physical.parameters
    )
    edited = arm.with_gap(physical=replace(arm.gap.physical, parameters=parameters))
    refused(edited, tmp_path / "out", words)
