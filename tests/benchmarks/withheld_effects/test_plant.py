from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from scipy.signal import butter, sosfiltfilt

from benchmarks.withheld_effects.drive import altered
from benchmarks.withheld_effects.world import record, with_drive
from tests.benchmarks.withheld_effects.sessions import courses, silent, world

pytestmark = pytest.mark.bench


@pytest.mark.parametrize("robot", ["arm2", "arm6"])
def test_without_effects_the_torque_is_pinocchios_inverse_dynamics(robot):
    noise = world(robot).sensors.torque
    true = silent(world(robot))
    course = courses(robot, 8.0)[0]
    recorded = record(true, course.position, course.velocity, seed=1)
    period = true.controller.period
    velocity = np.gradient(recorded.position, period, axis=0)
    acceleration = (
        np.roll(recorded.position, -1, 0)
        - 2.0 * recorded.position
        + np.roll(recorded.position, 1, 0)
    ) / period**2
    model = pin.buildModelFromUrdf(str(true.given.urdf))
    for k in range(model.nv):
        model.inertias[k + 1] = pin.Inertia(
            true.inertials.mass[k], true.inertials.centre[k], true.inertials.inertia[k]
        )
    data = model.createData()
    motion = zip(recorded.position, velocity, acceleration, strict=True)
    torque = np.array([pin.rnea(model, data, *instant) for instant in motion])
    torque += true.drive.inertia * acceleration + true.drive.viscous_forward * velocity
    torque += true.drive.dry_forward * np.sign(velocity)
    low = butter(4, 20.0, fs=1.0 / period, output="sos")
    gap = sosfiltfilt(low, recorded.clean_effort - torque, axis=0)
    for j in range(model.nv):
        slow = np.abs(velocity[:, j]) < 0.02
        moving = np.convolve(slow, np.ones(161), "same") == 0.0
        moving[:300] = moving[-300:] = False
        assert moving.sum() > 1000
        # Far below the noise that the recordings get (0.2 of its deviation passes the filter).
        assert np.sqrt(np.mean(gap[moving, j] ** 2)) < 0.04 * noise[j]


def test_a_delay_shifts_the_torque_by_itself():
    true = silent(world())
    late = with_drive(true, altered(true.drive, 0, delay=3.4e-3))
    pulse = np.zeros((400, 2))
    pulse[100:, 0] = 5.0
    moved = []
    for arm in (true, late):
        # Frictionless, so that the first torque of the pulse moves the joint.
        none = np.zeros(2)
        arm = with_drive(arm, arm.drive._replace(dry_forward=none, dry_backward=none))
        still = np.tile(arm.given.centre, (400, 1))

        def feedforward(_, position):
            return np.concatenate([np.zeros((len(position) - 400, 2)), pulse])

        law = arm.controller._replace(kp=none, kd=none)
        arm = replace(arm, controller=law, feedforward=feedforward, gravity=np.zeros(3))
        moved.append(record(arm, still, np.zeros_like(still), seed=1).link[:, 0])
    swing = moved[0] - moved[0][0]
    time = np.arange(400) * 1e-3
    shifted = np.interp(time - 3.4e-3, time, swing)
    assert np.abs(moved[1] - moved[1][0] - shifted).max() < 5e-3 * swing.max()
