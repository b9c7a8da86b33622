"""Joints whose motor and link are two masses: elastic shafts and backlash."""

from collections.abc import Iterable, Mapping
from dataclasses import replace

import numpy as np

from idim_iv_ros.effects.contribution import ShaftPart
from idim_iv_ros.errors import UsageError
from idim_iv_ros.model import DynamicParameters, RobotModel, StandardRegressor, parameter_layout
from idim_iv_ros.simulation.rigid_body import inverse_dynamics, mass_matrix
from idim_iv_ros.types import FloatArray

# Gear flanks whose stiffness is not given: natural frequency of motor against link, Hz, and
# damping ratio. At 300 Hz the flanks give less than backlash does; teeth meet without bouncing far.
FLANK_FREQUENCY, FLANK_DAMPING = 300.0, 0.3

# A shaft that swings faster is as good as rigid, and is simulated with this pulsation, rad/s.
FASTEST = 2e4


def joined_shafts(parts: Iterable[tuple[int, ShaftPart]]) -> dict[int, ShaftPart]:
    """Shafts by joint, made of their parts; with an elasticity, flanks of a gap are rigid."""
    shafts: dict[int, ShaftPart] = {}
    for joint, part in sorted(parts, key=lambda item: not item[1].flanks):
        gap = part.gap + (shafts[joint].gap if joint in shafts else 0.0)
        shafts[joint] = replace(part, gap=gap)
    return shafts


def split_drives(
    robot: RobotModel, parameters: DynamicParameters, joints: Iterable[int]
) -> DynamicParameters:
    """Parameters with the same rigid dynamics whose drives have an inertia of their own.

    Base parameters group the inertia of some drives with that of links (joint 1: ZZ1 + Ia1), and
    a motion of the rigid robot cannot tell them apart. There the drive inertia is that of the
    nominal model (`simulator.armature`), taken from the links.

    Raises UsageError: the drive inertia of one of `joints` is in neither of them, or not positive.
    """
    for joint in joints:
        inertia, given = parameters.drive_inertia[joint], robot.given.drive_inertia[joint]
        if inertia > 0.0:
            continue
        name = robot.joints[joint]
        if inertia < 0.0:
            raise UsageError(
                f"elasticity or backlash at {name} needs a positive drive inertia, "
                f"not {inertia:.3g} (Ia{joint + 1})"
            )
        taken = None if given <= 0.0 else _link_share(robot, joint)
        if taken is None:
            raise UsageError(
                f"elasticity or backlash at {name} needs its drive inertia, which neither Ia"
                f"{joint + 1} nor simulator.armature gives"
            )
        drive_inertia = parameters.drive_inertia.copy()
        drive_inertia[joint] = given
        parameters = replace(
            parameters, inertial=parameters.inertial - given * taken, drive_inertia=drive_inertia
        )
    return parameters


def _link_share(robot: RobotModel, joint: int) -> FloatArray | None:
    """Inertial parameters (n_joints, 10) that act like one unit of a drive's inertia, or None."""
    layout = parameter_layout(robot.joint_types, friction=(), drive_inertia=True)
    random = np.random.default_rng(1)
    n = len(robot.joints)
    q, dq, ddq = random.uniform(-2.0, 2.0, (3, 20 * n, n))
    matrix = StandardRegressor(robot, layout)(q, dq, ddq)
    rows = matrix.reshape(-1, matrix.shape[2])
    inertial = np.array([parameter.kind != "Ia" for parameter in layout.parameters])
    drive = rows[:, layout.names.index(f"Ia{joint + 1}")]
    share, *_ = np.linalg.lstsq(rows[:, inertial], drive, rcond=1e-10)
    if np.linalg.norm(rows[:, inertial] @ share - drive) > 1e-6 * np.linalg.norm(drive):
        return None
    vector = np.zeros(len(layout.parameters))
    vector[inertial] = share
    return layout.dynamic_parameters(vector).inertial


def completed_shaft(shaft: ShaftPart, reduced: float) -> tuple[ShaftPart, float]:
    """Give a shaft the stiffness and damping that were not given; return its pulsation, rad/s, too.

    `reduced`: inertia of motor and link against each other, kg m² (kg).
    """
    stiffness, damping = shaft.stiffness, shaft.damping
    if np.isnan(stiffness):
        stiffness = reduced * (2.0 * np.pi * FLANK_FREQUENCY) ** 2
    stiffness = min(stiffness, reduced * FASTEST**2)
    if np.isnan(damping):
        damping = 2.0 * FLANK_DAMPING * float(np.sqrt(stiffness * reduced))
    complete = replace(shaft, stiffness=stiffness, damping=damping)
    return complete, float(np.sqrt(stiffness / reduced))


def fastest_shaft(
    robot: RobotModel,
    parameters: DynamicParameters,
    shafts: Mapping[int, ShaftPart],
    position: FloatArray,
) -> tuple[dict[int, ShaftPart], float]:
    """Shafts with the stiffness and damping that were not given, and the largest pulsation, rad/s.

    Pulsations are those of motor against link at `position` (n_joints,), all other joints free.
    """
    if not shafts:
        return {}, 0.0
    behind = parameters.drive_inertia.copy()
    behind[list(shafts)] = 0.0
    mass = mass_matrix(robot, replace(parameters, drive_inertia=behind), position[None])[0]
    mobility = np.diag(np.linalg.pinv(mass))
    complete, fastest = {}, 0.0
    for joint, shaft in shafts.items():
        link = max(float(mobility[joint]), 0.0)
        reduced = 1.0 / (1.0 / float(parameters.drive_inertia[joint]) + link)
        complete[joint], pulsation = completed_shaft(shaft, reduced)
        fastest = max(fastest, pulsation)
    return complete, fastest


def link_positions(
    robot: RobotModel,
    parameters: DynamicParameters,
    shafts: Mapping[int, ShaftPart],
    position: FloatArray,
) -> FloatArray:
    """Positions (n_joints,) of the links at rest under gravity behind motors at `position`."""
    zeros = np.zeros_like(parameters.drive_inertia)
    links = replace(parameters, drive_inertia=zeros, offset=zeros)
    position = np.asarray(position, dtype=float)
    still = np.zeros((1, len(position)))
    link = position.copy()
    for _ in range(30):  # the load bends the shafts, which moves the links and so the load
        load = inverse_dynamics(robot, links, link[None], still, still)[0]
        for joint, shaft in shafts.items():
            bent = load[joint] / shaft.stiffness + 0.5 * shaft.gap * np.sign(load[joint])
            link[joint] = position[joint] - bent
    return link
