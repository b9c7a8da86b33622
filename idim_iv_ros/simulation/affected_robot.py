"""A robot with effects as the plant and arrays that compiled code works on.

An elastic shaft or backlash makes two masses of a joint, its motor and its link.
"""

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from idim_iv_ros.effects.contribution import (
    STATES,
    CouplingTerm,
    EncoderError,
    Load,
    ShaftPart,
    TorqueTerm,
)
from idim_iv_ros.effects.registry import DRIVE_LAWS, ENCODER_LAWS, TORQUE_LAWS
from idim_iv_ros.errors import UsageError
from idim_iv_ros.model import DynamicParameters, RobotModel, StandardRegressor, parameter_layout
from idim_iv_ros.simulation.effect_kernel import LEAST_LEVEL, Effects, Rows
from idim_iv_ros.simulation.effects import JointContributions
from idim_iv_ros.simulation.plant import Contacts, Plant, plant
from idim_iv_ros.simulation.rigid_body import inverse_dynamics, mass_matrix
from idim_iv_ros.types import FloatArray, IntArray

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
    return replace(shaft, stiffness=stiffness, damping=damping), float(np.sqrt(stiffness / reduced))


def link_positions(
    robot: RobotModel,
    parameters: DynamicParameters,
    shafts: Mapping[int, ShaftPart],
    position: FloatArray,
) -> FloatArray:
    """Positions (n_joints,) of the links at rest under gravity behind motors at `position`."""
    zeros = np.zeros_like(parameters.drive_inertia)
    links = replace(parameters, drive_inertia=zeros, offset=zeros)
    still, link = np.zeros((1, len(position))), position.copy()
    for _ in range(30):  # the load bends the shafts, which moves the links and so the load
        load = inverse_dynamics(robot, links, link[None], still, still)[0]
        for joint, shaft in shafts.items():
            bent = load[joint] / shaft.stiffness + 0.5 * shaft.gap * np.sign(load[joint])
            link[joint] = position[joint] - bent
    return link


SHAFT_ANGLE = 0.4  # A step is at most this over the pulsation of the fastest shaft, rad
# Dry friction that bristles leave, as a share of the model's, at which a joint still sticks.
STICKS = 1e-9
_Row = tuple[int, int, Load, tuple[float, ...]]  # law, joint or contact, load, values


def affected_robot(
    robot: RobotModel,
    parameters: DynamicParameters,
    added: JointContributions,
    *,
    start_time: float,
    position: FloatArray,
) -> tuple[Plant, Effects, dict[int, ShaftPart], float]:
    """Shape a robot, its parameters and what effects add to it for simulation.

    Friction of a joint with friction effects may be negative in `parameters`: only the sum with
    the effects is kept from driving. `position` (n_joints,) is where backlash is given its
    default stiffness. Returns the plant of N coordinates with its effects, its shafts, and the
    longest step that resolves these, s.

    Raises UsageError: a shaft where the drive inertia is not known (see `split_drives`).
    """
    shafts, longest = joined_shafts(added.of(ShaftPart)), np.inf
    parameters = split_drives(robot, parameters, shafts)
    if shafts:
        # Pulsations are those of motor against link here, all other joints free.
        behind = parameters.drive_inertia.copy()
        behind[list(shafts)] = 0.0
        links = replace(parameters, drive_inertia=behind)
        mobility = np.diag(np.linalg.pinv(mass_matrix(robot, links, position[None])[0]))
    for joint, shaft in shafts.items():
        of_motor = 1.0 / float(parameters.drive_inertia[joint])
        reduced = 1.0 / (of_motor + max(float(mobility[joint]), 0.0))
        shafts[joint], pulsation = completed_shaft(shaft, reduced)
        longest = min(longest, SHAFT_ANGLE / pulsation)
    base, place = plant(robot, parameters), np.argsort(robot.order)
    friction = parameters.coulomb, parameters.viscous
    changing, effects = affected_plant(base, friction, added, place, shafts, start_time)
    return changing, effects, shafts, longest


def affected_plant(
    base: Plant,
    friction: tuple[FloatArray, FloatArray],
    added: JointContributions,
    place: IntArray,
    shafts: Mapping[int, ShaftPart],
    start_time: float,
) -> tuple[Plant, Effects]:
    """Return the plant whose friction is that of the instant, and the effects that change it.

    `friction`: dry and viscous friction (n_joints,) of the model, possibly negative: joints with
    effects of friction have it in the place of the plant's, which is not. `place` (n_joints,): of
    the joints in the plant.
    """
    coulomb, viscous = friction
    n, couplings = len(base.offset), len(added.couplings)
    dry, dissipative = np.zeros(n, dtype=bool), np.zeros(n, dtype=bool)
    grown = _grown(base, added, place, len(shafts))
    level = grown.level.copy()
    for joint, term in added.of(TorqueTerm):
        if term.friction:
            i = place[joint]
            dissipative[i] = True
            level[i] = coulomb[joint]
            grown.damping[i, i] = viscous[joint]
            dry[i] |= term.dry
    without_couplings = np.arange(len(level)) < len(level) - couplings
    model_level = np.where(without_couplings, level, 0.0)
    for joint, term in added.of(TorqueTerm):
        level[place[joint]] -= term.replaced
    # Where bristles are all of the friction nothing sticks: they hold by themselves.
    dry |= level[:n] > STICKS * base.level[:n]
    level[:n] = np.where(dry, level[:n], 0.0)
    # The plant's own level and damping are those of the instant.
    current = level.copy()
    current[:n] = np.where(dry, np.maximum(current[:n], LEAST_LEVEL), 0.0)
    changing = grown._replace(level=current, damping=grown.damping.copy())
    link = np.arange(n)
    link[place[list(shafts)]] = n + np.arange(len(shafts))
    numbers = [(shaft.gap, shaft.stiffness, shaft.damping) for shaft in shafts.values()]
    return changing, Effects(
        rows=effect_rows(added, place, first_coupling=len(level) - couplings),
        level=np.where(without_couplings, level, 0.0),
        damping=grown.damping,
        model_level=model_level,
        dry=np.concatenate([dry, level[n:] > 0.0]),
        dissipative=dissipative,
        start_time=float(start_time),
        link=link,
        shaft_joint=place[list(shafts)],
        shaft=np.array(numbers, dtype=float).reshape(-1, 3),
        force=np.zeros(len(grown.offset)),
        stiffness=np.zeros_like(grown.damping),
        **{name: np.zeros(n) for name in ("link_q", "link_speed", "rest")},
        **{name: np.zeros(n) for name in ("load", "static", "inertial")},
        rigid_mass=np.zeros((n, n)),
        measured=np.zeros((2, n)),
    )


def effect_rows(added: JointContributions, place: IntArray, *, first_coupling: int) -> Rows:
    """Contributions with compiled laws; `first_coupling`: contact of the first coupling."""
    torques: list[_Row] = []
    contact = first_coupling
    for joint, _, part in added.items:
        if isinstance(part, TorqueTerm):
            torques.append((TORQUE_LAWS.index(part.law), int(place[joint]), part.load, part.values))
        elif isinstance(part, CouplingTerm):
            torques.append((TORQUE_LAWS.index(part.law), contact, Load.LINKS, part.values))
            contact += 1
    rows = torques + [
        (DRIVE_LAWS.index(curve.law), int(place[joint]), Load.LINKS, curve.values)
        for joint, curve in added.curves
    ]
    first_error = len(rows)
    rows += [
        (ENCODER_LAWS.index(error.law), int(place[joint]), Load.LINKS, error.values)
        for joint, error in added.of(EncoderError)
    ]
    kinds, joints, loads = np.array([row[:3] for row in rows], dtype=np.int64).reshape(-1, 3).T
    value = np.zeros((len(rows), max((len(row[3]) for row in rows), default=0)))
    for row, (*_, values) in zip(value, rows, strict=True):
        row[: len(values)] = values
    stateful = [k for k, row in enumerate(torques) if TORQUE_LAWS[row[0]].advance is not None]
    return Rows(
        kind=kinds.copy(),
        joint=joints.copy(),
        value=value,
        load=loads.copy(),
        state=np.zeros((len(torques), STATES)),
        stateful=np.array(stateful, dtype=np.int64),
        first_error=first_error,
    )


def _grown(base: Plant, added: JointContributions, place: IntArray, links: int) -> Plant:
    """Room for links behind shafts and for couplings: a contact for each of them.

    Those of links are without friction.
    """
    n = len(base.offset)
    pairs = np.array([[a, b] for a, b, _ in added.couplings], dtype=np.int64).reshape(-1, 2)
    terms = [term for _, _, term in added.couplings]

    def contacts(values: NDArray[Any], of_links: Any, of_couplings: Any) -> NDArray[Any]:
        """Values by contact: of the joints, then new ones of links, then all of couplings."""
        parts = (values[:n], of_links, values[n:], of_couplings)
        return np.concatenate([np.asarray(part, dtype=values.dtype) for part in parts])

    first, second, direction = base.contacts
    least = [LEAST_LEVEL if term.dry else 0.0 for term in terms]
    return base._replace(
        drive_inertia=np.pad(base.drive_inertia, (0, links)),
        damping=np.pad(base.damping, (0, links)),
        offset=np.pad(base.offset, (0, links)),
        level=contacts(base.level, np.zeros(links), least),
        contacts=Contacts(
            contacts(first, np.arange(n, n + links), place[pairs[:, 0]]),
            contacts(second, np.full(links, -1), place[pairs[:, 1]]),
            contacts(direction, np.ones(links), [term.direction for term in terms]),
        ),
    )


def encoder_error(added: JointContributions, position: FloatArray) -> tuple[FloatArray, FloatArray]:
    """What encoders add to true positions (…, n_joints), and its derivative by position."""
    error, slope = np.zeros_like(position), np.zeros_like(position)
    for j, encoder in added.of(EncoderError):
        of_encoder, slope_of_encoder = encoder.law.error.py_func(  # type: ignore[attr-defined]
            encoder.values, position[..., j]
        )
        error[..., j] += of_encoder
        slope[..., j] += slope_of_encoder
    return error, slope


def true_state(
    added: JointContributions, position: FloatArray, velocity: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Position and velocity (n_joints,) of the motors where the encoders show these."""
    true = position.copy()
    for _ in range(20):  # the error's slope is far below one
        error, slope = encoder_error(added, true)
        true = true - (true + error - position) / (1.0 + slope)
    return true, velocity / (1.0 + encoder_error(added, true)[1])
