"""The real recordings as bags, for all tests of them."""

from pathlib import Path

import numpy as np
import scipy
from scipy.interpolate import CubicSpline

from idim_iv_ros import import_table, write_bag
from idim_iv_ros.recording.writing.write import JointTopic


def emps_bag(data: Path, out: Path) -> Path:
    """EMPS: position, control signal and reference."""
    mat = data / "emps" / "DATA_EMPS.mat"
    import_table(
        out,
        joints=["axis"],
        position=f"{mat}:qm",
        effort=f"{mat}:vir",
        reference=f"{mat}:qg",
        time=f"{mat}:t",
    )
    return out


def tx40_bag(data: Path, out: Path) -> Path:
    """TX40: motor positions and motor torques."""
    folder = data / "staubli_tx40"
    columns = ",".join(f"Joint_{k}" for k in range(1, 7))
    import_table(
        out,
        joints=[f"joint_{k}" for k in range(1, 7)],
        position=f"{folder / 'pos_read_data.csv'}:{columns}",
        effort=f"{folder / 'curr_data.csv'}:{columns}",
        rate=5000.0,
    )
    return out


def double_pendulum_bag(data: Path, out: Path) -> Path:
    """DFKI double pendulum: measured motion and reference."""
    folder = data / "dfki_double_pendulum"
    measured, reference = folder / "measured.csv", folder / "reference.csv"
    import_table(
        out,
        joints=["shoulder", "elbow"],
        position=f"{measured}:pos1,pos2",
        velocity=f"{measured}:vel1,vel2",
        effort=f"{measured}:tau1,tau2",
        time=f"{measured}:time",
        reference=f"{reference}:pos1,pos2",
        velocity_reference=f"{reference}:vel1,vel2",
        reference_time=f"{reference}:time",
    )
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


def kuka_bags(data: Path, folder: Path, *, link: str = "encoders") -> list[Path]:
    """KUKA KR300: motor encoders in joint angles, motor torques, references, second encoders.

    Parameters
    ----------
    link
        ``encoders``: as recorded. ``late``: the motor encoders 3 ms late instead of them: a time
        offset and nothing else.
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
        topics = [
            JointTopic(
                "/joint_states",
                KUKA_JOINTS,
                time,
                position=motor,
                effort=record["act_torque_rel_nm"].item().T,
            ),
            JointTopic("/joint_reference", KUKA_JOINTS, time, position=degrees["ref_pos_deg"]),
            JointTopic("/link_states", KUKA_JOINTS[:3], time, position=behind),
        ]
        bags.append(folder / f"kr300_{name}_{link}.mcap")
        write_bag(bags[-1], topics)
    return bags
