"""What an export writes from, and the check of a file before it is written."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from idim_iv_ros.configuration import Configuration
from idim_iv_ros.errors import UsageError
from idim_iv_ros.model import kinematics_digest, load_robot
from idim_iv_ros.model.parameters import REGRESSOR_ORDER
from idim_iv_ros.model.urdf import Urdf
from idim_iv_ros.simulator_files.answer import Answer
from idim_iv_ros.simulator_files.law import DriveLaw
from idim_iv_ros.simulator_files.links import LinkBody
from idim_iv_ros.simulator_files.mjcf import JointValues
from idim_iv_ros.simulator_files.named import Load
from idim_iv_ros.simulator_files.randomization import Randomization
from idim_iv_ros.simulators.effects_file import PlantedEffect
from idim_iv_ros.types import FloatArray

ISAAC_LAB = "isaac_lab.py"
_READ_BACK = 1e-6  # of the largest parameter of its kind: digits of a file


@dataclass(frozen=True)
class Exported:
    """Files that were written, and what a user must know of them.

    Attributes
    ----------
    urdf, mjcf, effects, isaac_lab, changes : Path
        Where the nominal model is an MJCF, `urdf` and `isaac_lab` are None.
    ranges : tuple of Path
        What draws other robots, for MuJoCo and for Isaac Lab; empty where that was not asked for.
    not_native : tuple of str
        Effects that MuJoCo has no element for.
    notes : tuple of str
    bags : tuple of str
        Names of the recordings that the result is from.
    """

    urdf: Path | None
    mjcf: Path
    effects: Path
    isaac_lab: Path | None
    changes: Path
    ranges: tuple[Path, ...]
    not_native: tuple[str, ...]
    notes: tuple[str, ...]
    bags: tuple[str, ...]

    @property
    def files(self) -> tuple[Path, ...]:
        """All of them."""
        files = (self.urdf, self.mjcf, self.effects, self.isaac_lab, self.changes, *self.ranges)
        return tuple(file for file in files if file is not None)


@dataclass(frozen=True)
class Findings:
    """What is to be written."""

    answer: Answer
    source: Path
    content: bytes
    urdf: Urdf
    bodies: Mapping[str, FloatArray]
    links: Mapping[str, LinkBody]
    drives: JointValues
    law: DriveLaw
    planted: tuple[PlantedEffect, ...]
    notes: tuple[str, ...]
    kept: bool  # the nominal model is an MJCF, which stays
    randomized: bool

    @property
    def origin(self) -> str:
        """What the numbers come from."""
        kind = "diagnosis" if self.answer.diagnosed else "identification"
        return f"{self.answer.path.name} ({kind})"

    @property
    def mounted(self) -> dict[str, tuple[str, Load]]:
        """Payloads by a link name that no link has, each with the link that carries it."""
        taken, found = set(self.urdf.links), {}
        for load in self.answer.loads:
            name = load.name
            while name in taken:
                name += "_found"
            taken.add(name)
            found[name] = (self.urdf.joints[load.joint].child, load)
        return found

    @property
    def randomization(self) -> Randomization | None:
        """What may vary; None where that was not asked for."""
        if not self.randomized or self.answer.remainder is None:
            return None
        links = {name: self.urdf.joints[name].child for name in self.answer.robot.joints}
        loads = {load.name: name for name, (_, load) in self.mounted.items()}
        return Randomization.of(self.answer, self.answer.remainder, links, loads)


Texts = tuple[dict[Path, bytes], tuple[PlantedEffect, ...], tuple[str, ...]]


def require_read_back(text: str, configuration: Configuration, what: Findings) -> None:
    """Read the new file as this program reads any, and find the parameters that were meant."""
    source, drives = str(what.source), what.drives
    robot = load_robot(text, configuration.robot.joints, source=source)
    meant = np.array(list(what.bodies.values()))
    for load in what.answer.loads:
        meant[list(what.bodies).index(load.joint)] += load.parameters
    found = robot.given.inertial[:, list(REGRESSOR_ORDER)]
    same = np.allclose(found, meant, rtol=0.0, atol=_READ_BACK * np.abs(meant).max())
    same &= np.allclose(robot.given.viscous, drives.damping, rtol=_READ_BACK)
    same &= np.allclose(robot.given.coulomb, drives.friction, rtol=_READ_BACK)
    if what.kept:
        same &= np.allclose(robot.given.drive_inertia, drives.armature, rtol=_READ_BACK)
    same &= kinematics_digest(robot) == kinematics_digest(what.answer.robot)
    if not same:
        raise UsageError(
            f"{source}: values were put in, and others are read back: elements are written in a "
            "way that this program does not know; nothing was written"
        )
