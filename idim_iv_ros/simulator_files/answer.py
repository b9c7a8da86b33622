"""Reading of a result to export, with checks that it belongs to the robot."""

from collections.abc import Collection, Sequence
from pathlib import Path

import numpy as np

from idim_iv_ros.configuration import Configuration
from idim_iv_ros.diagnosis.result.causes import Cause
from idim_iv_ros.diagnosis.result.document import GapResult
from idim_iv_ros.effects.registry import BY_NAME
from idim_iv_ros.errors import UsageError
from idim_iv_ros.files import ANY_GAP, read_text
from idim_iv_ros.identification.result import IdentificationResult
from idim_iv_ros.model import (
    InverseModel,
    build_inverse_model,
    read_urdf_file,
    read_urdf_text,
    require_same_robot,
)
from idim_iv_ros.model.base_parameters import NON_NEGATIVE
from idim_iv_ros.model.parameters import INERTIAL
from idim_iv_ros.model.urdf_reader import LARGEST
from idim_iv_ros.physical import PhysicalParameters, StandardValue
from idim_iv_ros.physical.remainder import USUAL_ERROR
from idim_iv_ros.simulation.effects import joint_effects
from idim_iv_ros.simulator_files.named import (
    CorrectedModel,
    cause_name,
    corrected_model,
    kept_causes,
    kind_of,
    numbers_in_words,
    with_remainder,
)
from idim_iv_ros.simulator_files.robot import ExportedRobot, Result
from idim_iv_ros.simulators.effects_file import effect_of_cause

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
        whole = "one dense refit" if refit else "an identification"
        what = f"--remainder: {whole} names no causes, so that nothing remains beside them"
        if without:
            what = f"--without {', '.join(without)}: {whole} has no causes that could be left out"
        raise UsageError(f"{path}: {what}")
    causes = [] if gap is None else list(gap.causes)
    _require_effects(path, causes)
    kept, others = kept_causes(causes, without, str(path))
    structural = [cause for cause in kept if BY_NAME[cause.effect].kind == "structural"]
    of_refit = refit or remainder
    effects = tuple(
        effect_of_cause(cause, f"{path}: causes", refit=of_refit) for cause in structural
    )
    joint_effects(effects, model.robot.joints)  # names and numbers as the simulator takes them
    notes = tuple(
        f"{cause_name(cause)} is indistinguishable from "
        f"{', '.join(other.effect for other in cause.indistinguishable_from)}: it is a guess"
        for cause in structural
        if cause.indistinguishable_from
    )
    given = model.robot.gravity
    corrected = CorrectedModel(physical.parameters, (), (), given)
    if gap is not None and not refit:
        make = with_remainder if remainder else corrected_model
        corrected = make(model, kept, others, physical, str(path))
        notes += _far_links(corrected.parameters, model.robot.joints)
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
            f"{cause_name(cause)}: {numbers_in_words(cause.parameters)}"
            for cause in kept
            if cause.kind == "parametric"
        ),
        left_out=tuple(map(cause_name, others)),
        remarks=notes,
    )


def _far_links(parameters: Sequence[StandardValue], joints: Sequence[str]) -> tuple[str, ...]:
    """Return links whose mass differs unusually much from the nominal one."""
    masses = [parameter for parameter in parameters if kind_of(parameter.name) == "M"]
    return tuple(
        f"the link of {joint} weighs {mass.value:.3g} kg, {mass.given:.3g} in the nominal model: "
        f"more than three times the usual error of {100.0 * USUAL_ERROR:.0f} %, so that an effect "
        "that was not found may be in it"
        for joint, mass in zip(joints, masses, strict=True)
        if mass.source == "recording and nominal model"
        and abs(mass.value - mass.given) > 3.0 * USUAL_ERROR * mass.given
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


def _require_effects(path: Path, causes: Sequence[Cause]) -> None:
    """Refuse effects that this version does not know, and impossible delays."""
    for number, cause in enumerate(causes):
        if cause.effect not in BY_NAME:
            raise UsageError(
                f"{path}: causes.{number}: {cause_name(cause)} is unknown to this version of "
                "idim_iv_ros"
            )
        delay = cause.parameters.get("delay")
        if delay is not None and delay.value > _LONGEST_DELAY:
            raise UsageError(f"{path}: causes.{number}: a delay of {delay.value:g} s is no drive's")
