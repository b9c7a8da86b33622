"""A robot with effects as the plant, arrays and control loop that compiled code works on."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple, TypeVar

import numpy as np

from idim_iv_ros.effects.contribution import (
    STATES,
    Contribution,
    CouplingTerm,
    DriveCurve,
    EncoderError,
    Load,
    ShaftPart,
    TorqueTerm,
)
from idim_iv_ros.effects.registry import DRIVE_LAWS, ENCODER_LAWS, TORQUE_LAWS
from idim_iv_ros.model.parameters import DynamicParameters
from idim_iv_ros.model.robot import RobotModel
from idim_iv_ros.simulation.effect_kernel import LEAST_LEVEL, Effects, Rows
from idim_iv_ros.simulation.effects import JointEffect
from idim_iv_ros.simulation.plant import Plant, plant
from idim_iv_ros.simulation.shaft import Shaft, fastest_shaft, joined_shafts, split_drives
from idim_iv_ros.types import FloatArray, IntArray

# A step is at most this over the pulsation of the fastest shaft, rad.
SHAFT_ANGLE = 0.4
# Dry friction that bristles leave, as a share of the model's, at which a joint still sticks.
STICKS = 1e-9

_Kind = TypeVar("_Kind", bound=Contribution)


@dataclass(frozen=True)
class JointContributions:
    """What effects add to a robot: contributions with their joints (the second one, or -1)."""

    items: tuple[tuple[int, int, Contribution], ...]

    def of(self, kind: type[_Kind]) -> Iterator[tuple[int, _Kind]]:
        """Pairs of a joint and its contribution, of all contributions of a kind."""
        return ((joint, part) for joint, _, part in self.items if isinstance(part, kind))

    @property
    def curves(self) -> list[tuple[int, DriveCurve]]:
        """Changes of commands in the order in which they act, each after its joint."""
        return sorted(self.of(DriveCurve), key=lambda item: item[1].rank)

    @property
    def couplings(self) -> list[tuple[int, int, CouplingTerm]]:
        """Couplings with the two joints between which they act."""
        return [(a, b, part) for a, b, part in self.items if isinstance(part, CouplingTerm)]


def contributions_of(effects: Sequence[JointEffect], coulomb: FloatArray) -> JointContributions:
    """What effects add to joints with this Coulomb friction, (n_joints,) N m (N)."""
    return JointContributions(
        tuple(
            (one.joint, one.other_joint, contribution)
            for one in effects
            for contribution in one.contributions(float(coulomb[one.joint]))
        )
    )


class AffectedRobot(NamedTuple):
    """Plant of N coordinates with its effects, and the longest step that resolves its shafts, s."""

    plant: Plant
    effects: Effects
    shafts: tuple[Shaft, ...]
    longest_step: float


def affected_robot(
    robot: RobotModel,
    parameters: DynamicParameters,
    added: JointContributions,
    *,
    start_time: float,
    position: FloatArray,
) -> AffectedRobot:
    """Shape a robot, its parameters and what effects add to it for simulation.

    Friction of a joint with friction effects may be negative in `parameters`: only the sum with
    the effects is kept from driving. `position` (n_joints,) is where backlash is given its
    default stiffness.

    Raises UsageError: a shaft where the drive inertia is not known (see `shaft.split_drives`).
    """
    shafts = joined_shafts(added.of(ShaftPart))
    parameters = split_drives(robot, parameters, [shaft.joint for shaft in shafts])
    shafts, pulsation = fastest_shaft(robot, parameters, shafts, position)
    base, place = plant(robot, parameters), np.argsort(robot.order)
    friction = parameters.coulomb, parameters.viscous
    changing, effects = affected_plant(base, friction, added, place, shafts, start_time)
    longest = SHAFT_ANGLE / pulsation if pulsation > 0.0 else np.inf
    return AffectedRobot(changing, effects, shafts, float(longest))


def affected_plant(
    base: Plant,
    friction: tuple[FloatArray, FloatArray],
    added: JointContributions,
    place: IntArray,
    shafts: Sequence[Shaft],
    start_time: float,
) -> tuple[Plant, Effects]:
    """Return the plant whose friction is that of the instant, and the effects that change it.

    `friction`: dry and viscous friction (n_joints,) of the model, possibly negative: joints with
    effects of friction have it in the place of the plant's, which is not. `place` (n_joints,): of
    the joints in the plant.
    """
    coulomb, viscous = friction
    n, extra = len(base.offset), len(shafts)
    dry, dissipative = np.zeros(n, dtype=bool), np.zeros(n, dtype=bool)
    level, damping = base.level.copy(), base.damping.copy()
    for joint, term in added.of(TorqueTerm):
        if term.friction:
            i = place[joint]
            dissipative[i] = True
            level[i] = coulomb[joint]
            damping[i, i] = viscous[joint]
            dry[i] |= term.dry
    model = _grown(base, level.copy(), damping, extra)
    for joint, term in added.of(TorqueTerm):
        level[place[joint]] -= term.replaced
    # Where bristles are all of the friction nothing sticks: they hold by themselves.
    dry |= level[:n] > STICKS * base.level[:n]
    level[:n] = np.where(dry, level[:n], 0.0)
    grown = _coupled(_grown(base, level, damping, extra), added, place)
    # The plant's own level and damping are those of the instant.
    current = grown.level.copy()
    current[:n] = np.where(dry, np.maximum(current[:n], LEAST_LEVEL), 0.0)
    changing = grown._replace(level=current, damping=grown.damping.copy())
    couplings = len(added.couplings)
    unchanged = grown.level.copy()
    unchanged[len(unchanged) - couplings :] = 0.0
    link = np.arange(n)
    for k, shaft in enumerate(shafts):
        link[place[shaft.joint]] = n + k
    return changing, Effects(
        rows=effect_rows(added, place, first_coupling=len(unchanged) - couplings),
        level=unchanged,
        damping=grown.damping,
        model_level=np.pad(model.level, (0, couplings)),
        model_damping=model.damping,
        dry=np.concatenate([dry, grown.level[n:] > 0.0]),
        dissipative=dissipative,
        start_time=float(start_time),
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
        static=np.zeros(n),
        inertial=np.zeros(n),
        rigid_mass=np.zeros((n, n)),
        measured=np.zeros((2, n)),
    )


_Row = tuple[int, int, Load, tuple[float, ...]]


def effect_rows(added: JointContributions, place: IntArray, *, first_coupling: int) -> Rows:
    """Contributions with compiled laws; `first_coupling`: contact of the first coupling."""
    torques: list[_Row] = []
    contact = first_coupling
    for joint, _, part in added.items:
        if isinstance(part, TorqueTerm):
            kind = TORQUE_LAWS.index(part.law)
            torques.append((kind, int(place[joint]), part.load, part.values))
        elif isinstance(part, CouplingTerm):
            torques.append((TORQUE_LAWS.index(part.law), contact, Load.LINKS, part.values))
            contact += 1
    curves: list[_Row] = [
        (DRIVE_LAWS.index(curve.law), int(place[joint]), Load.LINKS, curve.values)
        for joint, curve in added.curves
    ]
    errors: list[_Row] = [
        (ENCODER_LAWS.index(error.law), int(place[joint]), Load.LINKS, error.values)
        for joint, error in added.of(EncoderError)
    ]
    rows = [*torques, *curves, *errors]
    value = np.zeros((len(rows), max((len(row[3]) for row in rows), default=0)))
    for row, (*_, values) in zip(value, rows, strict=True):
        row[: len(values)] = values
    stateful = [k for k, row in enumerate(torques) if TORQUE_LAWS[row[0]].advance is not None]
    return Rows(
        kind=np.array([row[0] for row in rows], dtype=np.int64),
        joint=np.array([row[1] for row in rows], dtype=np.int64),
        value=value,
        load=np.array([row[2] for row in rows], dtype=np.int64),
        state=np.zeros((len(torques), STATES)),
        stateful=np.array(stateful, dtype=np.int64),
        first_error=len(torques) + len(curves),
    )


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


def _coupled(grown: Plant, added: JointContributions, place: IntArray) -> Plant:
    """Add a contact for each coupling of two joints."""
    if not added.couplings:
        return grown
    first, second, terms = zip(*added.couplings, strict=True)
    return grown._replace(
        level=np.append(grown.level, [LEAST_LEVEL if term.dry else 0.0 for term in terms]),
        first=np.append(grown.first, place[list(first)]),
        second=np.append(grown.second, place[list(second)]),
        direction=np.append(grown.direction, [term.direction for term in terms]),
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
