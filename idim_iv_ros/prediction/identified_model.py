"""A result.json as a model that predicts, if it is of the configured robot."""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from pydantic import ValidationError

from idim_iv_ros.configuration import Configuration, ProcessingSection
from idim_iv_ros.errors import UsageError
from idim_iv_ros.identification.result import IdentificationResult
from idim_iv_ros.model import InverseModel, require_same_robot
from idim_iv_ros.signals import JointTransform, joint_transform
from idim_iv_ros.types import FloatArray
from idim_iv_ros.validation import first_problem

# What must be as it was when the result was made: its numbers mean something else otherwise.
_SAME = {
    "robot": ("gravity", "position_offset", "motor_to_joint", "motor_to_joint_torque", "couplings"),
    "signals": ("effort_scale", "effort_unit"),
    "identification": ("friction", "drive_inertia", "exclude"),
}


@dataclass(frozen=True)
class IdentifiedModel:
    """Model, parameters and filters of one identification."""

    path: Path  # Of the result
    result: IdentificationResult
    model: InverseModel
    transform: JointTransform  # From what the topics hold to the joints
    values: FloatArray  # (b,): Base parameters
    processing: ProcessingSection  # That the result was made with

    @property
    def joints(self) -> tuple[str, ...]:
        """In the order of all arrays."""
        return self.result.joints

    @cached_property
    def noise_floor(self) -> FloatArray:
        """RMS of the residual that the identification left, (n_joints,) N m (N)."""
        return np.array([residual.rms for residual in self.result.residuals])


def identified_model(
    path: Path, configuration: Configuration, model: InverseModel, source: str
) -> IdentifiedModel:
    """Read a result.json and make sure that it is of this robot and configuration.

    - `path`: of the result
    - `model`, `source`: of the configuration (`build_inverse_model`), and the name of its URDF in
      messages

    Raises UsageError: one line: it cannot be read, or is of another robot, URDF or configuration.
    """
    result = IdentificationResult.read(path)
    require_same_robot(path, result, configuration, model.robot, source)
    _require_same(path, result, configuration)
    names = tuple(parameter.name for parameter in result.parameters)
    if names != model.base.names:
        raise UsageError(
            f"{path}: its base parameters are not those of {source}; run `idim-iv identify` again"
        )
    values = np.array([parameter.value for parameter in result.parameters])
    if not np.isfinite(values).all():
        raise UsageError(f"{path}: a parameter has no value; run `idim-iv identify` again")
    try:
        processing = ProcessingSection.model_validate(result.configuration.get("processing") or {})
    except ValidationError as error:
        raise UsageError(f"{path}: configuration.processing: {first_problem(error)}") from error
    return IdentifiedModel(
        path=path,
        result=result,
        model=model,
        transform=joint_transform(configuration),
        values=values,
        processing=processing,
    )


def _require_same(path: Path, result: IdentificationResult, configuration: Configuration) -> None:
    now = configuration.model_dump(mode="json", exclude_none=True)
    for section, keys in _SAME.items():
        then = result.configuration.get(section)
        for key in keys:
            before = then.get(key) if isinstance(then, dict) else None
            if before != now[section].get(key):
                raise UsageError(
                    f"{path}: it was identified with another {section}.{key} than "
                    f"{configuration.source or 'the configuration'} has; run `idim-iv identify` "
                    "again"
                )
