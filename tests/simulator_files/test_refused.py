"""What is not exported: one line that says why, and nothing written."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from idim_iv_ros.configuration import load_configuration
from idim_iv_ros.errors import UsageError
from tests.inputs import changed
from tests.simulator_files.cases import CONFIG, Case, case, cause, refused

Change = Callable[[Case, Path], Case]


@pytest.fixture
def arm(tmp_path: Path) -> Case:
    return case(tmp_path, "arm2")


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


def with_urdf(arm: Case, urdf: Path | None) -> Case:
    return replace(arm, configuration=changed(arm.configuration, "robot", urdf=urdf))


def since(old: str, new: str) -> Change:
    """The same result, and a URDF that was changed since."""

    def change(arm: Case, folder: Path) -> Case:
        text = (CONFIG / "arm2.urdf").read_text(encoding="utf-8")
        assert old in text
        (folder / "arm2.urdf").write_text(text.replace(old, new, 1), encoding="utf-8")
        return with_urdf(arm, folder / "arm2.urdf")

    return change


def written(change: Callable[[str], str]) -> Change:
    """Another text in the file of the result."""

    def changed(arm: Case, _: Path) -> Case:
        arm.path.write_text(change(arm.path.read_text(encoding="utf-8")), encoding="utf-8")
        return arm

    return changed


def with_cause(effect: str, joint: str | None, **numbers: float) -> Change:
    return lambda arm, folder: case(folder, "arm2", [cause(effect, joint, **numbers)])


def with_number(name: str, value: float) -> Change:
    def change(arm: Case, _: Path) -> Case:
        parameters = tuple(
            replace(parameter, value=value) if parameter.name == name else parameter
            for parameter in arm.gap.physical.parameters
        )
        return arm.with_gap(physical=replace(arm.gap.physical, parameters=parameters))

    return change


def without_yy1(text: str) -> str:
    content = json.loads(text)
    del content["physical"]["parameters"][3]
    return json.dumps(content)


def of_another_robot(arm: Case, _: Path) -> Case:
    return replace(arm, configuration=load_configuration(CONFIG / "double_pendulum.yaml"))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (of_another_robot, "joint_1, joint_2.*shoulder, elbow: another robot"),
        (since('<origin xyz="0.42 0 0"', '<origin xyz="0.43 0 0"'), "joints are placed or turned"),
        (since('<mass value="2.3"', '<mass value="4.6"'), "the nominal model changed since: "),
        (lambda arm, _: with_urdf(arm, None), "robot.urdf is not given"),
        (with_cause("magnetism", "joint_1", field=1.0), "magnetism@joint_1 is unknown to this"),
        (with_cause("time_delay", None, delay=3600.0), "a delay of 3600 s is no drive's"),
        (lambda arm, _: arm.with_gap(physical=None, why_no_physical="efforts are in A"),
         "efforts are in A; then run `idim-iv diagnose` again"),
        (lambda arm, _: arm.with_gap(physical=None, kinematics=""),
         "was written before .*; then run `idim-iv diagnose` again"),
        (written(lambda _: ""), r"gap\.json"),
        (written(lambda _: "{}"), r"gap\.json"),
        (written(lambda _: "[1]"), r"gap\.json"),
        (written(lambda _: '{"format": "idim_iv_ros/check/1"}'), r"gap\.json"),
        (written(lambda text: text.replace("idim_iv_ros/gap/1", "idim_iv_ros/gap/0")),
         "idim_iv_ros/gap/0.*`idim-iv diagnose`"),
        (written(without_yy1), "physical.parameters: YY1 is missing; run `idim-iv diagnose`"),
        (with_number("Fv1", -0.1), "Fv1 is .*which no robot has"),
        (with_number("YY2", 1e300), "YY2 is .*which no robot has"),
        (with_number("Ia1", -1e-3), "Ia1 is .*which no robot has"),
        (with_number("YY2", -1.0), "link link_2: no body is left for it"),
    ],
)  # fmt: skip
def test_what_cannot_be_exported_is_one_line_and_nothing_is_written(arm, tmp_path, change, words):
    refused(change(arm, tmp_path), tmp_path / "out", words)
