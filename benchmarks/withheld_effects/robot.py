"""The robots as the user's simulator holds them, read without the package under test."""

import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray
from ruamel.yaml import YAML

from benchmarks.withheld_effects.control import Controller

FloatArray = NDArray[np.float64]
CONFIG = Path(__file__).parents[2] / "config"
CENTRES = {
    "arm2": (0.4, 0.5),
    "arm6": (0.0, 0.3, 0.9, 0.0, 0.6, 0.0),
    "arm7": (0.0, 0.3, 0.0, -0.8, 0.0, 0.5, 0.0),
}


@dataclass(frozen=True)
class GivenRobot:
    """Geometry, given values and controller; arrays (n_joints,), joint side.

    Attributes
    ----------
    name : str
    yaml, urdf : Path
    joints : tuple of str
    centre : rad, around which the motions turn
    lower, upper : rad
    fastest : rad/s
    effort : N m
    armature : kg m²
    viscous : N m s/rad
    dry : N m
    controller : Controller
    """

    name: str
    yaml: Path
    urdf: Path
    joints: tuple[str, ...]
    centre: FloatArray
    lower: FloatArray
    upper: FloatArray
    fastest: FloatArray
    effort: FloatArray
    armature: FloatArray
    viscous: FloatArray
    dry: FloatArray
    controller: Controller


@lru_cache
def given_robot(name: str) -> GivenRobot:
    """Read config/NAME.yaml and its URDF (KeyError: no such robot here)."""
    path = CONFIG / f"{name}.yaml"
    settings = YAML(typ="safe").load(path.read_text(encoding="utf-8"))
    urdf = path.parent / settings["robot"]["urdf"]
    joints = tuple(settings["robot"]["joints"])
    tags = {tag.get("name"): tag for tag in ElementTree.parse(urdf).iter("joint")}

    def value(tag: str, attribute: str) -> FloatArray:
        return np.array([float(tags[joint].find(tag).get(attribute)) for joint in joints])

    law = settings["controller"]
    n = len(joints)
    return GivenRobot(
        name=name,
        yaml=path,
        urdf=urdf,
        joints=joints,
        centre=np.array(CENTRES[name]),
        lower=value("limit", "lower"),
        upper=value("limit", "upper"),
        fastest=value("limit", "velocity"),
        effort=value("limit", "effort"),
        armature=np.array(settings["simulator"]["armature"]),
        viscous=value("dynamics", "damping"),
        dry=value("dynamics", "friction"),
        controller=Controller(
            kp=np.array(law["kp"]),
            kd=np.array(law["kd"]),
            ki=np.array(law.get("ki", np.zeros(n))),
            limit=np.array(law["torque_limit"]),
            lag=np.zeros(n),
            velocity_reference=float(law.get("velocity_reference", True)),
            period=law["period"],
        ),
    )


@dataclass(frozen=True)
class Inertials:
    """Links in their own frames: mass (n,) kg, centre (n, 3) m, inertia (n, 3, 3) kg m² there."""

    mass: FloatArray
    centre: FloatArray
    inertia: FloatArray


def first_axis(given: GivenRobot) -> FloatArray:
    """Axis (3,) of the first joint in the base frame."""
    model = mujoco.MjModel.from_xml_path(str(given.urdf))
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    return np.asarray(data.xaxis[model.joint(given.joints[0]).id])


def given_inertials(given: GivenRobot) -> Inertials:
    """The URDF's, in the order of the joints."""
    model = mujoco.MjModel.from_xml_path(str(given.urdf))
    bodies = _bodies(model, given)
    inertia = np.zeros((len(bodies), 3, 3))
    for k, body in enumerate(bodies):
        turn = np.zeros(9)
        mujoco.mju_quat2Mat(turn, model.body_iquat[body])
        turn = turn.reshape(3, 3)
        inertia[k] = turn @ np.diag(model.body_inertia[body]) @ turn.T
    return Inertials(model.body_mass[bodies].copy(), model.body_ipos[bodies].copy(), inertia)


def altered_inertials(
    inertials: Inertials,
    rng: np.random.Generator,
    off: tuple[float, float] = (0.1, 0.3),
    shift: float = 0.012,
) -> Inertials:
    """Masses and second moments 10 to 30 % off, centres of mass up to 12 mm: a body still.

    The second moments of mass along the principal axes are scaled, each on its own; whatever
    they are, the triangle inequality of the inertia tensor holds.
    """
    n = len(inertials.mass)
    inertia = np.empty_like(inertials.inertia)
    for k in range(n):
        moments, axes = np.linalg.eigh(inertials.inertia[k])
        second = 0.5 * moments.sum() - moments
        second *= _off(rng, 3, off)
        inertia[k] = axes @ np.diag(second.sum() - second) @ axes.T
    return Inertials(
        inertials.mass * _off(rng, n, off),
        inertials.centre + rng.uniform(-shift, shift, (n, 3)),
        inertia,
    )


def _off(rng: np.random.Generator, n: int, off: tuple[float, float]) -> FloatArray:
    return 1.0 + rng.uniform(*off, n) * rng.choice([-1.0, 1.0], n)


def with_body(inertials: Inertials, link: int, mass: float, centre: FloatArray) -> Inertials:
    """A homogeneous ball of 1 kg/dm³ fixed to a link: `mass` kg at `centre` (3,) m."""
    radius = (mass / 1000.0 * 0.75 / np.pi) ** (1.0 / 3.0)
    masses, centres, inertias = (
        inertials.mass.copy(),
        inertials.centre.copy(),
        inertials.inertia.copy(),
    )
    total = masses[link] + mass
    middle = (masses[link] * centres[link] + mass * centre) / total
    inertias[link] = (
        inertias[link]
        + masses[link] * _steiner(centres[link] - middle)
        + 0.4 * mass * radius**2 * np.eye(3)
        + mass * _steiner(centre - middle)
    )
    masses[link], centres[link] = total, middle
    return Inertials(masses, centres, inertias)


def _steiner(away: FloatArray) -> FloatArray:
    return away @ away * np.eye(3) - np.outer(away, away)


def rigid_body_model(
    given: GivenRobot, inertials: Inertials, gravity: FloatArray
) -> mujoco.MjModel:
    """MuJoCo's model of the links alone: no armature, damping, friction, limits or contacts."""
    model = mujoco.MjModel.from_xml_path(str(given.urdf))
    set_inertials(model, given, inertials)
    model.dof_armature[:] = 0.0
    model.opt.gravity[:] = gravity
    mujoco.mj_setConst(model, mujoco.MjData(model))
    return model


def set_inertials(model: mujoco.MjModel, given: GivenRobot, inertials: Inertials) -> None:
    """Give the bodies of a model of this robot other inertials, in place."""
    for k, body in enumerate(_bodies(model, given)):
        moments, axes = np.linalg.eigh(inertials.inertia[k])
        if np.linalg.det(axes) < 0.0:
            axes[:, 0] *= -1.0
        model.body_mass[body] = inertials.mass[k]
        model.body_ipos[body] = inertials.centre[k]
        model.body_inertia[body] = moments
        mujoco.mju_mat2Quat(model.body_iquat[body], np.ascontiguousarray(axes).ravel())


def _bodies(model: mujoco.MjModel, given: GivenRobot) -> list[int]:
    """Body that each joint carries; the joints of the file are those of the configuration."""
    ids = [mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, name) for name in given.joints]
    if ids != list(range(model.njnt)):
        raise ValueError(f"{given.urdf}: joints are not those of {given.yaml}, in that order")
    return [int(model.jnt_bodyid[joint]) for joint in ids]
