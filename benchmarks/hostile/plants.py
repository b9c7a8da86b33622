"""Two plants for one true robot: the benchmark's own, and MuJoCo's mj_step."""

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from benchmarks.hostile.loop import Chain, Recorded, stepped_by_mujoco, stepped_in_time
from benchmarks.hostile.nuisances import Nuisances
from benchmarks.withheld_effects.control import Course
from benchmarks.withheld_effects.drive import packed
from benchmarks.withheld_effects.robot import rigid_body_model, set_inertials
from benchmarks.withheld_effects.world import SETTLE, Runaway, World

FloatArray = NDArray[np.float64]
STIFF_STEP, SOFT_STEP, SECOND_STEP = 2e-4, 1e-4, 2.5e-4  # s, at most; soft: with a shaft


@dataclass(frozen=True)
class Run:
    """One recording at the control period, the settling before it left out.

    `recorded` has the noise of the encoders; `course` is what was asked for.
    """

    recorded: Recorded
    position_reference: FloatArray
    velocity_reference: FloatArray


def run(
    world: World,
    plant: str,
    chain: Chain,
    motion: tuple[FloatArray, FloatArray],
    seed: int,
    heat: FloatArray,
) -> Run:
    """Simulate one recording on a reference, (n_periods, n_joints) rad and rad/s.

    `heat` (n_joints,) is where the warm-up stands; it is carried on in place.

    Raises
    ------
    Runaway
        A joint exceeded any plausible speed.
    """
    period = world.controller.period
    settle = round(SETTLE / period)
    course = _course(world, motion, settle, np.random.default_rng(seed))
    if plant == "mujoco":
        recorded, done = _by_mujoco(world, chain, course, heat)
    else:
        recorded, done = _in_time(world, chain, course, heat)
    if done < len(course.position):
        raise Runaway(f"after {done * period - SETTLE:.2f} s")
    return Run(
        Recorded(*(signal[settle:] for signal in recorded)),
        course.position[settle:],
        course.velocity[settle:],
    )


def _course(
    world: World, motion: tuple[FloatArray, FloatArray], settle: int, rng: np.random.Generator
) -> Course:
    """Settle at the first reference in peace, then move."""
    position = np.concatenate([np.tile(motion[0][0], (settle, 1)), motion[0]])
    velocity = np.concatenate([np.zeros((settle, position.shape[1])), motion[1]])
    noise = rng.normal(size=(2, *position.shape))
    acting = np.random.default_rng(rng.integers(2**63))
    external = np.zeros_like(position)
    if world.disturbance is not None:
        external[settle:] = world.disturbance(acting, motion[0])
    return Course(
        position=position,
        velocity=velocity,
        feedforward=(
            world.feedforward(acting, position) if world.feedforward else np.zeros_like(position)
        ),
        external=external,
        position_noise=world.sensors.position * noise[0],
        velocity_noise=world.sensors.velocity * noise[1],
    )


def chain_of(nuisances: Nuisances, joints: int) -> Chain:
    """Signal chain of a cell."""
    late = nuisances.lateness
    return Chain(
        factor=nuisances.period / (nuisances.period + late) if late > 0.0 else 0.0,
        computing=nuisances.computing,
        sampled=nuisances.slot * np.arange(joints),
    )


def _in_time(world: World, chain: Chain, course: Course, heat: FloatArray) -> tuple[Recorded, int]:
    model = rigid_body_model(world.given, world.inertials, world.gravity)
    data = mujoco.MjData(model)
    step = SOFT_STEP if (world.drive.stiffness > 0.0).any() else STIFF_STEP
    return stepped_in_time(
        (model._address, data._address),
        (data.qpos, data.qvel, data.qacc),
        packed(world.drive),
        world.controller,
        chain,
        course,
        world.sensors.resolution,
        heat,
        int(np.ceil(world.controller.period / step - 1e-9)),
    )


def _by_mujoco(
    world: World, chain: Chain, course: Course, heat: FloatArray
) -> tuple[Recorded, int]:
    given, period = world.given, world.controller.period
    substeps = int(np.ceil(period / SECOND_STEP - 1e-9))
    model = _actuated(world)
    model.opt.timestep = period / substeps
    data = mujoco.MjData(model)
    data.qpos[:] = course.position[0]
    assert model.nu == len(given.joints)
    return stepped_by_mujoco(
        (model._address, data._address),
        (data.qpos, data.qvel),
        (data.ctrl, data.qfrc_applied),
        (model.dof_damping, model.dof_frictionloss),
        data.qfrc_bias,
        packed(world.drive),
        world.controller,
        chain,
        course,
        world.sensors.resolution,
        heat,
        substeps,
    )


def _actuated(world: World) -> mujoco.MjModel:
    """MuJoCo's model of the robot: a motor at each joint, armature, no limits and no contacts."""
    specification = mujoco.MjSpec.from_file(str(world.given.urdf))
    for joint in world.given.joints:
        specification.add_actuator(
            name=joint, target=joint, trntype=mujoco.mjtTrn.mjTRN_JOINT
        ).set_to_motor()
    model = specification.compile()
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    model.opt.gravity[:] = world.gravity
    model.jnt_limited[:] = 0
    set_inertials(model, world.given, world.inertials)
    model.dof_armature[:] = world.drive.inertia
    model.dof_frictionloss[:] = world.drive.dry_forward
    mujoco.mj_setConst(model, mujoco.MjData(model))
    return model
