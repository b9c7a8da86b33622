"""Design of motions that identify a robot or tell the causes of a gap apart."""

from idim_iv_ros.excitation.joint_trajectory import write_joint_trajectory
from idim_iv_ros.excitation.trajectory import Trajectory, read_trajectory, write_csv

__all__ = ["Trajectory", "read_trajectory", "write_csv", "write_joint_trajectory"]
