"""The true robot and the nominal model of a cell: URDF files and drive inertias."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from xml.etree import ElementTree

import cvxpy
import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from idim_iv_ros import identify, load_configuration
from idim_iv_ros.configuration import Configuration
from idim_iv_ros.model import DynamicParameters, InverseModel, build_inverse_model
from idim_iv_ros.model.parameters import INERTIAL, ParameterLayout

FloatArray = NDArray[np.float64]

CONFIG = Path(__file__).parents[2] / "config"
ERROR = 0.1  # of every inertial
# m, of a payload in the frame of the last link
LOAD_CENTRE = {
    "arm2": (0.28, 0.0, 0.04),
    "arm6": (0.03, -0.02, 0.08),
    "arm7": (0.03, -0.02, 0.08),
}
RADIUS = 0.04  # m, of a payload, a ball
_DRIVES = 0.5  # relative, usual error of drives and friction in a data sheet


@dataclass(frozen=True)
class Robot:
    """A configuration with its URDF, and the numbers that they hold."""

    configuration: Configuration
    parameters: DynamicParameters

    def model(self) -> InverseModel:
        """Inverse model in base parameters."""
        urdf = self.configuration.robot.urdf
        assert urdf is not None
        return build_inverse_model(
            self.configuration, urdf.read_text(encoding="utf-8"), urdf.name
        )  # fmt: skip


def data_sheet(arm: str) -> Robot:
    """Read an arm of config/."""
    configuration = load_configuration(CONFIG / f"{arm}.yaml")
    urdf = configuration.robot.urdf
    assert urdf is not None
    text = urdf.read_text(encoding="utf-8")
    return Robot(configuration, build_inverse_model(configuration, text, urdf.name).robot.given)


def off(robot: Robot, seed: int, path: Path) -> Robot:
    """Write a robot whose masses, centres of mass and inertias are ten percent off."""
    random = np.random.default_rng(seed)
    inertial = []
    for values in robot.parameters.inertial:
        link = pin.Inertia.FromDynamicParameters(values)
        mass, centre, inertia = 1.0 + ERROR * random.uniform(-1.0, 1.0, 3)
        inertial.append(
            pin.Inertia(
                link.mass * mass, link.lever * centre, link.inertia * inertia
            ).toDynamicParameters()
        )
    return written(robot, replace(robot.parameters, inertial=np.array(inertial)), path)


def with_body(robot: Robot, mass: float, centre: Sequence[float], path: Path) -> Robot:
    """Write a robot with a ball on its last link."""
    ball = pin.Inertia(mass, np.array(centre), 0.4 * mass * RADIUS**2 * np.eye(3))
    inertial = robot.parameters.inertial.copy()
    inertial[-1] += ball.toDynamicParameters()
    return written(robot, replace(robot.parameters, inertial=inertial), path)


def fitted(robot: Robot, bags: Sequence[Path], path: Path) -> Robot:
    """Write the nominal model that recordings identify, as near to it as physics allows.

    Weighted with the deviations of the base parameters; what these leave open stays at the data
    sheet. Every link is a possible body: its pseudo-inertia is positive definite.
    """
    model = robot.model()
    found = {each.name: each for each in identify(list(bags), robot.configuration).parameters}
    wanted = np.array([found[name].value for name in model.base.names])
    deviations = np.array([found[name].std for name in model.base.names])
    layout = model.regressor.layout
    start = layout.vector(robot.parameters)
    sizes = layout.vector(_sizes(robot.parameters))
    step = cvxpy.Variable(len(start))
    vector = start + cvxpy.multiply(sizes, step)
    misfit = (model.base.grouping @ vector - wanted) / deviations
    problem = cvxpy.Problem(
        cvxpy.Minimize(cvxpy.sum_squares(misfit) + cvxpy.sum_squares(step)),
        [
            *(_pseudo_inertia(vector, layout, joint) >> 1e-5 for joint in range(layout.joints)),
            *(
                vector[place] >= 1e-3
                for place, each in enumerate(layout.parameters)
                if each.kind in ("Ia", "Fv", "Fc")
            ),
        ],
    )
    problem.solve(solver="CLARABEL")
    return written(robot, layout.dynamic_parameters(np.asarray(vector.value)), path)


def _pseudo_inertia(
    vector: cvxpy.Expression, layout: ParameterLayout, joint: int
) -> cvxpy.Expression:
    """Σ m (r, 1)(r, 1)ᵀ of a link, (4, 4) (Wensing, Kim and Slotine 2018)."""
    place = {
        each.kind: k
        for k, each in enumerate(layout.parameters)
        if each.joint == joint and each.kind in INERTIAL
    }
    own = {kind: vector[k] for kind, k in place.items()}
    half = 0.5 * (own["XX"] + own["YY"] + own["ZZ"])
    return cvxpy.bmat(
        [
            [half - own["XX"], -own["XY"], -own["XZ"], own["MX"]],
            [-own["XY"], half - own["YY"], -own["YZ"], own["MY"]],
            [-own["XZ"], -own["YZ"], half - own["ZZ"], own["MZ"]],
            [own["MX"], own["MY"], own["MZ"], own["M"]],
        ]
    )


def _sizes(given: DynamicParameters) -> DynamicParameters:
    """Usual errors of a data sheet."""
    inertial = np.empty_like(given.inertial)
    for own, values in zip(inertial, given.inertial, strict=True):
        own[0], own[1:4] = ERROR * values[0], ERROR * 0.1 * values[0]
        own[4:] = ERROR * max(float(values[[4, 6, 9]].max()), 1e-4)
    return replace(
        given,
        inertial=inertial,
        drive_inertia=_DRIVES * given.drive_inertia,
        viscous=_DRIVES * given.viscous,
        coulomb=_DRIVES * given.coulomb,
        offset=_DRIVES * given.coulomb,
    )


def written(robot: Robot, parameters: DynamicParameters, path: Path) -> Robot:
    """Write a URDF with other numbers; torque offsets have no place there."""
    section = robot.configuration.robot
    assert section.urdf is not None
    tree = ElementTree.parse(section.urdf)
    links = {each.get("name"): each for each in tree.iter("link")}
    joints = {each.get("name"): each for each in tree.iter("joint")}
    for number, name in enumerate(section.joints):
        joint = joints[name]
        child = joint.find("child")
        assert child is not None
        link = links[child.get("link")]
        for each in link.findall("inertial"):
            link.remove(each)
        link.append(_inertial(parameters.inertial[number]))
        dynamics = joint.find("dynamics")
        assert dynamics is not None
        dynamics.set("damping", repr(float(parameters.viscous[number])))
        dynamics.set("friction", repr(float(max(parameters.coulomb[number], 0.0))))
    tree.write(path)
    simulator = robot.configuration.simulator.model_copy(
        update={"armature": np.maximum(parameters.drive_inertia, 1e-4).tolist()}
    )
    configuration = robot.configuration.model_copy(
        update={
            "robot": section.model_copy(update={"urdf": path}),
            "simulator": simulator,
        }
    )
    return Robot(configuration, replace(parameters, offset=np.zeros(len(section.joints))))


def _inertial(values: FloatArray) -> ElementTree.Element:
    body = pin.Inertia.FromDynamicParameters(values)
    element = ElementTree.Element("inertial")
    centre = " ".join(repr(float(each)) for each in body.lever)
    ElementTree.SubElement(element, "origin", xyz=centre, rpy="0 0 0")
    ElementTree.SubElement(element, "mass", value=repr(float(body.mass)))
    moments = {
        f"i{'xyz'[a]}{'xyz'[b]}": repr(float(body.inertia[a, b]))
        for a in range(3)
        for b in range(a, 3)
    }
    ElementTree.SubElement(element, "inertia", moments)
    return element
