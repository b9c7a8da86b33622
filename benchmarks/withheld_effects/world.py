"""A true robot with its sensors, and one recording of it."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import mujoco
import numpy as np
from numpy.typing import NDArray

from benchmarks.withheld_effects.control import Controller, Course
from benchmarks.withheld_effects.drive import Drive, packed, rigid_drive
from benchmarks.withheld_effects.plant import run
from benchmarks.withheld_effects.robot import (
    GivenRobot,
    Inertials,
    altered_inertials,
    given_inertials,
    rigid_body_model,
)
from benchmarks.withheld_effects.sensors import Sensors, coloured, frozen

FloatArray = NDArray[np.float64]
Disturbance = Callable[[np.random.Generator, FloatArray], FloatArray]
SETTLE = 1.0  # s at the first reference before the recording starts
STIFF_STEPS, SOFT_STEPS = 5, 10


@dataclass(frozen=True)
class World:
    """Everything that is true of one robot.

    `feedforward` and `disturbance` give torques (n_periods, n_joints) N m from random numbers and
    the reference position (n_periods, n_joints) rad: what the controller adds and what acts on
    the links. `warmth_kept` is the share of the warmth that is left when the next recording starts.
    """

    given: GivenRobot
    inertials: Inertials
    gravity: FloatArray
    drive: Drive
    controller: Controller
    sensors: Sensors
    feedforward: Disturbance | None = None
    disturbance: Disturbance | None = None
    warmth_kept: float = 0.8


@dataclass(frozen=True)
class Record:
    """One recording; time (n,) s, everything else (n, n_joints).

    `effort` is the mean of the command over the control period centred on the stamp, with noise;
    `link` is the true position of the links, rad, and `clean_effort` has no noise.
    """

    time: FloatArray
    position: FloatArray
    velocity: FloatArray
    effort: FloatArray
    position_reference: FloatArray
    velocity_reference: FloatArray
    link: FloatArray
    clean_effort: FloatArray


class Runaway(Exception):
    """The true robot does not stay in closed loop."""


def plain_world(given: GivenRobot, rng: np.random.Generator, *, altered: bool) -> World:
    """A rigid robot: the given one, or one whose parameters are 10 to 30 % off."""
    n = len(given.joints)
    inertials = given_inertials(given)
    off = np.ones((3, n))
    if altered:
        inertials = altered_inertials(inertials, rng)
        off += rng.uniform(0.1, 0.3, (3, n)) * rng.choice([-1.0, 1.0], (3, n))
    level = rng.uniform(0.7, 1.4)
    return World(
        given=given,
        inertials=inertials,
        gravity=np.array([0.0, 0.0, -9.81]),
        drive=rigid_drive(
            given.armature * off[0], given.viscous * off[1], given.dry * off[2], np.zeros(n)
        ),
        controller=given.controller,
        sensors=Sensors(
            position=np.full(n, 1.5e-5 * level),
            velocity=np.full(n, 5e-4),
            torque=0.005 * level * given.effort,
            resolution=np.full(n, 2.0 * np.pi / 2.0 ** rng.integers(18, 21)),
            colour=0.0,
            jitter=0.0,
            dropout=np.zeros(n),
        ),
    )


def record(
    world: World,
    position: FloatArray,
    velocity: FloatArray,
    seed: int,
    heat: FloatArray | None = None,
) -> Record:
    """Simulate one recording on a reference, (n_periods, n_joints) rad and rad/s.

    The same seed gives the same noise whatever the world is, so that two worlds differ by their
    physics alone. `heat` (n_joints,) is where the warm-up stands; it is carried on in place.

    Raises
    ------
    Runaway
        A joint exceeded any plausible speed.
    """
    rng = np.random.default_rng(seed)
    period = world.controller.period
    settle = round(SETTLE / period)
    position = np.concatenate([np.tile(position[0], (settle, 1)), position])
    velocity = np.concatenate([np.zeros((settle, position.shape[1])), velocity])
    noise = rng.normal(size=(3, *position.shape))
    acting = np.random.default_rng(rng.integers(2**63))
    none = np.zeros_like(position)
    course = Course(
        position=position,
        velocity=velocity,
        feedforward=world.feedforward(acting, position) if world.feedforward else none,
        external=_external(world, acting, position, settle),
        position_noise=world.sensors.position * noise[0],
        velocity_noise=world.sensors.velocity * noise[1],
    )
    model = rigid_body_model(world.given, world.inertials, world.gravity)
    data = mujoco.MjData(model)
    measured, speed, commands, link, done = run(
        (model._address, data._address),
        (data.qpos, data.qvel, data.qacc),
        packed(world.drive),
        world.controller,
        course,
        world.sensors.resolution,
        np.zeros(position.shape[1]) if heat is None else heat,
        SOFT_STEPS if (world.drive.stiffness > 0.0).any() else STIFF_STEPS,
    )
    if done < len(position):
        raise Runaway(f"after {done * period - SETTLE:.2f} s")
    clean = 0.5 * (commands + np.concatenate([commands[:1], commands[:-1]]))
    effort = clean + world.sensors.torque * coloured(noise[2], world.sensors.colour)
    effort = frozen(effort, world.sensors.dropout, period, acting)
    time = np.arange(len(position) - settle) * period
    jitter = np.clip(acting.normal(size=len(time)) * world.sensors.jitter, -0.4e-3, 0.4e-3)
    return Record(
        time=time + jitter,
        position=measured[settle:],
        velocity=speed[settle:],
        effort=effort[settle:],
        position_reference=position[settle:],
        velocity_reference=velocity[settle:],
        link=link[settle:],
        clean_effort=clean[settle:],
    )


def _external(
    world: World, chance: np.random.Generator, position: FloatArray, settle: int
) -> FloatArray:
    """Disturbance of the recorded part; the robot settles in peace."""
    torque = np.zeros_like(position)
    if world.disturbance is not None:
        torque[settle:] = world.disturbance(chance, position[settle:])
    return torque


def with_drive(world: World, drive: Drive) -> World:
    """The same robot with other drives."""
    return replace(world, drive=drive)
