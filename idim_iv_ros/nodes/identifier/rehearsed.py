"""Importing this module loads libraries and compiled kernels, and runs one identification.

The process from which jobs are forked imports it once, so that no job starts cold. It has lower
priority than recorder and controllers on the same machine; its stdout goes to stderr.
"""

import contextlib
import gc
import os
import tempfile
from pathlib import Path

from idim_iv_ros.configuration import Configuration
from idim_iv_ros.excitation.excite import random_motion
from idim_iv_ros.identification.identify import identify
from idim_iv_ros.report.page import report_html
from idim_iv_ros.simulators.recording import simulate

_NICE = 5
_RATE, _SECONDS = 500.0, 5.0  # Hz, s
_URDF = """<robot name="rehearsal"><link name="base"/>
  <link name="arm"><inertial><origin xyz="0.2 0 0"/><mass value="2"/>
    <inertia ixx="0.01" iyy="0.03" izz="0.03" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="a" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/>
    <limit lower="-2" upper="2" velocity="6" effort="60"/></joint></robot>"""


def rehearse() -> None:
    """Identify a bag of a simulated joint and draw the report; compile what is not in the cache."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "arm.urdf").write_text(_URDF)
        configuration = Configuration.model_validate(
            {
                "robot": {"joints": ["a"], "urdf": folder / "arm.urdf"},
                "controller": {"type": "pd", "kp": [300.0], "kd": [20.0], "period": 1.0 / _RATE},
                "signals": {"joint_states": "/joint_states", "reference": "/joint_reference"},
                "simulated_robot": {"position_noise": [1e-5], "torque_noise": [0.05]},
                "processing": {"position_cutoff": 30.0},
            }
        )
        motion = random_motion(configuration, duration=_SECONDS, rate=_RATE, seed=1)
        simulate(configuration, folder / "bag.mcap", motion)
        report_html(identify([folder / "bag.mcap"], configuration))


os.nice(_NICE)
os.dup2(2, 1)
with contextlib.suppress(Exception):  # a job that needs what is missing says so itself
    rehearse()
gc.collect()
gc.freeze()  # what the processes share is not touched by their collections
