"""A robot with effects as the plant, arrays and control loop that compiled code works on."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from idim_iv_ros.model.parameters import DynamicParameters
from idim_iv_ros.model.robot import RobotModel
from idim_iv_ros.simulation import effect_kernel
from idim_iv_ros.simulation.effect_kernel import LEAST_LEVEL, Effects
from idim_iv_ros.simulation.effects import JointEffect
from idim_iv_ros.simulation.plant import Plant, plant
from idim_iv_ros.simulation.shaft import Shaft, fastest_shaft, shafts_of, split_drives
from idim_iv_ros.types import FloatArray, IntArray

# A step is at most this over the pulsation of the fastest shaft, rad.
SHAFT_ANGLE = 0.4


class AffectedRobot(NamedTuple):
    """Plant of N coordinates with its effects, and the longest step that resolves its shafts, s."""

    plant: Plant
    effects: Effects
    shafts: tuple[Shaft, ...]
    longest_step: float


def affected_robot(
    robot: RobotModel,
    parameters: DynamicParameters,
    effects: Sequence[JointEffect],
    *,
    start_time: float,
    position: FloatArray,
) -> AffectedRobot:
    """Shape a robot, its parameters and its effects for simulation.

    Friction of a joint with friction effects may be negative in `parameters`: only the sum with
    the effects is kept from driving. `position` (n_joints,) is where backlash is given its
    default stiffness.

    Raises
    ------
    UsageError
        A shaft where the drive inertia is not known (see `shaft.split_drives`).
    """
    shafts = shafts_of(effects)
    parameters = split_drives(robot, parameters, [shaft.joint for shaft in shafts])
    shafts, pulsation = fastest_shaft(robot, parameters, shafts, position)
    place = np.argsort(robot.order)
    base = plant(robot, parameters)
    n, extra = len(robot.joints), len(shafts)
    kind, joint, value = _terms(effects, place, parameters, first_coupling=len(base.level) + extra)
    dry, dissipative = np.zeros(n, dtype=bool), np.zeros(n, dtype=bool)
    level, damping = base.level.copy(), base.damping.copy()
    frictional = [one for one in effects if one.effect in _FRICTION]
    for one in frictional:
        i = place[one.joint]
        dissipative[i] = True
        level[i] = parameters.coulomb[one.joint]
        damping[i, i] = parameters.viscous[one.joint]
        dry[i] |= _is_dry(one)
    model = _grown(base, level.copy(), damping, extra)
    for i, level_of_bristles in _bristle_levels(kind, joint, value):
        level[i] -= level_of_bristles
    # Where bristles are all of the friction nothing sticks: they hold by themselves.
    dry |= level[:n] > 1e-9 * base.level[:n]
    level[:n] = np.where(dry, level[:n], 0.0)
    grown = _coupled(_grown(base, level, damping, extra), effects, place)
    current = grown.level.copy()
    current[:n] = np.where(dry, np.maximum(current[:n], LEAST_LEVEL), 0.0)
    dry_contact = np.concatenate([dry, grown.level[n:] > 0.0])
    link = np.arange(n)
    for k, shaft in enumerate(shafts):
        link[place[shaft.joint]] = n + k
    gain, knee, slope, eccentricity = _measurement_and_drive(effects, place, n)
    arrays = Effects(
        kind=kind,
        joint=joint,
        value=value,
        bristle=np.zeros(len(kind)),
        sliding=np.zeros(len(kind)),
        level=grown.level,
        damping=grown.damping,
        model_level=np.pad(model.level, (0, len(grown.level) - len(model.level))),
        model_damping=model.damping,
        dry=dry_contact,
        dissipative=dissipative,
        start_time=float(start_time),
        gain=gain,
        knee=knee,
        slope=slope,
        eccentricity=eccentricity,
        link=link,
        shaft_joint=np.array([place[shaft.joint] for shaft in shafts], dtype=np.int64),
        shaft_gap=np.array([shaft.gap for shaft in shafts], dtype=float),
        shaft_stiffness=np.array([shaft.stiffness for shaft in shafts], dtype=float),
        shaft_damping=np.array([shaft.damping for shaft in shafts], dtype=float),
        force=np.zeros(n + extra),
        stiffness=np.zeros((n + extra, n + extra)),
        link_q=np.zeros(n),
        link_speed=np.zeros(n),
        rest=np.zeros(n),
        load=np.zeros(n),
        inertial=np.zeros(n),
        rigid_mass=np.zeros((n, n)),
        measured=np.zeros((2, n)),
    )
    changing = grown._replace(level=current, damping=grown.damping.copy())
    longest = SHAFT_ANGLE / pulsation if pulsation > 0.0 else np.inf
    return AffectedRobot(changing, arrays, shafts, float(longest))


_FRICTION = (
    "stribeck",
    "nonlinear_viscous",
    "asymmetric_friction",
    "load_dependent_friction",
    "position_dependent_friction",
    "friction_drift",
    "presliding",
)


def _is_dry(one: JointEffect) -> bool:
    if one.effect == "nonlinear_viscous":
        return one.value["power"] < 1.0
    return one.effect not in ("asymmetric_friction", "presliding")


def _terms(
    effects: Sequence[JointEffect],
    place: IntArray,
    parameters: DynamicParameters,
    *,
    first_coupling: int,
) -> tuple[IntArray, IntArray, FloatArray]:
    """Kind, joint (tree order) and values of each term of `effect_kernel.effect_torques`.

    `first_coupling`: contact of the first `joint_coupling`; the others follow.
    """
    rows: list[tuple[int, int, list[float]]] = []
    couplings = 0
    for one in effects:
        i, v = int(place[one.joint]), one.value
        plain = {
            "stribeck": (effect_kernel.STRIBECK, ("excess", "speed", "exponent")),
            "nonlinear_viscous": (effect_kernel.POWER, ("coefficient", "power")),
            "asymmetric_friction": (effect_kernel.ASYMMETRIC, ("offset", "viscous")),
            "load_dependent_friction": (
                effect_kernel.LOAD,
                ("driving", "driven", "exponent", "scale", "motor_torque"),
            ),
            "position_dependent_friction": (
                effect_kernel.BUMP_FRICTION,
                ("centre", "width", "height"),
            ),
            "friction_drift": (effect_kernel.DRIFT, ("time_constant", "coulomb", "viscous")),
            "spring": (
                effect_kernel.SPRING,
                ("constant", "linear", "quadratic", "cubic", "lowest", "highest"),
            ),
        }
        if one.effect in plain:
            kind, keys = plain[one.effect]
            rows.append((kind, i, [v[key] for key in keys]))
        if one.effect == "spring" and v["bent"] != 0.0:
            keys = ("bent", "centre", "width", "hardening", "lowest", "highest")
            rows.append((effect_kernel.BENT_SPRING, i, [v[key] for key in keys]))
        if one.effect == "joint_coupling":
            values = [v[key] for key in ("coulomb", "viscous", "power")]
            rows.append((effect_kernel.COUPLING, first_coupling + couplings, values))
            couplings += 1
        if one.effect == "presliding":
            total = sum(group["level_k"] for group in one.numbered.values())
            # What slides cannot exceed the Coulomb friction that it is a part of.
            part = min(1.0, max(parameters.coulomb[one.joint], 0.0) / total) if total else 0.0
            for group in one.numbered.values():
                rows.append((effect_kernel.BRISTLE, i, [group["span_k"], part * group["level_k"]]))
        waves = {
            "position_dependent_friction": effect_kernel.WAVE_FRICTION,
            "position_ripple": effect_kernel.WAVE,
        }
        if one.effect in waves:
            for group in one.numbered.values():
                values = [group[key] for key in ("wave_number_k", "sine_k", "cosine_k")]
                rows.append((waves[one.effect], i, values))
    value = np.zeros((len(rows), 6))
    for row, (_, _, values) in zip(value, rows, strict=True):
        row[: len(values)] = values
    return (
        np.array([kind for kind, _, _ in rows], dtype=np.int64),
        np.array([joint for _, joint, _ in rows], dtype=np.int64),
        value,
    )


def _bristle_levels(kind: IntArray, joint: IntArray, value: FloatArray) -> list[tuple[int, float]]:
    bristles = np.flatnonzero(kind == effect_kernel.BRISTLE)
    return [(int(joint[t]), float(value[t, 1])) for t in bristles]


def _grown(base: Plant, level: FloatArray, damping: FloatArray, extra: int) -> Plant:
    """Room for the links behind shafts: a contact without friction for each coordinate."""
    n = len(base.offset)

    def square(matrix: FloatArray) -> FloatArray:
        return np.pad(matrix, ((0, extra), (0, extra)))

    def with_links(values: FloatArray, links: FloatArray) -> FloatArray:
        return np.concatenate([values[:n], links, values[n:]])

    return base._replace(
        drive_inertia=square(base.drive_inertia),
        damping=square(damping),
        offset=np.pad(base.offset, (0, extra)),
        level=with_links(level, np.zeros(extra)),
        first=np.concatenate([base.first[:n], np.arange(n, n + extra), base.first[n:]]),
        second=np.concatenate([base.second[:n], np.full(extra, -1), base.second[n:]]),
        direction=with_links(base.direction, np.ones(extra)),
    )


def _coupled(grown: Plant, effects: Sequence[JointEffect], place: IntArray) -> Plant:
    """Add a contact for each coupling of two joints."""
    for one in effects:
        if one.effect != "joint_coupling":
            continue
        least = LEAST_LEVEL if one.value["power"] < 1.0 else 0.0
        grown = grown._replace(
            level=np.append(grown.level, max(one.value["coulomb"], least)),
            first=np.append(grown.first, place[one.joint]),
            second=np.append(grown.second, place[one.other_joint]),
            direction=np.append(grown.direction, one.value["direction"]),
        )
    return grown


def _measurement_and_drive(
    effects: Sequence[JointEffect], place: IntArray, n: int
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    gain, knee, slope, eccentricity = np.zeros(n), np.full(n, np.inf), np.ones(n), np.zeros((n, 4))
    for one in effects:
        i = place[one.joint]
        if one.effect == "torque_gain":
            gain[i] = (1.0 + gain[i]) * one.value["factor"] - 1.0
        elif one.effect == "torque_saturation":
            knee[i], slope[i] = one.value["knee"], one.value["slope"]
        elif one.effect == "encoder_eccentricity":
            keys = ("sine", "cosine", "sine_2", "cosine_2")
            eccentricity[i] += [one.value[key] for key in keys]
    return gain, knee, slope, eccentricity
