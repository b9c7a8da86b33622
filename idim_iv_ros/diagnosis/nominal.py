"""An identified model in the place of the URDF's values: `diagnose --nominal FILE`."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from idim_iv_ros.configuration import Configuration
from idim_iv_ros.diagnosis.refit.baseline import Baseline
from idim_iv_ros.diagnosis.result import EffectParameter, GapResult, NominalModel
from idim_iv_ros.errors import UsageError
from idim_iv_ros.files import ANY_GAP, FilePath, read_text
from idim_iv_ros.identification.result import IdentificationResult
from idim_iv_ros.model import InverseModel, kinematics_digest
from idim_iv_ros.types import FloatArray

_LARGEST_FILE = 50.0  # MB


def read_nominal_model(path: FilePath, configuration: Configuration) -> NominalModel:
    """Read the base parameters of a result.json or gap.json.

    Of a gap.json they are those of its extended model. Its effects are no part of the nominal
    model: they are listed, and what they explain is found again.

    Raises
    ------
    UsageError
        Not such a file, or of other joints than those of the configuration.
    """
    text = read_text(Path(path), "the nominal model", megabytes=_LARGEST_FILE)
    name = str(path)
    kind = GapResult if ANY_GAP in text else IdentificationResult
    document: GapResult | IdentificationResult = kind.from_json(text, name)
    left_out: tuple[str, ...] = ()
    if isinstance(document, GapResult):
        left_out = tuple(
            f"{cause.effect.replace('_', ' ')} at {cause.joint or 'all joints'}"
            for cause in document.causes
            if cause.kind == "structural"
        )
        parameters = dict(document.extended_parameters)
    else:
        parameters = {
            parameter.name: EffectParameter(parameter.value, parameter.std, parameter.unit)
            for parameter in document.parameters
        }
    wanted = tuple(configuration.robot.joints)
    if tuple(document.joints) != wanted:
        raise UsageError(
            f"--nominal {name}: it is of the joints {', '.join(document.joints)}, and the "
            f"configuration of {', '.join(wanted)}; give a result of this robot"
        )
    _check_settings(name, document.configuration, configuration)
    return NominalModel(name, document.robot, left_out, parameters, document.kinematics)


def _check_settings(name: str, settings: dict[str, Any], configuration: Configuration) -> None:
    """Refuse a model that was identified under another gravity, effort or transmission."""
    current = configuration.model_dump(mode="json", exclude_none=True)
    for section, keys in (
        ("robot", ("gravity", "motor_to_joint", "motor_to_joint_torque", "couplings")),
        ("signals", ("effort_unit",)),
    ):
        for key in keys:
            theirs, ours = (document.get(section, {}).get(key) for document in (settings, current))
            if theirs != ours:
                raise UsageError(
                    f"--nominal {name}: it was identified with {section}.{key} {theirs}, and the "
                    f"configuration says {ours}; identify again with this configuration"
                )


def with_nominal(data: Baseline, nominal: NominalModel) -> Baseline:
    """Return the refit beside another nominal model.

    Raises
    ------
    UsageError
        The file's base parameters are not those of this robot.
    """
    prepared = data.prepared
    if nominal.kinematics not in ("", kinematics_digest(prepared.model.robot)):
        raise UsageError(
            f"--nominal {nominal.file}: the geometry is another than that of this URDF; give a "
            "result of this robot"
        )
    values = _values(nominal, prepared.model)
    model = _with_given(prepared.model, values)
    configuration = prepared.configuration
    armature = [float(inertia) for inertia in model.robot.given.drive_inertia]
    simulator = configuration.simulator.model_copy(update={"armature": armature})
    configuration = configuration.model_copy(update={"simulator": simulator})
    changed = replace(prepared, model=model, configuration=configuration)
    if changed.why_no_given:
        raise UsageError(f"--nominal {nominal.file}: {changed.why_no_given}")
    said = f"the nominal model is that of {nominal.file}, not the URDF's and the configuration's"
    if nominal.left_out:
        said += (
            f"; of its effects ({', '.join(nominal.left_out)}) nothing is in the nominal model: "
            "they are found again where the recordings show them"
        )
    return replace(data, prepared=replace(changed, reasons=(*prepared.reasons, said)))


def _values(nominal: NominalModel, model: InverseModel) -> FloatArray:
    """Base parameters (b,) in the order of the model; an offset that the file lacks is zero."""
    base, values = model.base, []
    unknown = [name for name in nominal.parameters if name not in base.names]
    missing = [
        name for name in base.names if name not in nominal.parameters and not name.startswith("off")
    ]
    said = [f"it lacks {', '.join(missing)}"] if missing else []
    said += [f"this robot has no {', '.join(unknown)}"] if unknown else []
    if said:
        raise UsageError(
            f"--nominal {nominal.file}: other base parameters than those of the configuration: "
            f"{'; '.join(said)}; give a result of this robot, identified with the same "
            "identification.friction, drive_inertia and exclude"
        )
    for name, unit in zip(base.names, base.units, strict=True):
        number = nominal.parameters.get(name)
        if number is not None and number.unit != unit:
            raise UsageError(
                f"--nominal {nominal.file}: {name} is in {number.unit}, and here in {unit}; give a "
                "result of this robot"
            )
        values.append(0.0 if number is None else number.value)
    if not np.all(np.isfinite(values)):
        raise UsageError(f"--nominal {nominal.file}: a base parameter is no finite number")
    return np.array(values)


def _with_given(model: InverseModel, values: FloatArray) -> InverseModel:
    """Standard parameters with these base parameters, as near the URDF's as can be.

    Base parameters fix only combinations of masses, moments and inertias. The others stay as the
    URDF has them: loads that the recordings cannot tell (a tilted base, a payload) need them.
    """
    layout, base = model.regressor.layout, model.base
    given = layout.vector(model.robot.given)
    sizes = np.abs(given)
    for kind in {parameter.kind for parameter in layout.parameters}:
        of_kind = np.array([parameter.kind == kind for parameter in layout.parameters])
        present = sizes[of_kind & (sizes > 0.0)]
        sizes[of_kind] = np.maximum(
            sizes[of_kind], float(np.median(present)) if len(present) else 1.0
        )
    missing = values - base.from_standard(given)
    change = sizes * np.linalg.lstsq(base.grouping * sizes, missing, rcond=None)[0]
    changed = layout.dynamic_parameters(given + change)
    kinds = {parameter.kind for parameter in layout.parameters}
    if "Ia" not in kinds:
        changed = replace(changed, drive_inertia=model.robot.given.drive_inertia)
    return replace(model, robot=replace(model.robot, given=changed, doubts=()))
