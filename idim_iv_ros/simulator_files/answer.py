"""What a result says of a robot, and whether it says it of this one."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from idim_iv_ros.configuration import Configuration
from idim_iv_ros.diagnosis.result import Cause, GapResult
from idim_iv_ros.effects.registry import BY_NAME
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
from idim_iv_ros.physical import PhysicalParameters, nearest_physical
from idim_iv_ros.physical.nearest import TO_INSTALL
from idim_iv_ros.simulation import SimulatedEffect
from idim_iv_ros.simulation.effects import joint_effects
from idim_iv_ros.simulators.effects_file import PlantedEffect

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
    robot : RobotModel
    physical : PhysicalParameters
    effects : tuple of PlantedEffect
        Structural causes; parametric ones are in `physical`.
    in_parameters : tuple of str
        Causes that are in `physical`, in words.
    notes : tuple of str
        What a reader of the files must know.
    """

    path: Path
    bags: tuple[str, ...]
    diagnosed: bool
    robot: RobotModel
    physical: PhysicalParameters
    effects: tuple[PlantedEffect, ...]
    in_parameters: tuple[str, ...]
    notes: tuple[str, ...]

    def value(self, kind: str, joint: int, otherwise: float) -> float:
        """One standard parameter; `otherwise` where the model does not have it."""
        return self.physical.values.get(f"{kind}{joint + 1}", otherwise)


def read_answer(path: Path, configuration: Configuration, urdf: str, source: str) -> Answer:
    """Read a result.json or gap.json and make sure that it is of this robot.

    Raises
    ------
    UsageError
        It is neither, or of another robot or URDF, or has no physically consistent parameters.
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
        physical = _consistent(path, result, model)
    else:
        _require_same_nominal(path, result, physical, model, source)
    causes = result.causes if isinstance(result, GapResult) else ()
    effects, inside, notes = _effects(path, causes, joints)
    diagnosed = isinstance(result, GapResult)
    bags = tuple(bag if isinstance(bag, str) else bag.path for bag in result.bags)
    return Answer(path, bags, diagnosed, model.robot, physical, effects, inside, notes)


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


def _consistent(
    path: Path, result: GapResult | IdentificationResult, model: InverseModel
) -> PhysicalParameters:
    """Physical parameters of an older result.json, which has none."""
    again = f"run `idim-iv {result.written_by}` again"
    if result.why_no_physical:
        raise UsageError(
            f"{path}: has no physically consistent parameters: {result.why_no_physical}; then "
            f"{again}"
        )
    if isinstance(result, GapResult):
        raise UsageError(
            f"{path}: was written before physically consistent parameters were part of it; {again}"
        )
    names = tuple(each.name for each in result.parameters)
    if names != model.base.names:
        raise UsageError(
            f"{path}: its base parameters are not those of this robot and configuration; {again}"
        )
    values = np.array([each.value for each in result.parameters])
    try:
        return nearest_physical(model.robot, model.base, values, result.covariance)
    except ImportError as error:
        raise UsageError(TO_INSTALL) from error


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
    for each in physical.parameters:
        kind = each.name.rstrip("0123456789")
        bounded = kind in NON_NEGATIVE and kind not in INERTIAL  # links are judged as bodies
        bounded &= each.name not in physical.shared
        if not abs(each.value) <= LARGEST or (bounded and each.value < 0.0):
            raise UsageError(
                f"{path}: physical.parameters: {each.name} is {each.value:g} {each.unit}, which no "
                "robot has"
            )
    sizes: dict[str, float] = {}
    for each in physical.parameters:
        sizes[each.unit] = max(sizes.get(each.unit, 0.0), abs(each.given))
    for each in physical.parameters:
        value = now.get(each.name, each.given)
        if abs(value - each.given) > _SAME * max(sizes[each.unit], 1e-12):
            raise UsageError(
                f"{path}: the nominal model changed since: {each.name} was {each.given:.6g} "
                f"{each.unit}, and is {value:.6g} in {source} and its configuration; run "
                f"`idim-iv {result.written_by}` again"
            )


def _effects(
    path: Path, causes: Sequence[Cause], joints: Sequence[str]
) -> tuple[tuple[PlantedEffect, ...], tuple[str, ...], tuple[str, ...]]:
    """Effects to simulate, causes that are in the parameters, and notes."""
    effects, inside, notes = [], [], []
    for number, cause in enumerate(causes):
        known = BY_NAME.get(cause.effect)
        where = f" at {cause.joint}" if cause.joint else ""
        if known is None:
            raise UsageError(
                f"{path}: causes.{number}: {cause.effect}{where} is unknown to this version of "
                "idim_iv_ros"
            )
        if known.kind == "parametric":
            inside.append(f"{cause.effect}{where}")
            continue
        values = {name: each.value for name, each in cause.parameters.items()}
        if values.get("delay", 0.0) > _LONGEST_DELAY:
            raise UsageError(
                f"{path}: causes.{number}: a delay of {values['delay']:g} s is no drive's"
            )
        effects.append(PlantedEffect(cause.effect, cause.joint, cause.other_joint, values))
        if cause.indistinguishable_from:
            others = ", ".join(each.effect for each in cause.indistinguishable_from)
            notes.append(f"{cause.effect}{where} is indistinguishable from {others}: it is a guess")
    # Names and numbers as the simulator takes them.
    joint_effects(
        [
            SimulatedEffect(
                each.effect, each.joint, each.parameters, each.other_joint, f"{path}: causes"
            )
            for each in effects
        ],
        joints,
    )
    return tuple(effects), tuple(inside), tuple(notes)
