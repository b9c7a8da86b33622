"""The real recordings as bags, for all tests of them."""

import json
from pathlib import Path

import numpy as np
import scipy
from scipy.interpolate import CubicSpline

from idim_iv_ros import Configuration, load_configuration, write_bag
from idim_iv_ros.recording.writing.write import JointTopic


def emps_bag(data: Path, out: Path) -> Path:
    """EMPS: position, control signal and reference."""
    table = scipy.io.loadmat(data / "emps" / "DATA_EMPS.mat")
    time, position, effort, reference = (
        table[key].reshape(-1, 1) for key in ("t", "qm", "vir", "qg")
    )
    states = JointTopic("joint_states", ["axis"], time[:, 0], position=position, effort=effort)
    asked = JointTopic("joint_reference", ["axis"], time[:, 0], position=reference)
    write_bag(out, [states, asked])
    return out


def _columns(path: Path, *prefixes: str) -> list[np.ndarray]:
    """Numbers of a table, the columns that begin with each prefix together."""
    table = np.genfromtxt(path, delimiter=",", names=True)
    chosen = ([n for n in table.dtype.names if n.startswith(prefix)] for prefix in prefixes)
    return [np.column_stack([table[name] for name in names]) for names in chosen]


def tx40_bag(data: Path, out: Path) -> Path:
    """TX40: motor positions and motor torques."""
    folder = data / "staubli_tx40"
    (position,) = _columns(folder / "pos_read_data.csv", "Joint_")
    (effort,) = _columns(folder / "curr_data.csv", "Joint_")
    joints, time = [f"joint_{k}" for k in range(1, 7)], np.arange(len(position)) / 5000.0
    write_bag(out, [JointTopic("joint_states", joints, time, position=position, effort=effort)])
    return out


TX40 = """
robot:
  urdf: {urdf}
  joints: [joint_1, joint_2, joint_3, joint_4, joint_5, joint_6]
  position_offset: [0.0, -1.5707963267948966, 1.5707963267948966, 0.0, 0.0, 0.0]
  motor_to_joint:
    - [32, 0, 0, 0, 0, 0]
    - [0, 32, 0, 0, 0, 0]
    - [0, 0, 45, 0, 0, 0]
    - [0, 0, 0, -48, 0, 0]
    - [0, 0, 0, 0, 45, 0]
    - [0, 0, 0, 0, 32, 32]
  couplings:
    - joints: [joint_5, joint_6]
processing:
  position_cutoff: 25.0
  decimation_cutoff: 20.0
  decimation_edge: 0.8
  minimum_speed: [0.05009095, 0.05009095, 0.07504916, 0.0715585, 0.05585054, 0.12217305]
  reversal_margin: 0.0
  trim: [0.0, 0.0]
"""


def tx40_configuration(data: Path, folder: Path, text: str = TX40) -> Configuration:
    """The TX40 with the URDF of the data."""
    path = folder / "tx40.yaml"
    path.write_text(text.format(urdf=data / "staubli_tx40" / "tx40_mdh_modified.urdf"))
    return load_configuration(path)


def double_pendulum_bag(data: Path, out: Path) -> Path:
    """DFKI double pendulum: measured motion and reference."""
    folder = data / "dfki_double_pendulum"
    joints = ["shoulder", "elbow"]
    time, position, velocity, effort = _columns(
        folder / "measured.csv", "time", "pos", "vel", "tau"
    )
    states = JointTopic("joint_states", joints, time[:, 0], position, velocity, effort)
    time, position, velocity = _columns(folder / "reference.csv", "time", "pos", "vel")
    write_bag(out, [states, JointTopic("joint_reference", joints, time[:, 0], position, velocity)])
    return out


KUKA_JOINTS = ("j1", "j2", "j3", "j4", "j5", "j6")
# Axes 4 to 6 have no second encoder. Offsets, as published with the recordings: the arm stands
# upright at zero. The drive inertias are the published motor inertias times the squared ratio.
KUKA = """
robot:
  name: kr300
  urdf: {urdf}
  joints: [j1, j2, j3, j4, j5, j6]
  position_offset: [0.0, -1.5707963267948966, 1.5707963267948966, 0.0, 0.0, 0.0]
simulator:
  armature: [608.95, 843.91, 751.33, 488.41, 574.17, 238.16]
controller:
  type: unknown
signals:
  reference: /joint_reference
  link_states: /link_states
  effort_scale: [256.857143, 267.428571, 252.333333, 221.0, 239.619048, 154.323134]
processing:
  position_cutoff: 20.0
  decimation_cutoff: 8.0
"""


LATE_NOISE = 2e-5  # rad


def kuka_configuration(data: Path, folder: Path) -> Configuration:
    """The KR300 with the URDF of the data."""
    path = folder / "kr300.yaml"
    path.write_text(KUKA.format(urdf=data / "kuka_kr300" / "kr300.urdf"))
    return load_configuration(path)


def kuka_bags(data: Path, folder: Path, *, link: str = "encoders") -> list[Path]:
    """KUKA KR300: motor encoders in joint angles, motor torques, references, second encoders.

    Parameters
    ----------
    link
        ``encoders``: as recorded. ``late``: the motor encoders 3 ms late and with noise instead of
        them: a time offset and nothing else.
    """
    bags = []
    for name in "ABC":
        record = scipy.io.loadmat(data / "kuka_kr300" / f"{name}.mat", squeeze_me=True)["rec"]
        degrees = {
            field: np.radians(record[field].item().T)
            for field in ("act_pos_mot_deg", "act_pos_se_deg", "ref_pos_deg")
        }
        motor = degrees["act_pos_mot_deg"]
        time = np.arange(len(motor)) / 250.0
        behind = degrees["act_pos_se_deg"][:, :3]
        if link == "late":
            behind = CubicSpline(time, motor[:, :3], axis=0)(np.maximum(time - 0.003, 0.0))
            behind += np.random.default_rng(0).normal(0.0, LATE_NOISE, behind.shape)
        torque = record["act_torque_rel_nm"].item().T
        topics = [
            JointTopic("/joint_states", KUKA_JOINTS, time, position=motor, effort=torque),
            JointTopic("/joint_reference", KUKA_JOINTS, time, position=degrees["ref_pos_deg"]),
            JointTopic("/link_states", KUKA_JOINTS[:3], time, position=behind),
        ]
        bags.append(folder / f"kr300_{name}_{link}.mcap")
        write_bag(bags[-1], topics)
    return bags


# Counts of duty per rad of position error and unit of the position gain: 4096 counts a turn,
# gain / 256; 885 is the whole supply. The recorded duty follows it to 0.1 %.
DUTY_PER_GAIN = 4096.0 / (2.0 * np.pi) / 256.0
DUTY_LIMIT, SUPPLY = 885.0, 7.3  # counts, V
SERVO_URDF = """
<robot name="xl330"><link name="base"/>
<joint name="servo" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/>
<limit lower="-3" upper="3" effort="1" velocity="20"/></joint>
<link name="arm"><inertial><origin xyz="0 0 -0.1"/><mass value="0.49"/>
<inertia ixx="0.0001" iyy="0.0001" izz="0.0001" ixy="0" ixz="0" iyz="0"/></inertial></link></robot>
"""
SERVO = """
robot:
  urdf: {urdf}
  joints: [servo]
simulator:
  armature: [0.0]
controller:
  type: pd
  kp: [{kp}]
  kd: [0.0]
  velocity_reference: false
  torque_limit: [7.3]
signals:
  reference: /joint_reference
  effort_scale: [{scale}]
  effort_unit: V
"""


def servo_configuration(gain: float, urdf: Path) -> str:
    """Configuration with the law of one position gain; the effort is the voltage that it sets."""
    scale = SUPPLY / DUTY_LIMIT
    return SERVO.format(urdf=urdf, kp=DUTY_PER_GAIN * gain * scale, scale=scale)


def servo_bags(data: Path, folder: Path, gain: int) -> list[Path]:
    """Three motions of the servo under one gain; in the fourth it is switched off most of the time.

    No torque is recorded: the duty of the bridge takes its place, counts of two's complement.
    """
    bags = []
    for file in sorted((data / "bam_xl330").glob("2*.json")):
        record = json.loads(file.read_text())
        if record["kp"] != gain or record["trajectory"] == "lift_and_drop":
            continue
        entries = record["entries"]
        channel = {
            name: np.array([float(entry[name]) for entry in entries])[:, None]
            for name in ("timestamp", "position", "speed", "load", "goal_position")
        }
        time = channel["timestamp"][:, 0]
        duty = np.where(channel["load"] > 32767.0, channel["load"] - 65536.0, channel["load"])
        bag = folder / f"xl330_{gain}_{record['trajectory']}.mcap"
        topics = [
            JointTopic(
                "/joint_states", ["servo"], time, channel["position"], channel["speed"], duty
            ),
            JointTopic("/joint_reference", ["servo"], time, position=channel["goal_position"]),
        ]
        write_bag(bag, topics)
        bags.append(bag)
    return bags


# Pulses that are added to EMPS's recorded control signal: begin, end (s), size (V).
PULSES = ((5.0, 5.25, 2.0), (9.4, 9.65, -2.0), (15.1, 15.35, 2.0), (20.3, 20.55, -2.0))


def emps_with_pulses(data: Path, out: Path) -> Path:
    """EMPS with pulses in the recorded control signal that its law does not contain."""
    record = scipy.io.loadmat(data / "emps" / "DATA_EMPS.mat", squeeze_me=True)
    time, command = record["t"], record["vir"].astype(float)
    for begin, end, size in PULSES:
        command = command + size * ((time >= begin) & (time < end))
    measured, reference = record["qm"][:, None], record["qg"][:, None]
    topics = [
        JointTopic("/joint_states", ["axis"], time, position=measured, effort=command[:, None]),
        JointTopic("/joint_reference", ["axis"], time, position=reference),
    ]
    write_bag(out, topics)
    return out
