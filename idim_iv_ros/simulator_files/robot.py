"""A robot to export: its control law, its links, and the values that all its files share.

The model has one body for each joint: its link, and all that fixed and locked joints carry behind
it. Fixed links keep the inertials of the URDF, which are subtracted from that body. Where nothing
physical is left for the link, the change is spread over all of them: one affine map of the whole
body, J → T J Tᵀ, maps the nominal one to the new one and every part of it to a physical part.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import pinocchio as pin

from idim_iv_ros.configuration import Configuration, ControllerSection
from idim_iv_ros.diagnosis.result.document import GapResult
from idim_iv_ros.effects.registry import STRUCTURAL, part_of
from idim_iv_ros.errors import UsageError
from idim_iv_ros.identification.result import IdentificationResult
from idim_iv_ros.model import RobotModel
from idim_iv_ros.model.parameters import INERTIAL, body_of, parameters_of
from idim_iv_ros.model.urdf import Urdf
from idim_iv_ros.physical import PhysicalParameters
from idim_iv_ros.physical.pseudo_inertia import inertial_parameters, pseudo_inertia, upper_root
from idim_iv_ros.simulation import SimulatedEffect, control_law
from idim_iv_ros.simulator_files.named import CorrectedModel, Load, is_possible
from idim_iv_ros.simulators.effects_file import constant_torques
from idim_iv_ros.types import FloatArray


@dataclass(frozen=True)
class DriveLaw:
    """Control law as gains from errors to joint torques, (n_joints,) each; zero if unknown."""

    # kp, kd, ki: N m/rad, N m s/rad, N m/(rad s)
    kp: FloatArray
    kd: FloatArray
    ki: FloatArray
    # Whether the kd term acts on the error of the speed; otherwise on the speed
    velocity_reference: bool
    limit: FloatArray  # N m: infinite where there is none
    # period, delay: s: of the control; from the command to the torque
    period: float
    delay: FloatArray
    configured: bool  # Whether a law is known
    beyond: tuple[str, ...]  # What of the law simulators have no element for

    @property
    def in_actuators(self) -> bool:
        """Return whether proportional and derivative actuators express the whole law."""
        return (
            self.configured and not self.beyond and not np.any(self.ki) and not np.any(self.delay)
        )

    @property
    def words(self) -> str:
        """Return the law as a formula in words."""
        if not self.configured:
            return "the control law is not known: give each motor its torque"
        slip = "(dq_ref - dq)" if self.velocity_reference else "(-dq)"
        integral = " + ki * integral of (q_ref - q)" if np.any(self.ki) else ""
        return f"torque = kp * (q_ref - q) + kd * {slip}{integral}, every {self.period:g} s"


def drive_law(
    section: ControllerSection, joints: Sequence[str], effects: Sequence[SimulatedEffect]
) -> DriveLaw:
    """Return the configured law with the gains, delays and limits that the diagnosis found.

    They are in effects whose part is gains, delay or limit.
    """
    n = len(joints)
    law = None if section.type == "unknown" else control_law(section, n)
    names = ("kp", "kd", "ki")
    numbers = {name: np.zeros(n) if law is None else getattr(law, name).copy() for name in names}
    limit = np.full(n, np.inf) if section.torque_limit is None else np.array(section.torque_limit)
    delay, beyond = np.full(n, section.delay), []
    for effect in effects:
        value, part = effect.parameters, part_of(effect.effect)
        places = list(range(n)) if effect.joint is None else [list(joints).index(effect.joint)]
        if part == "delay":
            delay[places] += value.get("delay", 0.0)
        elif part == "limit" and not value.get("slope", 0.0):
            limit[places] = np.minimum(limit[places], value["knee"])
        elif part == "gains" and law is not None:
            for name, number in value.items():
                if name in numbers:
                    numbers[name][places] = number
                elif number:
                    beyond.append(f"{name} {number:.4g} at {effect.joint}")
    return DriveLaw(
        **numbers,
        velocity_reference=law is not None and law.velocity_reference,
        limit=limit,
        period=section.period or 0.001,
        delay=delay,
        configured=law is not None,
        beyond=tuple(beyond),
    )


@dataclass(frozen=True)
class Coupled:
    """A fixed tendon over two joints: q_first + direction q_second."""

    first: int
    second: int
    direction: float
    damping: float
    friction: float
    inertia: float = 0.0

    def name(self, joints: Sequence[str]) -> str:
        """Return the name of the tendon."""
        return f"{joints[self.first]}_{joints[self.second]}"


@dataclass(frozen=True)
class JointValues:
    """Drives and friction of all joints, (n_joints,) each."""

    # armature, damping, friction, offset: kg m², N m s/rad, N m, N m
    armature: FloatArray
    damping: FloatArray
    friction: FloatArray
    offset: FloatArray
    # (n_joints,) s: by which dry friction turns before its joint; zero as a robot's, and 9.5 ms as
    # MuJoCo's with the defaults of its solver
    lead: FloatArray
    couplings: tuple[Coupled, ...] = ()  # of coupled transmissions


Result = GapResult | IdentificationResult


@dataclass(frozen=True)
class ExportedRobot:
    """A result to export, the nominal model that it changes, and values for all files."""

    path: Path  # of the result
    result: Result
    configuration: Configuration
    source: Path  # of the nominal model: a URDF or an MJCF
    content: bytes
    urdf: Urdf
    # Whether the model is the physical set of the refit; otherwise the nominal one with the causes
    refit: bool
    robot: RobotModel
    physical: PhysicalParameters
    model: CorrectedModel
    structural: tuple[SimulatedEffect, ...]  # Causes beyond the model
    in_parameters: tuple[str, ...]  # Causes that are no effects, in words
    left_out: tuple[str, ...]  # Names of causes that were not wanted
    remarks: tuple[str, ...]  # What a reader of the files must know of the result

    @property
    def gap(self) -> GapResult | None:
        """Return the diagnosis; None where the result is an identification."""
        return self.result if isinstance(self.result, GapResult) else None

    @property
    def bags(self) -> tuple[str, ...]:
        """Return the recordings, as the result names them."""
        return tuple(bag if isinstance(bag, str) else bag.path for bag in self.result.bags)

    @property
    def origin(self) -> str:
        """Return the file and the kind of the result in words."""
        return f"{self.path.name} ({'identification' if self.gap is None else 'diagnosis'})"

    def values(self, kind: str) -> list[float]:
        """Return drive parameters of a kind by joint; given ones where the model has none."""
        values, given = self.model.values, self.robot.given.of_drives[kind]
        return [values.get(f"{kind}{k + 1}", float(other)) for k, other in enumerate(given)]

    @cached_property
    def bodies(self) -> dict[str, FloatArray]:
        """Return XX … M (10,) of the body that each joint carries, without payloads."""
        values = self.model.values
        return {
            name: np.array([values[f"{kind}{joint}"] for kind in INERTIAL])
            for joint, name in enumerate(self.robot.joints, 1)
        }

    @cached_property
    def links(self) -> tuple[dict[str, pin.Inertia], tuple[str, ...]]:
        """Return the inertials of changed links, and notes on them."""
        return link_bodies(self.urdf, self.robot, self.bodies, str(self.source))

    @cached_property
    def mounted(self) -> dict[str, tuple[str, Load]]:
        """Return payloads by an unused link name, each with the link that carries it."""
        taken, mounted = set(self.urdf.links), {}
        for load in self.model.loads:
            name = load.name
            while name in taken:
                name += "_found"
            taken.add(name)
            mounted[name] = (self.urdf.joints[load.joint].child, load)
        return mounted

    @cached_property
    def drives(self) -> JointValues:
        """Return drives and friction of all joints."""
        robot, values = self.robot, self.model.values
        numbers = {kind: np.array(self.values(kind)) for kind in robot.given.of_drives}
        leads = {} if self.gap is None else self.gap.friction_leads
        return JointValues(
            armature=numbers["Ia"],
            damping=np.maximum(numbers["Fv"], 0.0),
            friction=np.maximum(numbers["Fc"], 0.0),
            offset=numbers["off"],
            lead=np.array([leads.get(name, 0.0) for name in robot.joints]),
            couplings=tuple(
                Coupled(
                    int(first),
                    int(second),
                    1.0,
                    values.get(f"Fvm{second + 1}", 0.0),
                    values.get(f"Fcm{second + 1}", 0.0),
                    float(numbers["Ia"][second]),
                )
                for first, second in robot.given.coupling_joints
            ),
        )

    @cached_property
    def negative_friction(self) -> tuple[SimulatedEffect, ...]:
        """Return Fv and Fc below zero as effects with the same torque (`Cause.instead_of`).

        Simulators allow no negative friction: only a joint's total friction is simulated.
        """
        values = self.model.values
        return tuple(
            SimulatedEffect(effect.name, name, numbers)
            for joint, name in enumerate(self.robot.joints, 1)
            for kind in ("Fv", "Fc")
            if values.get(f"{kind}{joint}", 0.0) < 0.0
            for effect in STRUCTURAL
            if (numbers := effect.instead_of(kind, values[f"{kind}{joint}"]))
        )

    @property
    def effects(self) -> tuple[SimulatedEffect, ...]:
        """Return all effects, negative friction and constant torques included."""
        constant = constant_torques(self.robot.joints, dict(enumerate(self.drives.offset)))
        return (*self.structural, *self.negative_friction, *constant)

    @cached_property
    def law(self) -> DriveLaw:
        """Return the configured law with the effects of the diagnosis on it."""
        return drive_law(self.configuration.controller, self.robot.joints, self.structural)

    @property
    def coupled_friction(self) -> dict[str, float]:
        """Return the changed friction of coupled transmissions, which no URDF has, by name."""
        return {
            parameter.name: parameter.value
            for parameter in self.model.parameters
            if parameter.name.startswith(("Fvm", "Fcm")) and parameter.value != parameter.given
        }

    @property
    def notes(self) -> tuple[str, ...]:
        """Return notes on links and friction for the user."""
        negative = tuple(
            f"friction of {effect.joint} below zero, which another effect there makes up for, is "
            f"the {effect.effect} with parameters {effect.parameters}: the file holds zero in its "
            "place"
            for effect in self.negative_friction
        )
        return (*self.links[1], *negative)


_ROUNDING = 1e-12


@dataclass(frozen=True)
class _Part:
    """A link with mass, in the frame of the joint that carries it."""

    link: str
    place: pin.SE3
    parameters: FloatArray  # XX … M (10,)


def link_bodies(
    urdf: Urdf, robot: RobotModel, joints: Mapping[str, FloatArray], source: str
) -> tuple[dict[str, pin.Inertia], tuple[str, ...]]:
    """Return the inertials of changed links, and notes on them.

    `joints`: XX … M (10,) of the body that each identified joint carries; `source` names the URDF.

    Raises UsageError: a link for which no physical body is left.
    """
    carried = _carried_links(urdf, robot)
    changed, notes = {}, []
    for joint, target in joints.items():
        main = urdf.joints[joint].child
        parts = carried[joint]
        others = [part for part in parts if part.link != main]
        main_part = next((part for part in parts if part.link == main), None)
        rest = target - sum((other.parameters for other in others), np.zeros(10))
        reference = rest if main_part is None else main_part.parameters
        rounding = _ROUNDING * np.abs(reference).max()
        if main_part is not None and np.abs(rest - reference).max() <= rounding:
            continue
        if is_possible(rest, reference):
            changed[main] = body_of(rest)
            continue
        names = ", ".join(other.link for other in others)
        if not others:
            raise UsageError(f"{source}: link {main}: no body is left for it")
        spread = _spread(parts, target)
        if spread is None:
            raise UsageError(
                f"{source}: link {main}: what is fixed behind it ({names}) weighs more than the "
                f"recording lets {joint} carry, and the nominal inertials are too degenerate to "
                "spread the change; correct their inertials"
            )
        changed |= spread
        notes.append(
            f"{main} and what is fixed behind it ({names}) changed together: with the inertials "
            "that the file gives these, no body would be left for the link"
        )
    return changed, tuple(notes)


def _carried_links(urdf: Urdf, robot: RobotModel) -> dict[str, list[_Part]]:
    """Return the links with mass that each identified joint carries, in its frame."""
    carried: dict[str, list[_Part]] = {joint: [] for joint in robot.joints}
    for frame in robot.pinocchio.frames:
        inertial = urdf.links[frame.name] if frame.type == pin.FrameType.BODY else None
        if inertial is not None and inertial.mass > 0.0 and frame.parentJoint > 0:
            joint = robot.joints[robot.order[frame.parentJoint - 1]]
            body = pin.Inertia(inertial.mass, inertial.centre, inertial.inertia)
            place = frame.placement
            carried[joint].append(_Part(frame.name, place, parameters_of(place.act(body))))
    return carried


def _spread(parts: list[_Part], target: FloatArray) -> dict[str, pin.Inertia] | None:
    """Map all parts by one affine map to the whole `target`; None if that is impossible."""
    nominal = sum((part.parameters for part in parts), np.zeros(10))
    try:
        root = upper_root(pseudo_inertia(target)) @ np.linalg.inv(
            upper_root(pseudo_inertia(nominal))
        )
    except np.linalg.LinAlgError:
        return None
    mapped = {}
    for part in parts:
        matrix = root @ pseudo_inertia(part.parameters) @ root.T
        mapped[part.link] = part.place.actInv(body_of(inertial_parameters(matrix)))
    return mapped
