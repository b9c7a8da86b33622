"""The exported URDF: right where it is read, and unchanged everywhere else."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from idim_iv_ros.configuration import Configuration, load_configuration
from idim_iv_ros.errors import UsageError
from idim_iv_ros.model import read_urdf_text
from tests.inputs import changed
from tests.simulator_files.cases import CONFIG, Case, bare, case, cause, refused

DECORATED = Path(__file__).with_name("decorated.urdf")


def configured(urdf: Path, joints: list[str]) -> Configuration:
    return Configuration.model_validate({"robot": {"urdf": urdf, "joints": joints}})


@pytest.fixture
def decorated(tmp_path: Path) -> Case:
    urdf = tmp_path / "decorated.urdf"
    urdf.write_bytes(DECORATED.read_bytes())
    return case(tmp_path, configured(urdf, ["shoulder", "elbow"]))


def test_inverse_dynamics_in_pinocchio_are_the_regressor_times_the_parameters(tmp_path) -> None:
    """Seven joints, pinocchio's own reader and RNEA; friction and drives by hand."""
    arm = case(tmp_path, "arm7")
    model = pin.buildModelFromUrdf(str(arm.export(tmp_path / "out").urdf))
    data = model.createData()
    names, values = arm.model.regressor.layout.names, arm.standard
    standard = np.array([values[name] for name in names])
    random = np.random.default_rng(0)
    q, dq, ddq = (random.uniform(-2.0, 2.0, (50, 7)) for _ in range(3))
    expected = arm.model.regressor(q, dq, ddq) @ standard
    of_kind = {
        kind: np.array([values[f"{kind}{joint}"] for joint in range(1, 8)])
        for kind in ("Ia", "Fv", "Fc", "off")
    }
    drives = of_kind["Ia"] * ddq + of_kind["Fv"] * dq + of_kind["Fc"] * np.sign(dq)
    exported = [pin.rnea(model, data, *row) for row in zip(q, dq, ddq, strict=True)]
    np.testing.assert_allclose(
        np.array(exported) + drives + of_kind["off"], expected, rtol=0.0, atol=1e-5
    )


def test_inertials_and_dynamics_change_and_nothing_else(decorated: Case, tmp_path: Path) -> None:
    before, after = DECORATED.read_bytes(), decorated.export(tmp_path / "out").urdf.read_bytes()
    changing: dict[str, tuple[str, ...]] = {"inertial": (), "dynamics": ()}
    assert after != before
    assert bare(after.decode(), changing) == bare(before.decode(), changing)
    assert after.startswith(before[: before.index(b"<robot")])
    for start, end in (
        (b"<ros2_control", b"</robot>"),
        (b"<visual>", b"<inertial>"),
        (b'<link name="camera">', b"</link>"),
        (b"<!-- with the motor", b"<origin"),
    ):
        part = before[before.index(start) :]
        assert part[: part.index(end, 1)] in after


def test_numbers_are_those_of_the_result_and_what_is_fixed_to_a_link_stays(decorated, tmp_path):
    """The camera's mass is taken out of what the shoulder carries, and the sum is the result."""
    text = decorated.export(tmp_path / "out").urdf.read_text(encoding="utf-8")
    model = pin.buildModelFromXML(text)
    standard = decorated.standard
    np.testing.assert_allclose(model.damping, [standard["Fv1"], standard["Fv2"]], rtol=1e-7)
    masses = [inertia.mass for inertia in model.inertias][1:]
    np.testing.assert_allclose(masses, [standard["M1"], standard["M2"]])
    assert '<mass value="0.2"/>' in text


def test_a_link_without_inertial_that_leaves_nothing_changes_with_what_it_carries(
    decorated: Case, tmp_path: Path
) -> None:
    """All that the elbow carries is the tool: a heavier tool is no link beside a given one."""
    made = decorated.export(tmp_path / "out")
    text = made.urdf.read_text(encoding="utf-8")
    assert ('name="fore"/>' in text) == any("changed together" in note for note in made.notes)
    model = pin.buildModelFromXML(text)
    exported = model.inertias[2].toDynamicParameters()
    assert exported[0] == pytest.approx(decorated.standard["M2"], rel=1e-7)
    assert exported[6] == pytest.approx(decorated.standard["YY2"], rel=1e-6)
    for inertia in list(model.inertias)[1:]:
        assert np.linalg.eigvalsh(inertia.toPseudoInertia().toMatrix())[0] > 0.0


def test_the_input_is_never_written_over(decorated: Case, tmp_path: Path) -> None:
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    with pytest.raises(UsageError, match=r"decorated\.urdf: was read for this export"):
        decorated.export(tmp_path, force=True)
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_a_load_that_is_heavier_than_the_joint_carries_changes_with_the_link(tmp_path) -> None:
    """The URDF says 0.2 kg of camera; the same result with 5 kg of it in the file is no link."""
    text = DECORATED.read_text(encoding="utf-8")
    heavy = text.replace('<mass value="0.2"/>', '<mass value="5.0"/>')
    urdf = tmp_path / "decorated.urdf"
    urdf.write_text(heavy, encoding="utf-8")
    arm = case(tmp_path, configured(urdf, ["shoulder", "elbow"]))
    light = {
        parameter.name: replace(parameter, value=0.3 * parameter.value)
        if parameter.name[-1] == "1"
        else parameter
        for parameter in arm.gap.physical.parameters
    }
    changed = replace(arm.gap.physical, parameters=tuple(light.values()))
    made = arm.with_gap(physical=changed).export(tmp_path / "out")
    assert any("upper and what is fixed behind it (camera)" in note for note in made.notes)
    model = pin.buildModelFromUrdf(str(made.urdf))
    assert model.inertias[1].mass == pytest.approx(0.3 * arm.standard["M1"], rel=1e-7)
    read = read_urdf_text(made.urdf.read_text(encoding="utf-8"), "exported")
    for name in ("upper", "camera"):
        inertial = read.links[name]
        assert inertial is not None and inertial.mass > 0.0
        assert np.linalg.eigvalsh(inertial.inertia)[0] > 0.0


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
