"""The arms: those of `config/`, and arms of the package example-robot-data with drives drawn here.

A URDF tells geometry and inertials of an arm. Its drives, friction and control law are drawn: of
sizes that stand in the same ratio to the torque that a joint needs as those of `config/`.
"""

import tempfile
import xml.etree.ElementTree as ElementTree
from functools import lru_cache
from importlib.metadata import files
from pathlib import Path

import mujoco
import numpy as np
import pinocchio as pin

from benchmarks.withheld_effects.control import Controller
from benchmarks.withheld_effects.robot import CENTRES, GivenRobot, given_robot

SMALL = ("arm2", "double_pendulum")
# Joints that are kept, from the base on; the others of the file (fingers) are fixed.
LARGE = {
    "arm6": 6,
    "arm7": 7,
    "panda": 7,
    "xarm7": 7,
    "ur3_robot": 6,
    "ur5_robot": 6,
    "ur10_robot": 6,
    "kinova": 6,
    "z1": 6,
    "talos_left_arm": 6,
}
PACKAGE = "example-robot-data"
MOST_RANGE, LEAST_RANGE = 1.6, 1.0  # rad, either side of the centre of the motion
LEAST_TORQUE = 0.06  # of a joint, as a share of the strongest one's


def joint_count(name: str) -> int:
    """Of an arm, without reading its file."""
    return LARGE.get(name, 2)


def robot(name: str, rng: np.random.Generator) -> GivenRobot:
    """Arm of a name; what its file does not tell is drawn.

    Raises
    ------
    FileNotFoundError
        The package example-robot-data is not installed, or has no such file.
    """
    if name in CENTRES:
        return given_robot(name)
    tree, joints = _arm(_path(name), joint_count(name))
    tags = {tag.get("name"): tag for tag in tree.iter("joint")}
    n = len(joints)
    lower, upper = np.empty((2, n))
    for k, joint in enumerate(joints):
        limit = tags[joint].find("limit")
        told = (0.0, 0.0) if limit is None else (limit.get("lower", 0), limit.get("upper", 0))
        low, high = map(float, told)
        if not 0.5 < high - low < 4.0 * np.pi:  # rad; a joint that turns on has none
            low, high = -np.pi, np.pi
        lower[k], upper[k] = max(low, -np.pi), min(high, np.pi)
    middle = 0.5 * (lower + upper)
    room = np.minimum(rng.uniform(LEAST_RANGE, MOST_RANGE, n), 0.5 * (upper - lower))
    away = np.minimum(0.6, 0.5 * (upper - lower) - room)
    centre = middle + rng.uniform(-1.0, 1.0, n) * away
    fastest = rng.uniform(1.6, 3.0, n)
    inertia, torque = _loads(tree, centre, room, fastest)
    torque = np.maximum(torque, LEAST_TORQUE * torque.max())
    effort = 2.2 * torque
    armature = effort * rng.uniform(0.004, 0.009, n)
    dry = effort * rng.uniform(0.015, 0.04, n)
    viscous = effort * rng.uniform(0.01, 0.03, n)
    turn = 2.0 * np.pi * rng.uniform(5.5, 8.0)
    kp = (inertia + armature) * turn**2
    kd = 2.0 * rng.uniform(0.75, 0.95) * (inertia + armature) * turn
    for k, joint in enumerate(joints):
        for old in tags[joint].findall("limit"):
            tags[joint].remove(old)
        limits = {"lower": lower, "upper": upper, "velocity": fastest, "effort": effort}
        ElementTree.SubElement(
            tags[joint], "limit", {key: f"{value[k]:.9g}" for key, value in limits.items()}
        )
        ElementTree.SubElement(
            tags[joint], "dynamics", {"damping": f"{viscous[k]:.9g}", "friction": f"{dry[k]:.9g}"}
        )
    urdf = Path(tempfile.mkdtemp(dir=_scratch())) / f"{name}.urdf"
    tree.write(urdf, encoding="unicode")
    return GivenRobot(
        name=name,
        yaml=urdf,
        urdf=urdf,
        joints=joints,
        centre=centre,
        lower=centre - room,
        upper=centre + room,
        fastest=fastest,
        effort=effort,
        armature=armature,
        viscous=viscous,
        dry=dry,
        controller=Controller(
            kp=kp,
            kd=kd,
            ki=np.zeros(n),
            limit=effort,
            lag=np.zeros(n),
            velocity_reference=1.0,
            period=0.001,
        ),
    )


@lru_cache
def _scratch() -> str:
    """Folder of this process for URDFs; it goes when the process ends."""
    _scratch.folder = tempfile.TemporaryDirectory()  # type: ignore[attr-defined]
    return str(_scratch.folder.name)  # type: ignore[attr-defined]


def _path(name: str) -> Path:
    for file in files(PACKAGE) or []:
        if file.name == f"{name}.urdf":
            return Path(str(file.locate()))
    raise FileNotFoundError(f"{PACKAGE} has no {name}.urdf: pip install '.[bench]'")


def _arm(path: Path, count: int) -> tuple[ElementTree.ElementTree, tuple[str, ...]]:
    """URDF without pictures and with `count` joints that move, and their names from the base on."""
    tree = ElementTree.parse(path)
    root = tree.getroot()
    for child in list(root):
        if child.tag not in ("link", "joint"):
            root.remove(child)
    for link in root.iter("link"):
        for child in list(link):
            if child.tag != "inertial":
                link.remove(child)
    for joint in root.iter("joint"):
        for child in list(joint):
            if child.tag not in ("origin", "parent", "child", "axis", "limit"):
                joint.remove(child)
        if joint.get("type") == "continuous":
            joint.set("type", "revolute")
    model = mujoco.MjModel.from_xml_string(ElementTree.tostring(root, encoding="unicode"))
    joints = tuple(model.joint(k).name for k in range(count))
    for joint in root.iter("joint"):
        if joint.get("name") not in joints:
            joint.set("type", "fixed")
    return tree, joints


def _loads(
    tree: ElementTree.ElementTree, centre: np.ndarray, room: np.ndarray, fastest: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Largest inertia (n,) kg m² and torque (n,) N m over a few hundred states of a motion."""
    model = pin.buildModelFromXML(ElementTree.tostring(tree.getroot(), encoding="unicode"))
    data = model.createData()
    rng = np.random.default_rng(0)
    inertia, torque = np.zeros((2, model.nv))
    for _ in range(300):
        q = centre + room * rng.uniform(-1.0, 1.0, model.nv)
        v = 0.5 * fastest * rng.normal(size=model.nv)
        a = 4.0 * rng.normal(size=model.nv)  # rad/s²
        inertia = np.maximum(inertia, np.diag(pin.crba(model, data, q)))
        torque = np.maximum(torque, np.abs(pin.rnea(model, data, q, v, a)))
    return inertia, torque
