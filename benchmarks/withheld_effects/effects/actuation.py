"""Effects between the command and the torque, and in the controller."""

from dataclasses import replace

import numpy as np

from benchmarks.withheld_effects.drive import altered
from benchmarks.withheld_effects.effects.effect import Effect, on_drive
from benchmarks.withheld_effects.robot import GivenRobot
from benchmarks.withheld_effects.world import FloatArray, World, with_drive


def time_delay(rng: np.random.Generator, given: GivenRobot, joint: int) -> Effect:
    """Transport delay from the command to the torque; the catalogue linearises it."""
    apply = on_drive(joint, lambda strength: {"delay": 1e-3 * strength})

    return Effect("time_delay", joint, apply, 2.3, 16.0)


def common_delay(rng: np.random.Generator, given: GivenRobot, joint: int) -> Effect:
    """One delay of all joints, 1.2 to 3 control periods whatever the ratio that is asked for.

    Up to one period a command is only sampled and held.
    """
    seconds = rng.uniform(1.2, 3.0) * given.controller.period

    def apply(world: World, strength: float) -> World:
        delay = world.drive.delay + strength * seconds
        return with_drive(world, world.drive._replace(delay=delay))

    n = len(given.joints)
    return Effect(
        "time_delay", None, apply, 1.0, 1.0, {"seconds": seconds}, joints=(joint, *range(n))
    )


def torque_saturation(rng: np.random.Generator, given: GivenRobot, joint: int) -> Effect:
    """A knee beyond which the torque follows only in part; the catalogue's is a cubic."""
    slope = rng.uniform(0.0, 0.5)

    def apply(world: World, strength: float) -> World:
        knee = given.effort[joint] / (1.0 + strength)
        return with_drive(world, altered(world.drive, joint, knee=knee, knee_slope=slope))

    # It acts at few instants, so that every recording weighs.
    return Effect(
        "torque_saturation", joint, apply, 2.0, 60.0, {"slope": slope}, whole_session=True
    )


def controller_mismatch(rng: np.random.Generator, given: GivenRobot, joint: int) -> Effect:
    """Other gains, a filter on the command, a feedforward or an integral that nobody wrote down."""
    kind = rng.choice(["gains", "lag", "feedforward", "integral"])
    signs = rng.choice([-1.0, 1.0], 2)

    def apply(world: World, strength: float) -> World:
        law = world.controller
        if kind == "gains":
            kp, kd = law.kp.copy(), law.kd.copy()
            kp[joint] *= np.exp(0.1 * signs[0] * strength)
            kd[joint] *= np.exp(0.06 * signs[1] * strength)
            return replace(world, controller=law._replace(kp=kp, kd=kd))
        if kind == "lag":
            lag = law.lag.copy()
            lag[joint] = 1e-3 * strength
            return replace(world, controller=law._replace(lag=lag))
        if kind == "integral":
            ki = law.ki.copy()
            ki[joint] = 0.3 * strength * law.kp[joint]
            return replace(world, controller=law._replace(ki=ki))

        def feedforward(_: np.random.Generator, position: FloatArray) -> FloatArray:
            speed = np.gradient(position[:, joint], law.period)
            torque = np.zeros_like(position)
            torque[:, joint] = strength * 0.3 * given.dry[joint] * np.tanh(speed / 0.05)
            return torque

        return replace(world, feedforward=feedforward)

    return Effect(
        "controller_mismatch", joint, apply, 1.0, 12.0, {"kind": str(kind)}, measure="command"
    )
