"""Random robots for comparing dynamics: serial, branched, prismatic, odd axes."""

import numpy as np
import pinocchio as pin

from idim_iv_ros.model.parameters import DynamicParameters
from idim_iv_ros.model.robot import JointLimits, RobotModel


def random_robot(seed: int, parents: list[int], prismatic: list[bool]) -> RobotModel:
    """Tree with random placements, axes and inertias; joints stand in reversed order."""
    rng = np.random.default_rng(seed)
    model = pin.Model()
    n = len(parents)
    for joint, (parent, slides) in enumerate(zip(parents, prismatic, strict=True), start=1):
        axis = rng.normal(size=3)
        axis /= np.linalg.norm(axis)
        if joint % 3 == 1:
            axis = np.eye(3)[joint % 2]
        kind = pin.JointModelPrismaticUnaligned if slides else pin.JointModelRevoluteUnaligned
        placement = pin.SE3(pin.exp3(rng.normal(size=3)), rng.normal(size=3) * 0.4)
        added = model.addJoint(parent, kind(axis), placement, f"joint_{joint}")
        spread = rng.normal(size=(3, 3)) * 0.1
        inertia = pin.Inertia(
            rng.uniform(1.0, 5.0), rng.normal(size=3) * 0.1, spread @ spread.T + 0.01 * np.eye(3)
        )
        model.appendBodyToJoint(added, inertia, pin.SE3.Identity())
    model.gravity.linear = rng.normal(size=3) * 9.0
    order = np.arange(n)[::-1].copy()
    inertial = np.zeros((n, 10))
    for tree, joint in enumerate(order.tolist()):
        inertial[joint] = model.inertias[int(tree) + 1].toDynamicParameters()
    types = tuple("prismatic" if prismatic[tree] else "revolute" for tree in np.argsort(order))
    free = np.full(n, np.inf)
    return RobotModel(
        name="random",
        joints=tuple(model.names[int(tree) + 1] for tree in np.argsort(order)),
        joint_types=types,
        pinocchio=model,
        order=order,
        limits=JointLimits(-free, free, free, free),
        given=frictionless(inertial),
    )


def frictionless(inertial: np.ndarray) -> DynamicParameters:
    """Rigid bodies alone."""
    n = len(inertial)
    return DynamicParameters(
        inertial=inertial,
        drive_inertia=np.zeros(n),
        viscous=np.zeros(n),
        coulomb=np.zeros(n),
        offset=np.zeros(n),
        coupling_joints=np.zeros((0, 2), dtype=np.int64),
        coupling_inertia=np.zeros(0),
        coupling_viscous=np.zeros(0),
        coupling_coulomb=np.zeros(0),
    )


TREES = {
    "serial": ([0, 1, 2, 3, 4, 5], [False] * 6),
    "seven joints": ([0, 1, 2, 3, 4, 5, 6], [False] * 7),
    "prismatic": ([0, 1, 2, 3], [True, False, True, False]),
    "branched": ([0, 1, 2, 1, 4, 4], [False, False, True, False, False, True]),
    "two at the base": ([0, 1, 0, 3], [False, True, False, False]),
    "one joint": ([0], [True]),
}
