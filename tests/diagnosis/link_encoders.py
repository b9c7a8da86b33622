"""A pendulum behind a gear, simulated with SciPy alone: what both its encoders read."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

from idim_iv_ros import Configuration, load_configuration, write_bag
from idim_iv_ros.recording.writing.write import JointTopic

FloatArray = NDArray[np.float64]

MASS, LEVER, INERTIA, MOTOR = 8.0, 0.5, 0.4, 1.2  # kg, m, kg m² about the centre, kg m²
ABOUT_JOINT = INERTIA + MASS * LEVER**2
VISCOUS, COULOMB = 4.0, 6.0
RATE, SECONDS = 500.0, 20.0
# Hz, rad: of the motor's motion.
WAVES = ((0.13, 0.7), (0.31, 0.3), (0.77, 0.12), (1.9, 0.03), (3.3, 0.008))

URDF = f"""
<robot name="pendulum"><link name="base"/>
<joint name="swing" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/>
<limit lower="-3" upper="3" effort="500" velocity="10"/></joint>
<link name="arm"><inertial><origin xyz="0 0 {-LEVER}"/><mass value="{MASS}"/>
<inertia ixx="{INERTIA}" iyy="{INERTIA}" izz="{INERTIA}" ixy="0" ixz="0" iyz="0"/></inertial></link>
</robot>
"""
YAML = f"""
robot:
  urdf: pendulum.urdf
  joints: [swing]
simulator:
  armature: [{MOTOR}]
signals:
  link_states: /link_states
processing:
  position_cutoff: 30.0
  decimation_cutoff: 10.0
"""


@dataclass(frozen=True)
class Gear:
    """What lies between motor and link."""

    stiffness: float = np.inf  # N m/rad; infinite: the link follows the motor
    damping: float = 0.0  # N m s/rad
    gap: float = 0.0  # whole play, rad
    late: float = 0.0  # time by which the link's channel is read late, s
    step: float = 0.0  # of both encoders, rad; zero: no step
    noise: float = 2e-6  # standard deviation of each encoder, rad
    error: Callable[[FloatArray], FloatArray] = np.zeros_like  # of the link's encoder, rad


def motor_motion(time: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Angle, speed and acceleration of the motor, in joint angles."""
    rates = 2.0 * np.pi * np.array([frequency for frequency, _ in WAVES])
    sizes = np.array([size for _, size in WAVES])
    phases = np.outer(np.atleast_1d(time), rates) + np.arange(len(rates))
    return (
        np.sin(phases) @ sizes,
        np.cos(phases) @ (sizes * rates),
        -np.sin(phases) @ (sizes * rates**2),
    )


def motor_at(time: float) -> tuple[float, float]:
    """Angle and speed of the motor at one time: the solver asks so often that arrays are slow."""
    angle = speed = 0.0
    for number, (frequency, size) in enumerate(WAVES):
        rate = 2.0 * math.pi * frequency
        angle += size * math.sin(rate * time + number)
        speed += size * rate * math.cos(rate * time + number)
    return angle, speed


@cache
def link_motion(
    stiffness: float, damping: float, gap: float, samples: int
) -> tuple[FloatArray, FloatArray]:
    """Angle of the link and the torque through the gear at `samples` times of `RATE`.

    Encoders change neither: gears that differ in theirs alone share one motion.
    """
    time = np.arange(samples) / RATE
    if not np.isfinite(stiffness):
        angle, _, acceleration = motor_motion(time)
        return angle, ABOUT_JOINT * acceleration + MASS * 9.81 * LEVER * np.sin(angle)

    def motion(t: float, state: FloatArray) -> list[float]:
        link, link_speed = float(state[0]), float(state[1])
        motor, speed = motor_at(t)
        twist = motor - link
        bent = twist - min(max(twist, -gap / 2), gap / 2)
        torque = stiffness * bent + damping * (speed - link_speed) if bent else 0.0
        return [link_speed, (torque - MASS * 9.81 * LEVER * math.sin(link)) / ABOUT_JOINT]

    angle, speed = motor_at(0.0)
    load = MASS * 9.81 * LEVER * math.sin(angle)
    start = angle - load / stiffness - np.sign(load) * gap / 2
    solved = solve_ivp(
        motion,
        (time[0], time[-1]),
        [start, speed],
        t_eval=time,
        method="LSODA",
        max_step=5e-3,
        rtol=1e-8,
        atol=1e-10,
    )
    motor, motor_speed, _ = motor_motion(time)
    twist = motor - solved.y[0]
    bent = twist - np.clip(twist, -gap / 2, gap / 2)
    rate = motor_speed - solved.y[1]
    return solved.y[0], np.where(bent == 0.0, 0.0, stiffness * bent + damping * rate)


def pendulum_bag(folder: Path, gear: Gear, seed: int = 1) -> tuple[Path, Configuration]:
    """Record the pendulum: motor encoder, torque of the motor, encoder behind the gear."""
    random = np.random.default_rng(seed)
    time = np.arange(round(RATE * SECONDS)) / RATE
    begin = 0.5  # s, so that what is late was simulated
    motor, speed, acceleration = motor_motion(time + begin)
    fine = np.arange(round(RATE * (SECONDS + begin))) / RATE
    angle, through = link_motion(gear.stiffness, gear.damping, gear.gap, len(fine))
    torque = np.interp(time + begin, fine, through) + MOTOR * acceleration
    torque = torque + VISCOUS * speed + COULOMB * np.sign(speed)
    late = CubicSpline(fine, angle)(time + begin - gear.late)
    if not np.isfinite(gear.stiffness):
        late = motor_motion(time + begin - gear.late)[0]
    read = [
        values + random.normal(0.0, gear.noise, len(time))
        for values in (motor, late + gear.error(late))
    ]
    if gear.step > 0.0:
        read = [gear.step * np.round(values / gear.step) for values in read]
    torque = torque + random.normal(0.0, 0.3, len(time))
    bag = folder / "pendulum.mcap"
    topics = [
        JointTopic(
            "/joint_states", ["swing"], time, position=read[0][:, None], effort=torque[:, None]
        ),
        JointTopic("/link_states", ["swing"], time, position=read[1][:, None]),
    ]
    write_bag(bag, topics)
    (folder / "pendulum.urdf").write_text(URDF)
    (folder / "pendulum.yaml").write_text(YAML)
    return bag, load_configuration(folder / "pendulum.yaml")
