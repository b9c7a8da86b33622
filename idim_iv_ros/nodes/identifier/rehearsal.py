"""A small identification that leaves everything loaded: libraries, compiled loops, the report."""

from pathlib import Path

import numpy as np

from idim_iv_ros.configuration import Configuration
from idim_iv_ros.excitation import Trajectory
from idim_iv_ros.identification.identify import identify_recordings
from idim_iv_ros.recording import Recording, Signal
from idim_iv_ros.report.page import report_html
from idim_iv_ros.report.section import CONFIGURATION
from idim_iv_ros.simulators.robot import simulated_robot
from idim_iv_ros.types import FloatArray

_RATE, _SECONDS = 500.0, 6.0  # Hz, s
_LINK = """
  <link name="link_{0}"><inertial><origin xyz="0.2 0 0"/><mass value="2"/>
    <inertia ixx="0.01" iyy="0.03" izz="0.03" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="{0}" type="revolute"><parent link="{1}"/><child link="link_{0}"/>
    <origin xyz="{2} 0 0"/><axis xyz="0 1 0"/>
    <limit lower="-2" upper="2" velocity="6" effort="60"/></joint>"""
_URDF = (
    '<robot name="rehearsal"><link name="base"/>'
    + _LINK.format("a", "base", "0")
    + _LINK.format("b", "link_a", "0.4")
    + "</robot>"
)


def rehearse() -> None:
    """Identify two simulated joints and draw the report; nothing is read or written.

    On a machine where the loops were never compiled they are compiled here.
    """
    configuration = Configuration.model_validate(
        {
            "robot": {"joints": ["a", "b"]},
            "controller": {"type": "pd", "kp": [300.0, 100.0], "kd": [20.0, 6.0], "period": 0.002},
            "signals": {"joint_states": "/joint_states", "reference": "/reference"},
            "simulated_robot": {"position_noise": [1e-5, 1e-5], "torque_noise": [0.05, 0.05]},
            "processing": {"position_cutoff": 30.0},
        }
    )
    report_html(identify_recordings(_recording(configuration), configuration), CONFIGURATION)


def _recording(configuration: Configuration) -> Recording:
    time = np.arange(round(_SECONDS * _RATE) + 1) / _RATE
    phases = 2.0 * np.pi * time[:, None] / _SECONDS * np.array([[4.0, 7.0]])
    position = 0.4 * np.sin(phases) * np.sin(np.pi * time[:, None] / _SECONDS) ** 2
    velocity = np.gradient(position, 1.0 / _RATE, axis=0)
    motion = Trajectory(("a", "b"), _RATE, position, velocity, np.zeros_like(position))
    record = simulated_robot(configuration, _URDF, "rehearsal").record(motion, seed=1)
    nothing = np.zeros(record.position.shape, dtype=bool)

    def signal(values: FloatArray) -> Signal:
        return Signal(values, nothing, "simulated")

    return Recording(
        path=Path("rehearsal"),
        joints=motion.joints,
        rate=_RATE,
        start=0.0,
        position=signal(record.position),
        effort=signal(record.effort),
        velocity=None,
        position_reference=signal(record.position_reference),
        velocity_reference=None,
        clocks=(),
        notes=(),
        robot_description=_URDF,
    )
