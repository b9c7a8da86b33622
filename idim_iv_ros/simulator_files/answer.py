"""What a result says of a robot, and whether it says it of this one."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from idim_iv_ros.configuration import Configuration
from idim_iv_ros.diagnosis.result import Cause, GapResult, ParameterError
from idim_iv_ros.effects.registry import BY_NAME, name_of
from idim_iv_ros.errors import UsageError
from idim_iv_ros.files import GAP_FORMAT, read_text
from idim_iv_ros.identification.result import IdentificationResult
from idim_iv_ros.model import (
    InverseModel,
    RobotModel,
    build_inverse_model,
    kinematics_digest,
)
from idim_iv_ros.model.base_parameters import NON_NEGATIVE
from idim_iv_ros.model.parameters import INERTIAL
from idim_iv_ros.model.urdf_reader import LARGEST
from idim_iv_ros.physical import PhysicalParameters, StandardValue
from idim_iv_ros.physical.remainder import USUAL_ERROR, Remainder
from idim_iv_ros.simulation import SimulatedEffect
from idim_iv_ros.simulation.effects import joint_effects
from idim_iv_ros.simulator_files.named import (
    Load,
    cause_name,
    kept_causes,
    mended_model,
    numbers_in_words,
    with_remainder,
)
from idim_iv_ros.simulators.effects_file import PlantedEffect
from idim_iv_ros.types import FloatArray

_LARGEST = 50.0  # MB
_LONGEST_DELAY = 1.0  # s, as controller.delay
_SAME = 1e-6  # relative to the largest of its kind: rounding of a file that was written again


@dataclass(frozen=True)
class Answer:
    """A result that belongs to a robot.

    Attributes
    ----------
    path : Path
    bags : tuple of str
        Its recordings, as the result names them.
    diagnosed : bool
        A gap.json; otherwise a result.json.
    refit : bool
        Whether the parameters are the physical set of the refit; otherwise they are the nominal
        ones with the causes.
    robot : RobotModel
    physical : PhysicalParameters
    parameters : tuple of StandardValue
    loads : tuple of Load
        Payloads as bodies of their own; empty of a refit.
    gravity : (3,) m/s²
    effects : tuple of PlantedEffect
        Causes beyond these.
    in_parameters : tuple of str
        Causes that are no effects, in words.
    left_out : tuple of str
        Names of causes that were not wanted.
    friction_leads : dict of str to float
        s by which dry friction turned before its joint in the recording, as a simulator has it.
    errors : tuple of ParameterError
        What of the torque gap the causes leave at each joint.
    remainder : Remainder or None
        What no cause explains, where `parameters` hold it.
    notes : tuple of str
        What a reader of the files must know.
    """

    path: Path
    bags: tuple[str, ...]
    diagnosed: bool
    refit: bool
    robot: RobotModel
    physical: PhysicalParameters
    parameters: tuple[StandardValue, ...]
    loads: tuple[Load, ...]
    gravity: FloatArray
    effects: tuple[PlantedEffect, ...]
    in_parameters: tuple[str, ...]
    left_out: tuple[str, ...]
    friction_leads: dict[str, float]
    errors: tuple[ParameterError, ...]
    remainder: Remainder | None
    notes: tuple[str, ...]

    @cached_property
    def values(self) -> dict[str, float]:
        """Standard parameters by name."""
        return {parameter.name: parameter.value for parameter in self.parameters}

    def value(self, kind: str, joint: int, otherwise: float) -> float:
        """One standard parameter; `otherwise` where the model does not have it."""
        return self.values.get(f"{kind}{joint + 1}", otherwise)


def read_answer(
    path: Path,
    configuration: Configuration,
    urdf: str,
    source: str,
    *,
    refit: bool = False,
    without: Collection[str] = (),
    remainder: bool = False,
) -> Answer:
    """Read a result.json or gap.json and make sure that it is of this robot.

    Raises
    ------
    UsageError
        It is neither, or of another robot or URDF, has no physically consistent parameters, or no
        cause that is to be left out.
    """
    text = read_text(path, "the result", megabytes=_LARGEST)
    result: GapResult | IdentificationResult
    if GAP_FORMAT in text:
        result = GapResult.from_json(text, str(path))
    else:
        result = IdentificationResult.from_json(text, str(path))
    joints = _require_same_joints(path, result, configuration)
    model = build_inverse_model(configuration, urdf, source)
    if result.kinematics and result.kinematics != kinematics_digest(model.robot):
        raise UsageError(
            f"{path}: its robot is another than {source}: joints are placed or turned differently; "
            f"run `idim-iv {result.written_by}` again with this URDF"
        )
    physical = result.physical
    if physical is None:
        raise UsageError(
            f"{path}: has no physically consistent parameters: "
            f"{result.why_no_physical or 'it was written before they were part of it'}; then "
            f"run `idim-iv {result.written_by}` again"
        )
    _require_same_nominal(path, result, physical, model, source)
    bags = tuple(bag if isinstance(bag, str) else bag.path for bag in result.bags)
    gap = result if isinstance(result, GapResult) else None
    if without and (refit or gap is None):
        raise UsageError(
            f"{path}: --without {', '.join(without)}: "
            + ("one dense refit" if refit else "an identification")
            + " has no causes that could be left out"
        )
    if remainder and (refit or gap is None):
        raise UsageError(
            f"{path}: --remainder: "
            + ("one dense refit" if refit else "an identification")
            + " names no causes, so that nothing remains beside them"
        )
    causes = [] if gap is None else list(gap.causes)
    _require_known(path, causes)
    kept, others = kept_causes(causes, without, str(path))
    effects, notes = _effects(path, kept, joints)
    errors: tuple[ParameterError, ...] = ()
    parameters, loads = physical.parameters, tuple[Load, ...]()
    spread: Remainder | None = None
    gravity = np.array(model.robot.pinocchio.gravity.linear)
    if not refit and gap is not None:
        if gap.nominal is not None:
            raise UsageError(
                f"{path}: its causes are changes of {gap.nominal.file}, which is no {source}: "
                "export with --refit, or diagnose with the URDF that an export of that file wrote"
            )
        if remainder:
            mended, spread = with_remainder(model, kept, others, physical, str(path))
            notes += _far_links(mended.parameters, model.robot.joints)
        else:
            mended = mended_model(model, kept, others, physical, str(path))
        parameters, loads, gravity = mended.parameters, mended.loads, mended.gravity
        effects, errors = (*effects, *mended.effects), gap.parameter_errors
        if not np.array_equal(gravity, model.robot.pinocchio.gravity.linear):
            listed = ", ".join(f"{each:.5g}" for each in gravity)
            notes += (
                f"{name_of('gravity')}: robot.gravity would be [{listed}] m/s²; an MJCF that is "
                "made from a URDF has it, no other file",
            )
    parametric = [entry for entry in kept if entry.kind == "parametric"]
    return Answer(
        path=path,
        bags=bags,
        diagnosed=gap is not None,
        refit=refit or gap is None,
        robot=model.robot,
        physical=physical,
        parameters=parameters,
        loads=loads,
        gravity=gravity,
        effects=effects,
        in_parameters=tuple(
            f"{cause_name(cause)}: {numbers_in_words(cause.parameters)}" for cause in parametric
        ),
        left_out=tuple(map(cause_name, others)),
        friction_leads={} if gap is None else gap.friction_leads,
        errors=errors,
        remainder=spread,
        notes=notes,
    )


def _far_links(parameters: Sequence[StandardValue], joints: Sequence[str]) -> tuple[str, ...]:
    """Links whose mass is farther from the nominal one than nominal links usually are."""
    masses = [parameter for parameter in parameters if parameter.name.rstrip("0123456789") == "M"]
    return tuple(
        f"the link of {joint} weighs {mass.value:.3g} kg, {mass.given:.3g} in the nominal model: "
        f"more than three times the usual error of {100.0 * USUAL_ERROR:.0f} %, so that an effect "
        "that was not found may be in it"
        for joint, mass in zip(joints, masses, strict=True)
        if mass.source == "recording and nominal model"
        and abs(mass.value - mass.given) > 3.0 * USUAL_ERROR * mass.given
    )


def _require_same_joints(
    path: Path, result: GapResult | IdentificationResult, configuration: Configuration
) -> Sequence[str]:
    joints = configuration.robot.joints
    if list(result.joints) != joints:
        raise UsageError(
            f"{path}: its joints are {', '.join(result.joints)}, those of "
            f"{configuration.source or 'the configuration'} {', '.join(joints)}: another robot"
        )
    return joints


def _require_same_nominal(
    path: Path,
    result: GapResult | IdentificationResult,
    physical: PhysicalParameters,
    model: InverseModel,
    source: str,
) -> None:
    """Refuse a nominal model that changed since: what no motion shows was taken from it."""
    layout = model.regressor.layout
    now = dict(zip(layout.names, layout.vector(model.robot.given), strict=True))
    for name in layout.names:
        if name.rstrip("0123456789") in INERTIAL and name not in physical.values:
            raise UsageError(
                f"{path}: physical.parameters: {name} is missing; run "
                f"`idim-iv {result.written_by}` again"
            )
    for parameter in physical.parameters:
        kind = parameter.name.rstrip("0123456789")
        bounded = kind in NON_NEGATIVE and kind not in INERTIAL  # links are judged as bodies
        bounded &= parameter.name not in physical.shared
        if not abs(parameter.value) <= LARGEST or (bounded and parameter.value < 0.0):
            raise UsageError(
                f"{path}: physical.parameters: {parameter.name} is {parameter.value:g} "
                f"{parameter.unit}, which no robot has"
            )
    sizes: dict[str, float] = {}
    for parameter in physical.parameters:
        sizes[parameter.unit] = max(sizes.get(parameter.unit, 0.0), abs(parameter.given))
    for parameter in physical.parameters:
        value = now.get(parameter.name, parameter.given)
        if abs(value - parameter.given) > _SAME * max(sizes[parameter.unit], 1e-12):
            raise UsageError(
                f"{path}: the nominal model changed since: {parameter.name} was "
                f"{parameter.given:.6g} {parameter.unit}, and is {value:.6g} in {source} and its "
                f"configuration; run `idim-iv {result.written_by}` again"
            )


def _require_known(path: Path, causes: Sequence[Cause]) -> None:
    for number, cause in enumerate(causes):
        if cause.effect not in BY_NAME:
            raise UsageError(
                f"{path}: causes.{number}: {cause_name(cause)} is unknown to this version of "
                "idim_iv_ros"
            )
        delay = cause.parameters.get("delay")
        if delay is not None and delay.value > _LONGEST_DELAY:
            raise UsageError(f"{path}: causes.{number}: a delay of {delay.value:g} s is no drive's")


def _effects(
    path: Path, causes: Sequence[Cause], joints: Sequence[str]
) -> tuple[tuple[PlantedEffect, ...], tuple[str, ...]]:
    """Structural effects to simulate, and notes."""
    structural = [cause for cause in causes if BY_NAME[cause.effect].kind == "structural"]
    effects = tuple(
        PlantedEffect(
            each.effect,
            each.joint,
            each.other_joint,
            {name: number.value for name, number in each.parameters.items()},
        )
        for each in structural
    )
    notes = tuple(
        f"{cause_name(each)} is indistinguishable from "
        f"{', '.join(other.effect for other in each.indistinguishable_from)}: it is a guess"
        for each in structural
        if each.indistinguishable_from
    )
    # Names and numbers as the simulator takes them.
    joint_effects(
        [
            SimulatedEffect(
                effect.effect,
                effect.joint,
                effect.parameters,
                effect.other_joint,
                f"{path}: causes",
            )
            for effect in effects
        ],
        joints,
    )
    return effects, notes
