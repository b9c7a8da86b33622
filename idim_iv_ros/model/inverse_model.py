"""The inverse dynamic model in base parameters: what the recordings are regressed on."""

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, Protocol

import numpy as np

from idim_iv_ros.configuration import Configuration
from idim_iv_ros.errors import UsageError
from idim_iv_ros.model.base_parameters import BaseParameters, find_base_parameters
from idim_iv_ros.model.parameters import DynamicParameters, parameter_layout
from idim_iv_ros.model.regressor import StandardRegressor
from idim_iv_ros.model.robot import RobotModel, kinematics_digest, load_robot
from idim_iv_ros.types import FloatArray

_BLOCK = 256


@dataclass(frozen=True)
class InverseModel:
    """Torque of the joints as a linear function of base parameters (equation 3)."""

    robot: RobotModel
    regressor: StandardRegressor
    base: BaseParameters

    def matrix(
        self, q: FloatArray, dq: FloatArray, ddq: FloatArray, smooth: FloatArray | None = None
    ) -> FloatArray:
        """Base regressor (n_samples, n_joints, b) at states; arguments as of `regressor`."""
        return np.asarray(self.regressor(q, dq, ddq, smooth)[:, :, self.base.columns])

    def joint_matrices(self, q: FloatArray, dq: FloatArray, ddq: FloatArray) -> list[FloatArray]:
        """Rows of each joint: (n_samples, c_j) with only the columns it depends on.

        Made in blocks that fit the processor's cache, each column in one piece, as it is filtered.
        """
        samples = len(q)
        active = [self.base.columns[columns] for columns in self.base.active]
        lines = [np.empty((len(columns), samples)) for columns in active]
        for start in range(0, samples, _BLOCK):
            block = slice(start, min(start + _BLOCK, samples))
            standard = self.regressor(q[block], dq[block], ddq[block]).transpose(1, 2, 0)
            for joint, columns in enumerate(active):
                lines[joint][:, block] = standard[joint][columns]
        return [table.T for table in lines]

    @property
    def given(self) -> FloatArray:
        """Base parameters (b,) of the URDF and the armature of the configuration."""
        return self.base.from_standard(self.regressor.layout.vector(self.robot.given))

    @property
    def given_without_friction(self) -> FloatArray:
        """`given` (b,) with friction and offsets at zero: the paper's start."""
        rigid = self.robot.given.without_friction
        return self.base.from_standard(self.regressor.layout.vector(rigid))

    @property
    def regular(self) -> FloatArray:
        """Base parameters (b,) of the regular start: drives of unit inertia, M(q) = I.

        Without drive inertia in the model, links of unit mass (prismatic) or unit inertia.
        """
        parameters = self.regressor.layout.parameters
        kinds = {"prismatic": ("M",), "revolute": ("XX", "YY", "ZZ")}
        if any(parameter.kind == "Ia" for parameter in parameters):
            kinds = dict.fromkeys(kinds, ("Ia",))
        unit = [float(one.kind in kinds[self.robot.joint_types[one.joint]]) for one in parameters]
        return self.base.from_standard(np.array(unit))

    def dynamic_parameters(self, values: FloatArray) -> DynamicParameters:
        """Parameters for dynamics that are equivalent to base parameters (b,)."""
        return self.regressor.layout.dynamic_parameters(self.base.to_standard(values))


def configured_robot(configuration: Configuration, urdf: str, source: str) -> RobotModel:
    """Build the robot of a configuration from URDF text; `source` is its name in messages.

    Raises UsageError: a singular transmission; see `load_robot` for the rest.
    """
    for key in ("motor_to_joint", "motor_to_joint_torque"):
        matrix = getattr(configuration.robot, key)
        if matrix is not None and np.linalg.matrix_rank(np.array(matrix)) < len(matrix):
            raise UsageError(f"{configuration.source or 'configuration'}: robot.{key} is singular")
    place = configuration.robot.joints.index
    pairs = [coupling.joints for coupling in configuration.robot.couplings]
    robot = load_robot(
        urdf,
        configuration.robot.joints,
        gravity=configuration.robot.gravity,
        armature=configuration.simulator.armature,
        couplings=[(place(first), place(second)) for first, second in pairs],
        name=configuration.robot.name,
        source=source,
    )
    if configuration.simulator.torque_offset is not None:
        robot.given.offset[:] = configuration.simulator.torque_offset
    return robot


def build_inverse_model(configuration: Configuration, urdf: str, source: str) -> InverseModel:
    """Build the model of a configuration from URDF text.

    Raises UsageError: see `load_robot`; or an excluded parameter that the model does not have.
    """
    robot = configured_robot(configuration, urdf, source)
    layout = parameter_layout(
        robot.joint_types,
        friction=configuration.identification.friction,
        drive_inertia=configuration.identification.drive_inertia,
        couplings=[(a, b) for a, b in robot.given.coupling_joints.tolist()],
        effort_unit=configuration.signals.effort_unit,
    )
    regressor = StandardRegressor(robot, layout)
    base = find_base_parameters(regressor)
    excluded = configuration.identification.exclude
    unknown = [name for name in excluded if name not in base.names]
    if unknown:
        raise UsageError(
            f"{configuration.source or 'configuration'}: identification.exclude: {unknown[0]} is "
            f"not a base parameter of this robot; they are {', '.join(base.names)}"
        )
    return InverseModel(robot, regressor, base.without(excluded))


class OfRobot(Protocol):
    """A result that says of which robot it is, and which command makes it again."""

    written_by: ClassVar[str]

    @property
    def joints(self) -> tuple[str, ...]: ...  # noqa: D102

    @property
    def kinematics(self) -> str: ...  # noqa: D102


def require_same_robot(
    path: Path, result: OfRobot, configuration: Configuration, robot: RobotModel, source: str
) -> None:
    """Refuse the result in a file if it is of another robot than `robot` with the URDF `source`.

    Raises UsageError: joints have other names or another order, or are placed or turned otherwise.
    """
    joints = configuration.robot.joints
    if list(result.joints) != joints:
        raise UsageError(
            f"{path}: its joints are {', '.join(result.joints)}, those of "
            f"{configuration.source or 'the configuration'} {', '.join(joints)}: another robot"
        )
    if result.kinematics and result.kinematics != kinematics_digest(robot):
        raise UsageError(
            f"{path}: its robot is another than {source}: joints are placed or turned differently; "
            f"run `idim-iv {result.written_by}` again with this URDF"
        )
