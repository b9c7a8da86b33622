"""Torques of the effects that a robot has beyond rigid bodies and linear friction (compiled).

Coordinates are the n motors in tree order, then the links behind those that have a shaft (a joint
without shaft moves its link itself). Friction, offsets, springs and ripple act on the motors.
All that opposes motion becomes a dry friction level or a damping of this instant, so that the
joint sticks and breaks away as under Coulomb friction; stiff terms enter the step implicitly.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from idim_iv_ros.compilation import kernel
from idim_iv_ros.simulation.plant import Plant
from idim_iv_ros.types import FloatArray, IntArray

(
    STRIBECK,
    POWER,
    ASYMMETRIC,
    LOAD,
    WAVE_FRICTION,
    BUMP_FRICTION,
    DRIFT,
    BRISTLE,
    WAVE,
    SPRING,
    BENT_SPRING,
    COUPLING,
) = range(12)

# Dry friction of a joint whose effects leave none at this instant, N m: it can still stick.
LEAST_LEVEL = 1e-9
# Speed below which friction is not divided by it, rad/s.
_LEAST_SPEED = 1e-9


class Effects(NamedTuple):
    """Effects of one robot as arrays, n joints, N coordinates.

    Attributes
    ----------
    kind, joint : (terms,)
        Joint in tree order; of a coupling its contact.
    value : (terms, 6)
        What the kind needs, see `effect_torques`.
    bristle : (terms,)
        State: deflection of each bristle, -1 to 1.
    sliding : (terms,)
        State: direction in which a bristle slides, 0 while it bends.
    level : (n_contacts,)
        Dry friction without effects and bristles.
    damping : (N, N)
        Viscous friction without effects.
    model_level, model_damping : (n_contacts,), (N, N)
        Dry and viscous friction of the model, before bristles take part of it.
    dry : (n_contacts,)
        Joints and couplings with dry friction at any time.
    dissipative : (n,)
        Joints whose friction is kept from driving.
    start_time : float
        s since the start of the session.
    gain, knee, slope : (n,)
        From the command to the acting torque.
    eccentricity : (n, 4)
        Encoder error: sin q, cos q, sin 2q, cos 2q, rad.
    link : (n,)
        Coordinate of each link.
    shaft_joint, shaft_gap, shaft_stiffness, shaft_damping : (N - n,)
    force, stiffness, link_q, link_speed, rest, load, inertial, rigid_mass, measured
        Written by compiled code. load, inertial (n,): torque of the links, of the drives' inertia.
    """

    kind: IntArray
    joint: IntArray
    value: FloatArray
    bristle: FloatArray
    sliding: FloatArray
    level: FloatArray
    damping: FloatArray
    model_level: FloatArray
    model_damping: FloatArray
    dry: NDArray[np.bool_]
    dissipative: NDArray[np.bool_]
    start_time: float
    gain: FloatArray
    knee: FloatArray
    slope: FloatArray
    eccentricity: FloatArray
    link: IntArray
    shaft_joint: IntArray
    shaft_gap: FloatArray
    shaft_stiffness: FloatArray
    shaft_damping: FloatArray
    force: FloatArray
    stiffness: FloatArray
    link_q: FloatArray
    link_speed: FloatArray
    rest: FloatArray
    load: FloatArray
    inertial: FloatArray
    rigid_mass: FloatArray
    measured: FloatArray


@kernel
def acting_torque(effects: Effects, joint: int, command: float) -> float:
    """Torque of the motor for a command: linear up to the knee."""
    size = abs(command)
    if size > effects.knee[joint]:
        size = effects.knee[joint] + effects.slope[joint] * (size - effects.knee[joint])
    return math.copysign((1.0 + effects.gain[joint]) * size, command)


@kernel
def measure(effects: Effects, q: FloatArray, dq: FloatArray) -> None:
    """Position and velocity of the motors as the encoders show them."""
    for i in range(effects.eccentricity.shape[0]):
        a, b, c, d = effects.eccentricity[i]
        error = slope = 0.0
        if a != 0.0 or b != 0.0 or c != 0.0 or d != 0.0:
            s1, c1, s2, c2 = (
                math.sin(q[i]),
                math.cos(q[i]),
                math.sin(2.0 * q[i]),
                math.cos(2.0 * q[i]),
            )
            error = a * s1 + b * c1 + c * s2 + d * c2
            slope = a * c1 - b * s1 + 2.0 * (c * c2 - d * s2)
        effects.measured[0, i] = q[i] + error
        effects.measured[1, i] = dq[i] * (1.0 + slope)


@kernel
def slide_bristles(effects: Effects, dq: FloatArray, ddq: FloatArray, step: float) -> None:
    """Move the bristles along one step that starts at dq."""
    for t in range(effects.kind.shape[0]):
        if effects.kind[t] == BRISTLE:
            i = effects.joint[t]
            moved = step * (dq[i] + 0.5 * step * ddq[i]) / effects.value[t, 0]
            bent = min(max(effects.bristle[t] + moved, -1.0), 1.0)
            effects.bristle[t] = bent
            outward = abs(bent) == 1.0 and bent * (dq[i] + step * ddq[i]) > 0.0
            effects.sliding[t] = bent if outward else 0.0


@kernel
def bristles_change(effects: Effects, dq: FloatArray, ddq: FloatArray, step: float) -> bool:
    """Whether a bristle that was taken to bend slides in the middle of this step, or turned.

    Taken as they then are, the step is to be computed anew: bristles are stiffer than any
    prediction of where they will be.
    """
    changed = False
    for t in range(effects.kind.shape[0]):
        if effects.kind[t] == BRISTLE:
            i = effects.joint[t]
            moved = 0.5 * step * (dq[i] + 0.5 * step * ddq[i]) / effects.value[t, 0]
            if effects.sliding[t] == 0.0 and abs(effects.bristle[t] + moved) > 1.0:
                effects.sliding[t] = np.sign(effects.bristle[t] + moved)
                changed = True
            elif effects.sliding[t] * moved < 0.0:
                effects.sliding[t] = 0.0
                changed = True
    return changed


@kernel
def effect_torques(
    plant: Plant,
    effects: Effects,
    time: float,
    q: FloatArray,
    speed: FloatArray,
    dq: FloatArray,
    mode: IntArray,
    holding: FloatArray,
    step: float,
) -> None:
    """Set the plant's dry friction and damping, and force and stiffness of the effects.

    `q`, `speed` are half a step ahead, `dq` is the velocity at the start. A joint at rest is
    judged by the direction in which the last step's torque would move it (`holding`).
    """
    for c in range(effects.level.shape[0]):
        plant.level[c] = effects.level[c]
    for i in range(effects.force.shape[0]):
        effects.force[i] = 0.0
        for j in range(effects.force.shape[0]):
            plant.damping[i, j] = effects.damping[i, j]
            effects.stiffness[i, j] = 0.0
    for t in range(effects.kind.shape[0]):
        kind, i, p = effects.kind[t], effects.joint[t], effects.value[t]
        if kind == COUPLING:
            _couple(plant, effects, i, p, speed, mode)
            continue
        if effects.dry[i] and mode[i] != 0:
            sign = float(mode[i])
        elif effects.dry[i]:
            sign = np.sign(holding[i])
        else:
            sign = np.sign(speed[i])
        v = max(sign * speed[i], 0.0)
        if kind == STRIBECK:  # excess, speed, exponent
            plant.level[i] += p[0] * math.exp(-((v / p[1]) ** p[2]))
        elif kind == POWER:  # coefficient, power
            if p[1] >= 1.0:
                plant.damping[i, i] += p[0] * v ** (p[1] - 1.0)
            else:  # its slope at rest has no bound
                plant.level[i] += p[0] * v ** p[1]
        elif kind == ASYMMETRIC:  # offset, viscous
            effects.force[i] += p[0]
            plant.damping[i, i] += sign * p[1]
        elif kind == LOAD:  # driving, driven, exponent, scale, motor torque
            load = effects.load[i]
            if p[4] != 0.0:
                load += _drive_torque(plant, effects, i, sign, speed, mode, holding)
            share = p[0] if load * sign > 0.0 else p[1]
            plant.level[i] += share * p[3] * (abs(load) / p[3]) ** p[2]
        elif kind == WAVE_FRICTION:  # wave number, sine, cosine
            plant.level[i] += p[1] * math.sin(p[0] * q[i]) + p[2] * math.cos(p[0] * q[i])
        elif kind == BUMP_FRICTION:  # centre, width, height
            plant.level[i] += p[2] * math.exp(-(((q[i] - p[0]) / p[1]) ** 2))
        elif kind == DRIFT:  # time constant, coulomb, viscous
            left = math.exp(-(effects.start_time + time) / p[0])
            plant.level[i] += left * p[1]
            plant.damping[i, i] += left * p[2]
        elif kind == BRISTLE:  # span, level
            if effects.sliding[t] != 0.0:
                effects.force[i] += p[1] * effects.sliding[t]
            else:
                effects.force[i] += p[1] * (effects.bristle[t] + 0.5 * step * dq[i] / p[0])
                effects.stiffness[i, i] += p[1] / p[0]
        elif kind == WAVE:  # wave number, sine, cosine
            effects.force[i] += p[1] * math.sin(p[0] * q[i]) + p[2] * math.cos(p[0] * q[i])
        elif kind == SPRING:  # constant, linear, quadratic, cubic, lowest, highest
            x = min(max(q[i], p[4]), p[5])
            effects.force[i] += p[0] + x * (p[1] + x * (p[2] + x * p[3]))
        elif kind == BENT_SPRING:  # bent, centre, width, hardening, lowest, highest
            x = (min(max(q[i], p[4]), p[5]) - p[1]) / p[2]
            effects.force[i] += p[0] * (math.sinh(x) if p[3] != 0.0 else math.atan(x))
    for i in range(effects.link.shape[0]):
        if effects.dry[i]:
            plant.level[i] = max(plant.level[i], LEAST_LEVEL)
        if effects.dissipative[i]:
            bound = -max(plant.level[i], 0.0) / max(abs(speed[i]), _LEAST_SPEED)
            plant.damping[i, i] = max(plant.damping[i, i], bound)
    for k in range(effects.shaft_joint.shape[0]):
        _twist(plant, effects, k, q, dq)


@kernel
def _drive_torque(
    plant: Plant,
    effects: Effects,
    joint: int,
    sign: float,
    speed: FloatArray,
    mode: IntArray,
    holding: FloatArray,
) -> float:
    """What the model adds to the load of the links: drives, friction and offset, no effects.

    `sign`: direction in which the joint moves, or would.
    """
    total: float = plant.offset[joint] + effects.inertial[joint] + sign * effects.model_level[joint]
    for j in range(speed.shape[0]):
        total += effects.model_damping[joint, j] * speed[j]
    for c in range(speed.shape[0], mode.shape[0]):
        level = effects.model_level[c]
        friction = mode[c] * level if mode[c] != 0 else min(max(holding[c], -level), level)
        if plant.first[c] == joint:
            total += friction
        elif plant.second[c] == joint:
            total += plant.direction[c] * friction
    return total


@kernel
def _couple(
    plant: Plant, effects: Effects, contact: int, p: FloatArray, speed: FloatArray, mode: IntArray
) -> None:
    """Friction of a coupling (coulomb, viscous, power); where both signs meet, its sum resists."""
    a, b, direction = plant.first[contact], plant.second[contact], plant.direction[contact]
    w = speed[a] + direction * speed[b]
    size = max(mode[contact] * w, 0.0) if effects.dry[contact] else abs(w)
    if p[2] < 1.0:  # its slope at rest has no bound
        plant.level[contact] = max(p[0] + p[1] * size ** p[2], LEAST_LEVEL)
        return
    bound = -max(p[0], 0.0) / max(size, _LEAST_SPEED)
    damping = p[1] * size ** (p[2] - 1.0) + min(p[0], 0.0) / max(size, _LEAST_SPEED)
    damping = max(damping, bound)
    plant.damping[a, a] += damping
    plant.damping[b, b] += damping
    plant.damping[a, b] += direction * damping
    plant.damping[b, a] += direction * damping


@kernel
def _twist(plant: Plant, effects: Effects, k: int, q: FloatArray, dq: FloatArray) -> None:
    """Torque of one shaft on its motor and its link; flanks only push."""
    motor, link = effects.shaft_joint[k], effects.link.shape[0] + k
    twist, rate = q[motor] - q[link], dq[motor] - dq[link]
    half, stiffness, damping = (
        0.5 * effects.shaft_gap[k],
        effects.shaft_stiffness[k],
        effects.shaft_damping[k],
    )
    if half > 0.0:
        side = 1.0 if twist > 0.0 else -1.0
        twist -= side * half
        if side * twist <= 0.0 or side * (stiffness * twist + damping * rate) <= 0.0:
            return
    torque = stiffness * twist
    effects.force[motor] += torque
    effects.force[link] -= torque
    for row, column, sign in ((motor, motor, 1.0), (link, link, 1.0), (motor, link, -1.0),
                              (link, motor, -1.0)):  # fmt: skip
        effects.stiffness[row, column] += sign * stiffness
        plant.damping[row, column] += sign * damping
