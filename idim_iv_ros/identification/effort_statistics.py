"""What the effort of a joint is made of: torque of the nominal masses, friction, accelerations.

Least squares on positions and efforts that are low-passed alike, at a sample of the rows: enough to
see whether efforts are torques at all, before anything is identified with them.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from math import inf

import numpy as np

from idim_iv_ros.estimation.qr import Basis, independent_basis
from idim_iv_ros.model import InverseModel
from idim_iv_ros.signals.cutoffs import Cutoffs
from idim_iv_ros.signals.filters import zero_phase_butterworth
from idim_iv_ros.signals.motion import Motion
from idim_iv_ros.simulation import inverse_dynamics
from idim_iv_ros.types import FloatArray

_FRICTION = ("Fv", "Fc", "off", "Fvm", "Fcm")
_MOST_ROWS = 1000
# Rows of a joint for each of its columns, below which that is said, and below which a diagnosis
# does without the joint.
ROWS_PER_COLUMN, FEWEST_ROWS_PER_COLUMN = 5, 2
_BATCHES = 10
# Share of the efforts at either end that is pulled in: one outlier would decide the fit.
TAIL = 5e-4
_ROUNDING = 1e-9
_LEAST_BAND = 0.1  # share of the spectrum above the position filter
_MOST_NOISE = 0.75  # of the energy of accelerations
_SIGNS = 8  # rounds of new signs
_LEAST_OF_A_SIGN = 0.05  # of the rows


@dataclass(frozen=True)
class Share:
    """Coefficient of a column of a regression, and the variance that it explains.

    `deviation`: standard deviation by batch means, for residuals may be autocorrelated;
    `of_variance`: share of the effort's variance that it explains; `of_rest`: of what is left of
    that beside the other columns.
    """

    value: float
    deviation: float
    of_variance: float
    of_rest: float

    @property
    def certainty(self) -> float:
        """Ratio of the coefficient to its standard deviation."""
        return self.value / self.deviation if self.deviation > 0.0 else inf * np.sign(self.value)


@dataclass(frozen=True)
class EffortStatistics:
    """Statistics of the effort of one joint.

    `torque`: of the torque that the nominal masses need, beside friction and the joint's drive
    inertia: 1 where efforts are torques. None where the nominal model needs none. `friction`: of
    the direction of the speed beside the columns of masses and drives: dry friction. None where
    these hold it. `peak`: of the effort without friction, but for outliers. `static_share`: share
    of the variance that position and direction of the speed explain. `expected`, `shown`,
    `residual`: RMS, beside all that position and speed explain: of the nominal masses' torque of
    accelerations, of what all columns of accelerations explain, and of what nothing explains. The
    first is less what the noise of the positions adds, and zero where that is most of it: noise in
    the columns hides what they explain. `given_friction`, `size`: RMS of the nominal friction and
    of the effort. `signed`, `unsigned`: RMS of the residual of the effort as it is, and taken for
    the size of a torque; the second is infinite where the effort has both signs, or a torque with
    both signs is not likelier.
    """

    torque: Share | None
    friction: Share | None
    peak: float
    static_share: float
    expected: float
    shown: float
    residual: float
    given_friction: float
    size: float
    signed: float
    unsigned: float


def effort_statistics(
    model: InverseModel, motions: Sequence[Motion], cutoffs: Cutoffs
) -> tuple[EffortStatistics | None, ...]:
    """Take the statistics of each joint; None where it has fewer than five rows a column."""
    stride = -(-sum(len(motion.decimation.kept) for motion in motions) // _MOST_ROWS)
    counting = np.concatenate([motion.kept[::stride] for motion in motions])
    active = [np.flatnonzero(columns) for columns in model.base.active]
    enough = counting.sum(axis=0) >= ROWS_PER_COLUMN * np.array(list(map(len, active)))
    if not enough.any():
        return (None,) * len(active)
    parts = [_samples(motion, cutoffs.decimation, stride) for motion in motions]
    samples = np.concatenate(parts, axis=1)
    states, noisy, effort, robot = samples[:3], samples[3:6], samples[6], model.robot
    position, speed, _ = states
    nominal = robot.given.without_friction
    noise = inverse_dynamics(robot, nominal, *noisy) - inverse_dynamics(robot, nominal, *states)
    moving = model.joint_matrices(*states)
    resting = model.joint_matrices(position, np.zeros_like(speed), np.zeros_like(speed))
    standard = model.regressor.layout.parameters
    of_friction = np.array([standard[column].kind in _FRICTION for column in model.base.columns])
    statistics: list[EffortStatistics | None] = []
    for joint, columns in enumerate(active):
        if not enough[joint]:
            statistics.append(None)
            continue
        drive = [parameter.kind == "Ia" and parameter.joint == joint for parameter in standard]
        of_drive = np.any(model.base.grouping[:, np.array(drive)] != 0.0, axis=1)[columns]
        kept, friction, given = counting[:, joint], of_friction[columns], model.given[columns]
        rows, weight, torque = moving[joint][kept], resting[joint][kept], effort[kept, joint]
        direction, constant = np.sign(speed[kept, joint]), np.ones(np.count_nonzero(kept))
        dissipative = np.column_stack([direction, speed[kept, joint]])
        lost = np.column_stack([rows[:, friction], dissipative, constant])
        weight, bodies = weight[:, ~friction], rows[:, ~friction]
        inertial = bodies - weight
        static, everything = _span(weight, lost), _span(bodies, lost)
        residual = _span(weight, lost, inertial).remove(torque)
        slow = _span(weight, direction, constant).remove(torque)
        # Of accelerations, and of what the noise of the positions makes of them.
        energy, of_noise = (
            float(np.mean(static.remove(part) ** 2))
            for part in (inertial @ given[~friction], noise[kept, joint])
        )
        needed = bodies @ given[~friction]
        peak = np.quantile(np.abs(_span(dissipative).remove(torque)), 1.0 - TAIL)
        clear = of_noise < _MOST_NOISE * energy
        statistics.append(
            EffortStatistics(
                torque=_share(needed, _span(lost, rows[:, of_drive]), torque),
                friction=_share(direction, _span(bodies, constant), torque),
                peak=float(peak),
                static_share=1.0 - float(np.mean(slow**2)) / max(float(np.var(torque)), 1e-300),
                expected=float(np.sqrt(energy - of_noise)) if clear else 0.0,
                shown=_rms(static.remove(torque) - residual),
                residual=_rms(residual),
                given_friction=_rms(rows[:, friction] @ given[friction]),
                size=_rms(torque),
                signed=_rms(everything.remove(torque)),
                unsigned=_unsigned(everything, torque, (direction, np.sign(needed))),
            )
        )
    return tuple(statistics)


def _samples(motion: Motion, cutoff: float, stride: int) -> FloatArray:
    """Position, speed, acceleration in the band of the rows, again, and effort: (7, r, n_joints).

    The second time of positions with as much noise once more as they have: that is what the
    position filter removed, taken as white. One joint after the other, for the sake of memory.
    """
    signals, span, places = motion.signals, motion.span, motion.decimation.kept[::stride]
    empty_share = max(1.0 - 2.0 * motion.cutoff / signals.rate, _LEAST_BAND)
    random = np.random.default_rng(0)
    filtered = partial(zero_phase_butterworth, rate=signals.rate, cutoff=cutoff, order=motion.order)
    made = np.empty((7, len(places), signals.position.shape[1]))
    for joint in range(made.shape[2]):
        position, torque = signals.position[:, [joint]], signals.torque[:, [joint]]
        size = np.std((position - motion.position[:, [joint]])[span]) / np.sqrt(empty_share)
        again = position + size * random.standard_normal(position.shape)
        for first, values in ((0, position), (3, again)):
            states = motion.derivatives_of(filtered(values), 0, span.stop - span.start)
            for place, state in enumerate(states, first):
                made[place, :, joint] = state[places, 0]
        usual = np.clip(torque, *np.quantile(torque, [TAIL, 1.0 - TAIL]))
        made[6, :, joint] = filtered(usual)[span][places, 0]
    return made


def _span(*columns: FloatArray) -> Basis:
    """Orthonormal basis of the space that columns (r, c) span."""
    return independent_basis(np.column_stack(columns))


def _share(column: FloatArray, others: Basis, effort: FloatArray) -> Share | None:
    """Coefficient of a column (r,) in a regression on it and others (Frisch and Waugh).

    None where the column is a combination of the others.
    """
    alone, rest = others.remove(column), others.remove(effort)
    energy = float(alone @ alone)
    if energy <= _ROUNDING * float(column @ column):
        return None
    value = float(alone @ rest) / energy
    scores = np.array_split(alone * (rest - value * alone), _BATCHES)
    deviation = float(np.sqrt(sum(float(score.sum()) ** 2 for score in scores))) / energy
    explained = value**2 * energy
    parts = (effort - effort.mean(), rest)
    of_variance, of_rest = (explained / max(float(part @ part), 1e-300) for part in parts)
    return Share(value, deviation, of_variance, of_rest)


def _unsigned(everything: Basis, effort: FloatArray, starts: Sequence[FloatArray]) -> float:
    """RMS of the effort's size less that of the likeliest torque with both signs; see the class."""
    size = effort if effort.mean() > 0.0 else -effort
    best = inf
    for start in starts:
        signs = np.where(start < 0.0, -1.0, 1.0)
        for _ in range(_SIGNS):
            torque = signs * size - everything.remove(signs * size)
            signs, before = np.where(torque < 0.0, -1.0, 1.0), signs
            if np.array_equal(signs, before):
                break
        if _LEAST_OF_A_SIGN < np.mean(signs > 0.0) < 1.0 - _LEAST_OF_A_SIGN:
            best = min(best, _rms(np.abs(torque) - size))
    return best


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))
