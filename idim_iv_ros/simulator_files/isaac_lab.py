"""Actuators of a robot for Isaac Lab, as a Python file that a user edits.

Fields as documented for Isaac Lab 2.3 and 3.0 (`ActuatorBaseCfg`, `DelayedPDActuatorCfg`): since
Isaac Sim 5 `friction` and `dynamic_friction` are efforts, `viscous_friction` a coefficient.
"""

from collections.abc import Sequence

import numpy as np

from idim_iv_ros.effects.registry import part_of
from idim_iv_ros.simulation import SimulatedEffect
from idim_iv_ros.simulator_files.file_text import file_text
from idim_iv_ros.simulator_files.robot import ExportedRobot
from idim_iv_ros.types import BoolArray


def isaac_lab_text(
    exported: ExportedRobot, urdf_name: str, effects: Sequence[SimulatedEffect]
) -> str:
    """Return the file, for the exported URDF of that name beside it.

    Effects that no field expresses are listed in a comment.
    """
    law = exported.law
    delayed = bool(law.configured and any(law.delay))
    # A delay is that of a group: one for each length.
    steps = [round(float(delay) / law.period) if delayed else 0 for delay in law.delay]
    parts = [(effect, part_of(effect.effect)) for effect in effects]
    return file_text(
        "isaac_lab.py",
        robot=exported.robot,
        couplings=exported.drives.couplings,
        law=law,
        offsets=dict(zip(exported.robot.joints, exported.drives.offset, strict=True)),
        origin=exported.origin,
        urdf=urdf_name,
        delayed=delayed,
        groups={delay: _fields(exported, np.equal(steps, delay)) for delay in sorted(set(steps))},
        effects=[
            effect
            for effect, part in parts
            if part not in ("delay", "offset") and (part != "gains" or law.beyond)
        ],
    )


def _fields(
    exported: ExportedRobot, chosen: BoolArray
) -> tuple[list[str], list[tuple[str, str, dict[str, float]]]]:
    """Names of the chosen joints (n,), and the fields of their group that have finite numbers.

    A field is its name, its unit, and the numbers by joint.
    """
    names, values, law = np.array(exported.robot.joints), exported.drives, exported.law
    gains = [("stiffness", law.kp, "N m/rad"), ("damping", law.kd, "N m s/rad")]
    fields = [
        *(gains if law.configured else []),
        ("armature", values.armature, "kg m2"),
        ("friction", values.friction, "N m: static, an effort"),
        ("dynamic_friction", values.friction, "N m: Coulomb; static friction beyond it is unknown"),
        ("viscous_friction", values.damping, "N m s/rad"),
        ("effort_limit", law.limit, "N m"),
    ]
    listed = []
    for field, numbers, unit in fields:
        there = np.isfinite(numbers) & chosen
        if there.any():
            by_joint = zip(names[there].tolist(), numbers[there].tolist(), strict=True)
            listed.append((field, unit, dict(by_joint)))
    return names[chosen].tolist(), listed
