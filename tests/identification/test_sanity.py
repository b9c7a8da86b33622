"""Signals that contradict their robot are said to, and those of sound robots are not."""

import re
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from bags.simulated_arms import SimulatedArm, arm2, arm6, joint_topics, record
from idim_iv_ros.configuration import Configuration
from idim_iv_ros.diagnosis.diagnose import diagnose
from idim_iv_ros.errors import DataError
from idim_iv_ros.first_configuration.proposal import propose_configuration
from idim_iv_ros.identification.check import CheckReport, check, count_reversals
from idim_iv_ros.identification.identify import identify
from idim_iv_ros.identification.prepare import prepare, read_configured
from idim_iv_ros.identification.sanity import in_smaller_units
from idim_iv_ros.recording.writing.write import write_bag
from idim_iv_ros.report.advice import diagnosis_headline
from idim_iv_ros.simulation import SimulatedRecording, inverse_dynamics
from idim_iv_ros.types import FloatArray
from tests.estimation.test_simulated_arms import recording_of
from tests.inputs import changed

Change = Callable[[SimulatedArm, SimulatedRecording], SimulatedRecording]
ARM = arm2(seconds=10.0, rate=500.0)
JOINT = 1  # joint_2, whose torque has both signs


@cache
def recording() -> SimulatedRecording:
    """Ten seconds of the arm with its nominal sensors."""
    return record(ARM, 1)


def bag(folder: Path, arm: SimulatedArm, recorded: SimulatedRecording) -> Path:
    path = folder / "run.mcap"
    write_bag(path, joint_topics(arm, recorded))
    return path


def checked(
    folder: Path,
    recorded: SimulatedRecording,
    arm: SimulatedArm = ARM,
    configuration: Configuration | None = None,
) -> CheckReport:
    return check([bag(folder, arm, recorded)], configuration or arm.configuration)


def where(report: CheckReport, level: str) -> list[str]:
    return sorted({finding.where for finding in report.findings if finding.level == level})


def with_effort(values: FloatArray, recorded: SimulatedRecording) -> SimulatedRecording:
    """The recording with another effort of joint_2."""
    effort = recorded.effort.copy()
    effort[:, JOINT] = values
    return replace(recorded, effort=effort)


def slower(arm: SimulatedArm, times: float) -> SimulatedArm:
    """The first part of the same path, so many times slower."""
    index = np.arange(len(arm.position_reference))
    position, velocity = (
        np.column_stack([np.interp(index / times, index, joint) for joint in reference.T])
        for reference in (arm.position_reference, arm.velocity_reference)
    )
    return replace(arm, position_reference=position, velocity_reference=velocity / times)


def noisy(recorded: SimulatedRecording, size: float) -> SimulatedRecording:
    noise = size * np.random.default_rng(2).standard_normal(recorded.position.shape)
    return replace(recorded, position=recorded.position + noise)


def in_band(arm: SimulatedArm, decimation: float, position: float) -> Configuration:
    return changed(
        arm.configuration, "processing", position_cutoff=position, decimation_cutoff=decimation
    )


def with_urdf(folder: Path, pattern: str, text: str, kind: str = "revolute") -> Configuration:
    """The arm whose URDF has another text in every place of a pattern, and joints of a kind."""
    urdf = ARM.configuration.robot.urdf
    other = re.sub(pattern, text, urdf.read_text(encoding="utf-8"))
    (folder / "other.urdf").write_text(other.replace('type="revolute"', f'type="{kind}"'))
    return changed(ARM.configuration, "robot", urdf=folder / "other.urdf")


def true(quantity: str) -> FloatArray:
    """What the encoders of the recording do not show, at its samples."""
    return getattr(recording().truth, quantity)[:: recording().control_ratio]


def of_friction(compensated: float = 0.9) -> FloatArray:
    return compensated * np.tanh(true("velocity")[:, JOINT] / 0.02)


def of_gravity() -> FloatArray:
    """A compensation by the true masses, without a trace of accelerations."""
    position, still = true("position"), np.zeros_like(true("position"))
    return inverse_dynamics(ARM.robot, ARM.truth.without_friction, position, still, still)[:, JOINT]


@pytest.mark.parametrize(
    "effort",
    [
        pytest.param(lambda: -recording().effort[:, JOINT], id="opposite"),
        pytest.param(lambda: np.abs(recording().effort[:, JOINT]), id="unsigned"),
        pytest.param(lambda: 1e3 * recording().effort[:, JOINT], id="mN m"),
        pytest.param(of_friction, id="friction compensation"),
        pytest.param(of_gravity, id="gravity compensation"),
    ],
)
def test_effort_that_is_no_torque_is_said_of_its_joint(effort, tmp_path: Path) -> None:
    report = checked(tmp_path, with_effort(effort(), recording()))
    assert where(report, "unusable") == ["joint_2"]
    assert not report.usable


@pytest.mark.parametrize("light", [r"[^\"]+", r"2\.[^\"]+"], ids=["all links", "the last link"])
def test_links_that_are_given_far_too_light_have_torques(light: str, tmp_path: Path) -> None:
    """Placeholders, and a load that the file does not have."""
    configuration = with_urdf(tmp_path, rf'mass value="{light}"', 'mass value="0.01"')
    report = checked(tmp_path, recording(), configuration=configuration)
    assert where(report, "unusable") == []


def test_friction_with_the_wrong_sign_tells_where_no_mass_does(tmp_path: Path) -> None:
    """Currents of unknown constants, and the wrist of a robot that no nominal mass loads."""
    arm = arm6(seconds=10.0, rate=500.0)
    recorded = record(arm, 1)
    effort = 3.0 * recorded.effort
    effort[:, 5] *= -1.0
    configuration = changed(arm.configuration, "signals", effort_unit="A")
    report = checked(tmp_path, replace(recorded, effort=effort), arm, configuration)
    assert where(report, "unusable") == ["joint_6"]


@pytest.mark.parametrize("noise", [0.0, 3e-4])
@pytest.mark.parametrize("make", [arm2, arm6])
def test_torques_of_slow_and_noisy_motions_are_torques(make, noise: float, tmp_path: Path) -> None:
    """Up to 99.99 % of them are gravity and friction, and most of the acceleration is noise."""
    arm = slower(make(seconds=20.0, rate=500.0), 5.0)
    report = checked(tmp_path, noisy(record(arm, 1), noise), arm, in_band(arm, 20.0, 50.0))
    assert where(report, "unusable") == []


@pytest.mark.parametrize(
    "robot",
    [{"position_offset": [0.3, -0.3]}, {"gravity": [0.0, 0.0, 9.81]}, {"gravity": [0.0, 0.0, 0.0]}],
)
def test_wrong_zero_or_gravity_is_no_wrong_sign(robot, tmp_path: Path) -> None:
    configuration = changed(ARM.configuration, "robot", **robot)
    assert where(checked(tmp_path, recording(), configuration=configuration), "unusable") == []


def in_degrees(*joints: int) -> SimulatedRecording:
    position = recording().position.copy()
    position[:, joints] *= 180.0 / np.pi
    return replace(recording(), position=position)


@pytest.mark.parametrize("joints", [(0, 1), (JOINT,)])
def test_degrees_leave_out_what_they_make_another_torque(joints, tmp_path: Path) -> None:
    """The first joint's gravity and inertia turn with the second's angle."""
    report = checked(tmp_path, in_degrees(*joints))
    assert where(report, "unusable") == ["joint_1", "joint_2"]
    depends = "its torque depends on the motion of joint_2" in str(report.findings)
    assert depends is (joints == (JOINT,))


def test_what_is_said_of_signals_leaves_them_as_they_are() -> None:
    prepared = prepare([recording_of(ARM, in_degrees(JOINT))], ARM.configuration)
    before = [motion.position.copy() for motion in prepared.motions]
    assert any(finding.left_out for finding in prepared.joint_findings)
    for motion, position in zip(prepared.motions, before, strict=True):
        np.testing.assert_array_equal(motion.position, position)


def test_a_smaller_unit_is_that_of_a_joint_beside_the_others() -> None:
    sizes = {0: 40.0, 1: 20.0, 2: 1.0, 3: 1.0}
    assert in_smaller_units({0: 1.1, 1: 0.9, 2: 900.0}, {**sizes, 2: 900.0}) == {2: 900.0}
    payload = {0: 1.2, 1: 1.1, 2: 60.0}
    placeholders = {0: 22.0, 1: 21.0, 2: 25.0}
    heavy_wrist = {0: 0.9, 1: 0.95, 2: 0.01, 3: 0.008}
    alone = {0: 50.0}
    for ratios in (payload, placeholders, heavy_wrist, alone):
        assert in_smaller_units(ratios, sizes) == {}


def test_position_beyond_the_limits_is_said_with_both(tmp_path: Path) -> None:
    """Half a turn from the zero of the URDF: it may be the encoder's, and is no other unit."""
    position = recording().position + np.array([0.0, np.pi])
    report = checked(tmp_path, replace(recording(), position=position))
    assert where(report, "limited") == ["joint_2"]
    assert report.usable
    (finding,) = [other for other in report.findings if other.level == "limited"]
    numbers = [float(text) for text in re.findall(r"-?\d+\.?\d*", finding.sentence)[:4]]
    low, high = np.quantile(position[:, JOINT], [0.0, 1.0])
    assert numbers == pytest.approx([low, high, -2.6, 2.6], abs=0.1)


@pytest.mark.parametrize("limit", ["", '<limit lower="0" upper="0" velocity="0" effort="0"/>'])
def test_limits_that_are_missing_accuse_nobody(limit: str, tmp_path: Path) -> None:
    """A joint that turns on and on, and one whose limits are zero for want of any."""
    kind = "revolute" if limit else "continuous"
    configuration = with_urdf(tmp_path, r"<limit[^>]*/>", limit, kind)
    position = recording().position + np.array([0.0, 8.0 * np.pi])
    report = checked(tmp_path, replace(recording(), position=position), configuration=configuration)
    assert [finding for finding in report.findings if finding.where.startswith("joint_") and
            finding.level != "good"] == []  # fmt: skip


@pytest.mark.parametrize(
    ("pattern", "text", "kind"),
    [
        (r'velocity="[\d.]+"', 'velocity="1.0"', "revolute"),  # faster than the limit
        # Less than two turns without limits are no degrees, however fast.
        (r"<limit[^>]*/>", '<limit velocity="0.5" effort="10"/>', "continuous"),
        # A servo's gain, as models for simulators have it in the place of damping.
        (r'damping="[\d.]+"', 'damping="200"', "revolute"),
    ],
)
def test_speeds_and_torques_that_contradict_the_urdf_are_said(
    tmp_path, pattern, text, kind
) -> None:
    configuration = with_urdf(tmp_path, pattern, text, kind)
    report = checked(tmp_path, recording(), configuration=configuration)
    assert where(report, "limited") == ["joint_1", "joint_2"]


def test_band_that_is_named_gives_enough_rows(tmp_path: Path) -> None:
    few = in_band(ARM, 1.5, 3.75)
    report = checked(tmp_path, recording(), configuration=few)
    assert where(report, "limited") == ["joint_1", "joint_2"]
    named = [
        re.findall(r"cutoff\D*([\d.]+) Hz", finding.sentence)
        for finding in report.findings
        if finding.level == "limited"
    ]
    decimation, position = np.max(np.array(named, dtype=float), axis=0)
    wider = in_band(ARM, float(decimation), float(position))
    assert where(check([tmp_path / "run.mcap"], wider), "limited") == []
    result = identify([tmp_path / "run.mcap"], few)
    assert [doubt.split(":")[0] for doubt in result.doubts] == ["joint_1", "joint_2"]


@pytest.mark.parametrize(
    ("change", "unit", "warned"),
    [
        pytest.param(lambda effort: effort, "N m", 0, id="torque"),
        pytest.param(lambda effort: 0.1 * effort, "A", 0, id="current"),
        pytest.param(
            lambda effort: effort + 200.0 * true("velocity"), "N m", 0, id="damping of 200"
        ),
        pytest.param(
            lambda effort: effort + 1e5 * (np.arange(len(effort)) == 2500)[:, None],
            "N m",
            2,
            id="outlier",
        ),
        pytest.param(lambda effort: -effort, "N m", 2, id="opposite sign"),
    ],
)
def test_unit_of_the_efforts_is_that_of_most(change, unit, warned, tmp_path) -> None:
    path = bag(tmp_path, ARM, replace(recording(), effort=change(recording().effort)))
    proposal = propose_configuration([path], ARM.configuration.robot.urdf)
    assert proposal.values["signals"]["effort_unit"] == unit
    assert sum(warning.startswith("joint_") for warning in proposal.warnings) == warned


@pytest.fixture(scope="module")
def opposite(tmp_path_factory: pytest.TempPathFactory):
    """A diagnosis in which only the sign of joint_2's effort is wrong."""
    arm = replace(ARM, truth=ARM.robot.given)
    recorded = record(arm, 1)
    path = bag(tmp_path_factory.mktemp("opposite"), arm, with_effort(-recorded.effort[:, JOINT],
               recorded))  # fmt: skip
    return diagnose([path], arm.configuration)


@pytest.mark.parametrize(("kept", "other"), [("joint_2", "joint_1"), ("joint_1", "joint_2")])
def test_a_joint_that_moves_others_may_not_be_left_out(tmp_path: Path, kept, other) -> None:
    path = bag(tmp_path, ARM, recording())
    less = changed(ARM.configuration, "robot", joints=[kept])
    less = changed(less, "controller", type="unknown", kp=None, kd=None, torque_limit=None)
    less = changed(less, "simulator", armature=[0.1])
    recordings = read_configured([path], less)
    low, high = recordings[0].other_positions[other]
    assert high - low > 0.1
    carries = pytest.raises(DataError, match="joint_1 carries other joints and moves from")
    with carries if other == "joint_1" else nullcontext():
        prepare(recordings, less)


def test_an_effort_that_turns_its_sign_in_one_of_three_recordings_is_named_there() -> None:
    three = [recording_of(ARM, record(ARM, seed), name=f"run{seed}") for seed in (1, 2, 3)]
    assert not prepare(three, ARM.configuration).joint_findings
    signs = np.array([1.0, -1.0])
    turned = replace(three[2].effort, values=signs * three[2].effort.values)
    three[2] = replace(three[2], effort=turned)
    (finding,) = prepare(three, ARM.configuration).joint_findings
    assert finding.joint == JOINT and finding.left_out
    assert "opposite sign in run3 only" in finding.sentence


def test_diagnosis_names_nothing_of_an_effort_with_the_wrong_sign(opposite) -> None:
    """Neither masses nor a control law of negative gains, at either joint: nothing is wrong."""
    assert opposite.causes == ()
    assert "joint_2 is left out" in opposite.summary.lower()
    assert "opposite sign" in opposite.left_out["joint_2"]
    first, second, *_ = diagnosis_headline(opposite)
    assert first.startswith("Joint_2 is left out: the effort has the opposite sign")
    assert "joint_2" not in second
    assert {error.joint for error in opposite.parameter_errors} == {"joint_1"}
    assert "joint_2" in {effect.joint for effect in opposite.not_testable}


def test_diagnosis_goes_on_with_the_joints_that_have_enough_rows(tmp_path: Path) -> None:
    """joint_2 is measured at the very end only: 14 rows would be needed, two for each column."""
    path = tmp_path / "run.mcap"
    states, reference = joint_topics(ARM, recording())
    hidden = np.asarray(states.effort).copy()
    hidden[:4600, JOINT] = np.nan
    write_bag(path, [replace(states, effort=hidden), reference])
    result = diagnose([path], in_band(ARM, 8.0, 20.0))
    assert "joint_2 is left out" in result.summary.lower()
    assert {cause.joint for cause in result.causes} <= {"joint_1", None}
    assert [error.joint for error in result.parameter_errors] == ["joint_1"]


@pytest.mark.parametrize(
    ("speed", "count"),
    [
        ([1.0, 0.5, -0.5, -1.0, 0.0, 1.0], 2),
        ([1.0, 0.01, -0.01, 0.01, -0.01, 1.0], 0),  # a stop, and on
        ([1.0, 0.01, -0.01, 0.01, -0.01, -1.0], 1),
        ([0.01, -0.01, 0.01], 0),
    ],
)
def test_a_joint_reverses_where_it_moves_the_other_way(speed: list[float], count: int) -> None:
    assert count_reversals(np.array(speed), 0.05) == count
