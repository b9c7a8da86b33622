"""What no catalogue lists: contacts, a stop, bursts, a sensor that freezes."""

from dataclasses import replace

import mujoco
import numpy as np

from benchmarks.withheld_effects.effects.effect import Effect, on_drive
from benchmarks.withheld_effects.robot import GivenRobot, rigid_body_model
from benchmarks.withheld_effects.world import FloatArray, World


def contact_pulses(rng: np.random.Generator, given: GivenRobot, joint: int) -> Effect:
    """Bumps of 60 to 200 ms against the last link, at other times in every recording."""
    rate = rng.uniform(0.3, 0.8)
    reach = 0.15 * np.ones(3) * np.array([1.0, 0.2, 0.6])

    def apply(world: World, strength: float) -> World:
        model = rigid_body_model(given, world.inertials, world.gravity)

        def bumps(chance: np.random.Generator, position: FloatArray) -> FloatArray:
            torque = np.zeros_like(position)
            data = mujoco.MjData(model)
            jacobian = np.zeros((3, model.nv))
            period = given.controller.period
            for _ in range(max(1, chance.poisson(rate * len(position) * period))):
                length = int(chance.uniform(0.06, 0.2) / period)
                start = int(chance.integers(len(position) - length))
                force = chance.normal(size=3)
                force *= strength * 0.1 * given.effort[0] / np.linalg.norm(force)
                data.qpos[:] = position[start]
                mujoco.mj_kinematics(model, data)
                mujoco.mj_comPos(model, data)
                body = model.nbody - 1
                point = data.xpos[body] + data.xmat[body].reshape(3, 3) @ reach
                mujoco.mj_jac(model, data, jacobian, None, point, body)
                shape = np.sin(np.linspace(0.0, np.pi, length)) ** 2
                torque[start : start + length] += shape[:, None] * (jacobian.T @ force)
            return torque

        return replace(world, disturbance=bumps)

    return Effect(
        "contact_pulses",
        None,
        apply,
        0.3,
        100.0,
        {"rate": rate},
        joints=(min(joint, 1),),
        whole_session=True,
    )


def one_sided_stop(rng: np.random.Generator, given: GivenRobot, joint: int) -> Effect:
    """A bumper that the joint runs into on one side of its motion."""
    side, inside = rng.choice([-1.0, 1.0]), rng.uniform(0.1, 0.25)
    at = given.centre[joint] + side * inside * (given.upper - given.lower)[joint] * 0.4

    apply = on_drive(
        joint,
        lambda strength: {
            "stop": strength * 0.5 * given.effort[joint],
            "stop_at": at,
            "stop_side": side,
        },
    )

    return Effect("one_sided_stop", joint, apply, 0.05, 200.0, {"at": at, "side": side})


def random_bursts(rng: np.random.Generator, given: GivenRobot, joint: int) -> Effect:
    """Bursts of random torque, 0.2 to 1 s long, up to about 10 Hz, never twice the same."""
    rate = rng.uniform(0.2, 0.5)

    def apply(world: World, strength: float) -> World:
        def bursts(chance: np.random.Generator, position: FloatArray) -> FloatArray:
            torque = np.zeros_like(position)
            period = given.controller.period
            for _ in range(max(1, chance.poisson(rate * len(position) * period))):
                length = int(chance.uniform(0.2, 1.0) / period)
                start = int(chance.integers(len(position) - length))
                knots = chance.standard_t(3.0, 3 + int(20 * length * period))
                wave = np.interp(
                    np.linspace(0.0, 1.0, length), np.linspace(0.0, 1.0, len(knots)), knots
                )
                window = np.sin(np.linspace(0.0, np.pi, length))
                torque[start : start + length, joint] += window * wave
            return strength * 0.02 * given.effort[joint] * torque

        return replace(world, disturbance=bursts)

    return Effect("random_bursts", joint, apply, 0.7, 100.0, {"rate": rate}, whole_session=True)


def sensor_dropout(rng: np.random.Generator, given: GivenRobot, joint: int) -> Effect:
    """The recorded effort freezes again and again."""

    def apply(world: World, strength: float) -> World:
        duration = world.sensors.dropout.copy()
        duration[joint] = 0.03 * strength
        return replace(world, sensors=replace(world.sensors, dropout=duration))

    return Effect("sensor_dropout", joint, apply, 2.5, 20.0, whole_session=True)
