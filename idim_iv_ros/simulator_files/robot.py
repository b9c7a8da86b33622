"""A robot to export: its control law, its links, and the values that all its files share.

The model has one body for each joint: its link, and all that fixed and locked joints carry behind
it. Fixed links keep the inertials of the URDF, which are subtracted from that body. Where nothing
physical is left for the link, the change is spread over all of them: one affine map of the whole
body, J → T J Tᵀ, maps the nominal one to the new one and every part of it to a physical part.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import pinocchio as pin

from idim_iv_ros.configuration import Configuration
from idim_iv_ros.diagnosis.result.document import GapResult
from idim_iv_ros.effects.registry import BY_NAME, STRUCTURAL, part_of
from idim_iv_ros.errors import UsageError
from idim_iv_ros.files import ANY_GAP, read_text
from idim_iv_ros.identification.result import IdentificationResult
from idim_iv_ros.model import InverseModel, RobotModel, build_inverse_model, read_urdf_file
from idim_iv_ros.model.base_parameters import NON_NEGATIVE
from idim_iv_ros.model.inverse_model import require_same_robot
from idim_iv_ros.model.parameters import INERTIAL, body_of, parameters_of
from idim_iv_ros.model.urdf import LARGEST, Urdf, read_urdf_text
from idim_iv_ros.physical import PhysicalParameters
from idim_iv_ros.physical.pseudo_inertia import inertial_parameters, pseudo_inertia, upper_root
from idim_iv_ros.physical.remainder import USUAL_ERROR
from idim_iv_ros.simulation import SimulatedEffect, control_law
from idim_iv_ros.simulation.effects import contributions_of
from idim_iv_ros.simulator_files import named
from idim_iv_ros.simulator_files.named import CorrectedModel, Load, cause_name, kind_of
from idim_iv_ros.simulators.effects_file import constant_torques, effect_of_cause
from idim_iv_ros.types import FloatArray

_ROUNDING = 1e-12


@dataclass(frozen=True)
class DriveLaw:
    """Control law as gains from errors to joint torques, (n_joints,) each; zero if unknown."""

    kp: FloatArray  # N m/rad
    kd: FloatArray  # N m s/rad
    ki: FloatArray  # N m/(rad s)
    # Whether the kd term acts on the error of the speed; otherwise on the speed
    velocity_reference: bool
    limit: FloatArray  # N m: infinite where there is none
    period: float  # s, of the control
    delay: FloatArray  # s, from the command to the torque
    configured: bool  # Whether a law is known
    beyond: tuple[str, ...]  # What of the law simulators have no element for

    @property
    def in_actuators(self) -> bool:
        """Return whether proportional and derivative actuators express the whole law."""
        return self.configured and not (self.beyond or np.any(self.ki) or np.any(self.delay))

    @property
    def words(self) -> str:
        """Return the law as a formula in words."""
        if not self.configured:
            return "the control law is not known: give each motor its torque"
        slip = "(dq_ref - dq)" if self.velocity_reference else "(-dq)"
        integral = " + ki * integral of (q_ref - q)" if np.any(self.ki) else ""
        return f"torque = kp * (q_ref - q) + kd * {slip}{integral}, every {self.period:g} s"


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

    armature: FloatArray  # kg m²
    damping: FloatArray  # N m s/rad
    friction: FloatArray  # N m
    offset: FloatArray  # N m
    # s, by which dry friction turns before its joint; zero as a robot's, and 9.5 ms as MuJoCo's
    # with the defaults of its solver
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
        """Return the inertials of changed links, and notes on them.

        Raises UsageError: a link for which no physical body is left.
        """
        urdf, robot, joints, source = self.urdf, self.robot, self.bodies, self.source
        # Links with mass that a joint carries: placement in its frame, and XX … M (10,) there.
        carried: dict[str, dict[str, tuple[pin.SE3, FloatArray]]] = {joint: {} for joint in joints}
        for frame in robot.pinocchio.frames:
            inertial = urdf.links[frame.name] if frame.type == pin.FrameType.BODY else None
            if inertial is not None and inertial.mass > 0.0 and frame.parentJoint > 0:
                joint = robot.joints[robot.order[frame.parentJoint - 1]]
                body = pin.Inertia(inertial.mass, inertial.centre, inertial.inertia)
                place = frame.placement
                carried[joint][frame.name] = (place, parameters_of(place.act(body)))
        changed, notes = {}, []
        for joint, target in joints.items():
            main, parts = urdf.joints[joint].child, carried[joint]
            others = [link for link in parts if link != main]
            rest = target - sum((parts[link][1] for link in others), np.zeros(10))
            _, reference = parts.get(main, (None, rest))
            rounding = _ROUNDING * np.abs(reference).max()
            if main in parts and np.abs(rest - reference).max() <= rounding:
                continue
            if named.is_possible(rest, reference):
                changed[main] = body_of(rest)
                continue
            names = ", ".join(others)
            if not others:
                raise UsageError(f"{source}: link {main}: no body is left for it")
            nominal = sum((parameters for _, parameters in parts.values()), np.zeros(10))
            try:
                before = np.linalg.inv(upper_root(pseudo_inertia(nominal)))
                root = upper_root(pseudo_inertia(target)) @ before
            except np.linalg.LinAlgError as error:
                raise UsageError(
                    f"{source}: link {main}: what is fixed behind it ({names}) weighs more than "
                    f"the recording lets {joint} carry, and the nominal inertials are too "
                    "degenerate to spread the change; correct their inertials"
                ) from error
            for link, (place, parameters) in parts.items():
                matrix = root @ pseudo_inertia(parameters) @ root.T
                changed[link] = place.actInv(body_of(inertial_parameters(matrix)))
            notes.append(
                f"{main} and what is fixed behind it ({names}) changed together: with the "
                "inertials that the file gives these, no body would be left for the link"
            )
        return changed, tuple(notes)

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
        """Return the configured law with the gains, delays and limits that the diagnosis found."""
        section, joints = self.configuration.controller, self.robot.joints
        n = len(joints)
        law = control_law(section, n) if section.type != "unknown" else None
        numbers = {name: np.zeros(n) for name in ("kp", "kd", "ki")}
        if law is not None:
            numbers = {name: getattr(law, name).copy() for name in numbers}
        limit = np.array(section.torque_limit or [np.inf] * n)
        delay, beyond = np.full(n, section.delay), []
        for effect in self.structural:
            value, part = effect.parameters, part_of(effect.effect)
            at = [effect.joint in (None, joint) for joint in joints]
            if part == "delay":
                delay[at] += value.get("delay", 0.0)
            elif part == "limit" and not value.get("slope", 0.0):
                limit[at] = np.minimum(limit[at], value["knee"])
            elif part == "gains" and law is not None:
                for name, number in value.items():
                    if name in numbers:
                        numbers[name][at] = number
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


_LONGEST_DELAY = 1.0  # s, as controller.delay
_SAME = 1e-6  # relative to the largest of its kind: rounding of a file that was written again


def read_answer(
    path: Path,
    configuration: Configuration,
    file: Path,
    *,
    refit: bool = False,
    without: Collection[str] = (),
    remainder: bool = False,
) -> ExportedRobot:
    """Read a result.json or gap.json to export, and check that it belongs to this robot.

    `file` is the URDF or MJCF of the configuration.

    Raises UsageError: it is neither, or of another robot or URDF, has no physically consistent
    parameters, or not the cause to leave out.
    """
    text = read_text(path, "the result")
    kind = GapResult if ANY_GAP in text else IdentificationResult
    result: Result = kind.from_json(text, str(path))
    source, urdf = str(file), read_urdf_file(file)
    model = build_inverse_model(configuration, urdf, source)
    require_same_robot(path, result, configuration, model.robot, source)
    physical = _require_same_nominal(path, result, model, source)
    gap = result if isinstance(result, GapResult) else None
    if (refit or gap is None) and (without or remainder):
        dense = "one dense refit" if refit else "an identification"
        what = f"--remainder: {dense} names no causes, so that nothing remains beside them"
        if without:
            what = f"--without {', '.join(without)}: {dense} has no causes that could be left out"
        raise UsageError(f"{path}: {what}")
    causes = [] if gap is None else list(gap.causes)
    for number, cause in enumerate(causes):
        if cause.effect not in BY_NAME:
            raise UsageError(
                f"{path}: causes.{number}: {cause_name(cause)} is unknown to this version of "
                "idim_iv_ros"
            )
        delay = cause.parameters.get("delay")
        if delay is not None and delay.value > _LONGEST_DELAY:
            raise UsageError(f"{path}: causes.{number}: a delay of {delay.value:g} s is no drive's")
    for name in without:
        if not any(name in (cause.effect, cause_name(cause)) for cause in causes):
            names = ", ".join(map(cause_name, causes)) or "none"
            raise UsageError(
                f"{path}: names no cause {name} that could be left out; its causes: {names}"
            )
    kept = [cause for cause in causes if not {cause.effect, cause_name(cause)} & set(without)]
    others = [cause for cause in causes if cause not in kept]
    structural = [cause for cause in kept if BY_NAME[cause.effect].kind == "structural"]
    whole, about = refit or remainder, f"{path}: causes"
    effects = tuple(effect_of_cause(cause, about, refit=whole) for cause in structural)
    contributions_of(effects, model.robot.joints)  # names and numbers as the simulator takes them
    notes = tuple(
        f"{cause_name(cause)} is indistinguishable from "
        f"{', '.join(other.effect for other in cause.indistinguishable_from)}: it is a guess"
        for cause in structural
        if cause.indistinguishable_from
    )
    given = model.robot.gravity
    corrected = CorrectedModel(physical.parameters, (), (), given)
    if gap is not None and not refit:
        make = named.with_remainder if remainder else named.corrected_model
        corrected = make(model, kept, others, physical, str(path))
        masses = [number for number in corrected.parameters if kind_of(number.name) == "M"]
        notes += tuple(
            f"the link of {joint} weighs {mass.value:.3g} kg, {mass.given:.3g} in the nominal "
            f"model: more than three times the usual error of {100.0 * USUAL_ERROR:.0f} %, so that "
            "an effect that was not found may be in it"
            for joint, mass in zip(model.robot.joints, masses, strict=True)
            if mass.source == "recording and nominal model"
            and abs(mass.value - mass.given) > 3.0 * USUAL_ERROR * mass.given
        )
        if not np.array_equal(corrected.gravity, given):
            listed = ", ".join(f"{component:.5g}" for component in corrected.gravity)
            tilt = next(c.effect for c in kept if BY_NAME[c.effect].part == "gravity")
            notes += (
                f"{tilt}: robot.gravity would be [{listed}] m/s²; an MJCF that is made from a URDF "
                "has it, no other file",
            )
    return ExportedRobot(
        path=path,
        result=result,
        configuration=configuration,
        source=file,
        content=file.read_bytes(),
        urdf=read_urdf_text(urdf, source),
        refit=refit or gap is None,
        robot=model.robot,
        physical=physical,
        model=corrected,
        structural=(*effects, *corrected.effects),
        in_parameters=tuple(
            f"{cause_name(cause)}: {named.numbers_in_words(cause.parameters)}"
            for cause in kept
            if cause.kind == "parametric"
        ),
        left_out=tuple(map(cause_name, others)),
        remarks=notes,
    )


def _require_same_nominal(
    path: Path, result: Result, model: InverseModel, source: str
) -> PhysicalParameters:
    """Return the physical parameters after checking that the nominal model is unchanged.

    Parameters that the recording does not determine have nominal values.
    """
    again = f"run `idim-iv {result.written_by}` again"
    physical = result.physical
    if physical is None:
        why = result.why_no_physical or "it was written before they were part of it"
        raise UsageError(f"{path}: has no physically consistent parameters: {why}; then {again}")
    layout = model.regressor.layout
    now = dict(zip(layout.names, layout.vector(model.robot.given), strict=True))
    for name in layout.names:
        if kind_of(name) in INERTIAL and name not in physical.values:
            raise UsageError(f"{path}: physical.parameters: {name} is missing; {again}")
    sizes: dict[str, float] = {}
    for parameter in physical.parameters:
        sizes[parameter.unit] = max(sizes.get(parameter.unit, 1e-12), abs(parameter.given))
    for parameter in physical.parameters:
        name, kind = parameter.name, kind_of(parameter.name)
        # Links are judged as bodies.
        bounded = kind in NON_NEGATIVE and kind not in INERTIAL and name not in physical.shared
        if not abs(parameter.value) <= LARGEST or (bounded and parameter.value < 0.0):
            raise UsageError(
                f"{path}: physical.parameters: {name} is {parameter.value:g} {parameter.unit}, "
                "which no robot has"
            )
        value = now.get(name, parameter.given)
        if abs(value - parameter.given) > _SAME * sizes[parameter.unit]:
            raise UsageError(
                f"{path}: the nominal model changed since: {name} was {parameter.given:.6g} "
                f"{parameter.unit}, and is {value:.6g} in {source} and its configuration; {again}"
            )
    return physical
