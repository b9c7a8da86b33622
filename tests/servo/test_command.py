"""`idim-iv servo`, its files, and what it refuses."""

import json
from dataclasses import replace

import mujoco
import numpy as np
import pytest

from benchmarks.servos import LIMIT, TRUTH, mujoco_servo
from idim_iv_ros import diagnose, load_configuration
from idim_iv_ros.errors import DataError, UsageError
from idim_iv_ros.recording.read import read_recordings
from idim_iv_ros.recording.writing.write import JointTopic, write_bag
from idim_iv_ros.servo.actuators import write_servo_files
from idim_iv_ros.servo.identify import identify_servos
from idim_iv_ros.signals.joint_side import joint_side
from tests.cli.conftest import run  # noqa: F401 - a fixture
from tests.inputs import changed
from tests.servo.conftest import write_servo_bag


def test_command_writes_files_that_simulators_read(servo_folder, tmp_path, run):  # noqa: F811
    out = tmp_path / "out"
    run("servo", servo_folder / "run.mcap", "--config", servo_folder / "servo_arm.yaml",
        "--out", out, status=0)  # fmt: skip
    document = json.loads((out / "servo.json").read_text())
    (joint,) = document["joints"]
    assert joint["absolute"] and joint["numbers"][0]["name"] == "stiffness"
    model = mujoco.MjModel.from_xml_path(str(out / "servo.xml"))
    assert model.actuator_gainprm[0, 0] == pytest.approx(TRUTH["stiffness"], rel=0.05)
    assert model.actuator_forcerange[0, 1] == pytest.approx(LIMIT, rel=0.05)
    assert model.dof_armature[0] == pytest.approx(TRUTH["armature"], rel=0.05)
    assert "DelayedPDActuatorCfg" in (out / "servo_isaac_lab.py").read_text()
    compile((out / "servo_isaac_lab.py").read_text(), "servo_isaac_lab.py", "exec")
    assert (out / "report.html").stat().st_size > 10_000


def test_diagnosis_takes_the_torque_of_the_law(servo_folder, tmp_path):
    bag, given = servo_folder / "run.mcap", servo_folder / "servo_arm.yaml"
    configuration = load_configuration(given)
    result = identify_servos(bag, configuration)
    write_servo_files(result, configuration, [bag], tmp_path)
    servo = load_configuration(tmp_path / "servo.yaml")
    (recording,) = read_recordings(
        bag, joints=["j"], joint_states="joint_states", effort="none", reference="command"
    )
    signals = joint_side(recording, servo)
    kp, limit = servo.controller.kp[0], servo.controller.torque_limit[0]
    assert np.abs(signals.torque).max() == pytest.approx(limit)
    inner = np.abs(signals.torque) < limit
    error = signals.position_reference - signals.position
    np.testing.assert_allclose(signals.torque[inner], kp * error[inner])
    gap = diagnose(bag, servo)
    assert not [cause for cause in gap.causes if cause.kind == "structural"]


def test_efforts_are_not_ignored(servo_folder):
    configuration = load_configuration(servo_folder / "servo_arm.yaml")
    with pytest.raises(UsageError, match="idim-iv identify"):
        identify_servos(servo_folder / "run.mcap", changed(configuration, "signals", effort=None))


def test_identify_without_a_law_names_the_command_that_finds_it(servo_folder, run):  # noqa: F811
    outcome = run("identify", servo_folder / "run.mcap", "--config",
                  servo_folder / "servo_arm.yaml", "--json", status=2)  # fmt: skip
    assert "idim-iv servo" in outcome.error
    assert "Traceback" not in outcome.error


def test_gain_for_each_recording(servo_folder):
    configuration = load_configuration(servo_folder / "servo_arm.yaml")
    with pytest.raises(UsageError, match="2 values for 1"):
        identify_servos(servo_folder / "run.mcap", configuration, gains=[1.0, 2.0])


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda motion: (motion, 57.29578), "degrees"),
        (lambda motion: (replace(motion, command=np.roll(motion.position, 4, axis=0)), 1.0),
         "measured position"),
        (lambda motion: (replace(motion, command=np.zeros_like(motion.command)), 1.0),
         "one position"),
    ],
)  # fmt: skip
def test_what_no_servo_records_is_refused(servo_folder, tmp_path, motion, change, words):
    changed, scale = change(motion)
    write_servo_bag(tmp_path / "bad.mcap", changed, scale)
    configuration = load_configuration(servo_folder / "servo_arm.yaml")
    with pytest.raises(DataError, match=words):
        identify_servos(tmp_path / "bad.mcap", configuration)


@pytest.mark.parametrize(("seconds", "off"), [(20.0, 12.0), (12.0, 7.0)])
def test_servo_that_is_switched_off_is_said(servo_folder, tmp_path, seconds, off):
    """In the shorter recording no parameter changes anything where the search ends."""
    motion = mujoco_servo(100.0, seconds, seed=4)
    position, stop = motion.position.copy(), round(off * motion.rate)
    position[stop:] = position[stop]
    write_servo_bag(tmp_path / "off.mcap", replace(motion, position=position))
    configuration = load_configuration(servo_folder / "servo_arm.yaml")
    result = identify_servos(tmp_path / "off.mcap", configuration)
    assert any("off, blocked or pushed" in warning for warning in result.warnings)


def test_commands_of_another_rate_are_held(servo_folder, tmp_path, motion):
    """Commands at 25 Hz, positions at 100 Hz: a spline between commands would swing beyond them."""
    time = np.arange(len(motion.position)) / motion.rate
    coarse = motion.command[::4]
    write_bag(
        tmp_path / "run.mcap",
        [
            JointTopic("joint_states", ["j"], time, motion.position),
            JointTopic("command", ["j"], time[::4] + 0.001, coarse),
        ],
    )
    (recording,) = read_recordings(
        tmp_path / "run.mcap", joints=["j"], effort="none", reference="command"
    )
    np.testing.assert_array_equal(
        recording.position_reference.values[:400, 0], np.repeat(coarse[:100, 0], 4)
    )
