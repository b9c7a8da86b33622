"""What of the signals of a joint contradicts its robot, before any physics is named.

Positions and speeds against the limits of the URDF, efforts against the nominal model and against
what no torque can be. Each finding is one sentence: what is wrong, and what to do.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from idim_iv_ros.identification.effort_statistics import (
    FEWEST_ROWS_PER_COLUMN,
    ROWS_PER_COLUMN,
    TAIL,
    EffortStatistics,
    effort_statistics,
)
from idim_iv_ros.model import InverseModel
from idim_iv_ros.model.parameters import unit_at
from idim_iv_ros.signals.cutoffs import Cutoffs
from idim_iv_ros.signals.motion import Motion
from idim_iv_ros.simulation import inverse_dynamics
from idim_iv_ros.types import FloatArray

Level = Literal["good", "limited", "unusable"]

_DEGREE = np.pi / 180.0
_BEYOND = 0.05  # of the range of the URDF, at either end
_TOO_FAR, _TOO_FAST = 1.5, 1.2  # times the range, times the speed limit
_TURNS = 4.0 * np.pi  # rad, of a joint without position limits that may be in degrees
_OUTLIER = 10.0  # times the largest of all other efforts
_SIGNIFICANT = 5.0  # standard deviations
_POSITIVE = 2.0  # the same, from which friction takes energy out
_MOSTLY_FRICTION = 0.5  # of the variance of the effort
_STATIC = 0.95  # of that variance
_ABSENT = 0.2  # of the torque of accelerations that the nominal masses need
_BETTER_WITH_SIGNS = 0.7  # of the residual
_MOSTLY_MASSES = 0.5  # of the variance of the effort beside friction
ANOTHER_UNIT = 10.0  # times what the other joints have
_BOTH_WAYS = 0.05  # of the samples
_FRICTION = 3.0  # times the effort
# A link turns as far as its motor (in joint angles): otherwise another unit, sign or ratio.
_ANOTHER_RATIO = 0.1
_STANDS_STILL = 0.01  # of the motor's motion
_STATES = 200  # of a recording, that show how much of a torque depends on other joints
_SPOILT = 0.05  # of a torque, from which on it does
_RESTING = 1e-3  # rad (m) of standard deviation, below which nothing follows anything
_MOVES = 0.05  # of the largest, from which on a reference is judged
_SAME_MOTION = 0.9  # correlation, from which on a factor between two motions is one of units
_ANOTHER_MOTION = 0.2  # correlation, below which a joint does not follow its reference
_FACTOR = 10.0  # beyond what a soft loop makes
_REPEATED = 1e-4  # of a motion: no loop follows its reference so closely
_MOST_LATE = 5  # samples by which a repeated motion may come later


@dataclass(frozen=True)
class JointFinding:
    """What is wrong with the signals of one joint.

    `level`: ``unusable`` where numbers identified with it mean nothing; `left_out`: whether the
    joint's torque says nothing of its links and drive.
    """

    joint: int
    level: Level
    sentence: str
    left_out: bool = False


def joint_findings(
    model: InverseModel, motions: Sequence[Motion], cutoffs: Cutoffs, effort_unit: str
) -> tuple[JointFinding, ...]:
    """Say what is wrong with the signals, joint by joint; empty where nothing is.

    `effort_unit`: ``N m``, ``A`` or ``V``: only torques are compared with those of the nominal
    model.
    """
    statistics = effort_statistics(model, motions, cutoffs)
    efforts = {k: effort for k, effort in enumerate(statistics) if effort is not None}
    ratios = {
        joint: effort.torque.value
        for joint, effort in efforts.items()
        if effort.torque is not None and effort.torque.of_rest >= _MOSTLY_MASSES
    }
    sizes = {joint: effort.size for joint, effort in efforts.items()}
    units = in_smaller_units(ratios, sizes) if effort_unit == "N m" else {}
    signals_of = [_Signals(model, motions, joint, effort_unit) for joint in range(len(statistics))]
    positions = [list(signals.positions()) for signals in signals_of]
    wrong = [k for k, some in enumerate(positions) if any(finding.left_out for finding in some)]
    spoilt = _moved_by(model, motions, wrong)
    turned: dict[int, list[str]] = {}  # recordings in which the effort has another sign
    for motion in motions if len(motions) > 1 else ():
        for joint, effort in enumerate(effort_statistics(model, [motion], cutoffs)):
            if effort and opposite_sign(effort):
                turned.setdefault(joint, []).append(motion.signals.name)
    findings: list[JointFinding] = []
    for joint, (signals, of_effort) in enumerate(zip(signals_of, statistics, strict=True)):
        findings += positions[joint]
        if joint in wrong:
            continue
        if joint in spoilt:
            names = ", ".join(model.robot.joints[k] for k in wrong)
            sentence = f"its torque depends on the motion of {names}, which cannot be right"
            findings.append(JointFinding(joint, "unusable", sentence, left_out=True))
            continue
        findings += _too_few_rows(model, motions, cutoffs, joint)
        findings += signals.outliers()
        if 0 < len(turned.get(joint, ())) < len(motions):
            sentence = (
                f"the effort has the opposite sign in {', '.join(turned[joint])} only: leave "
                "such recordings out, or record again with the driver as in the others"
            )
            findings.append(JointFinding(joint, "unusable", sentence, left_out=True))
        elif of_effort is not None:
            findings += signals.efforts(of_effort, units.get(joint))
    wrong_of: dict[int, str] = {}
    for motion in motions:
        asked, moved, span = motion.signals.position_reference, motion.signals.position, motion.span
        if asked is not None:
            wrong_of |= wrong_references(moved[span], asked[span], model.robot.joints)
    findings += [JointFinding(joint, "limited", wrong_of[joint]) for joint in sorted(wrong_of)]
    return tuple(findings)


def wrong_references(
    position: FloatArray, reference: FloatArray, joints: Sequence[str]
) -> Iterator[tuple[int, str]]:
    """Yield joints whose reference has another unit, or is that of another joint, and why.

    A lag, an offset and a soft loop are neither. `position`, `reference`: (s, n_joints).
    """
    moved, asked = position - position.mean(axis=0), reference - reference.mean(axis=0)
    spreads = np.std(moved, axis=0), np.std(asked, axis=0)
    alike = moved.T @ asked / len(moved) / np.maximum(np.outer(*spreads), 1e-300)
    moving = np.minimum(*spreads) > np.maximum(_RESTING, _MOVES * spreads[0].max())
    same = np.diag(alike)
    for joint in np.flatnonzero(moving).tolist():
        nearest, factor = int(np.argmax(alike[joint])), spreads[1][joint] / spreads[0][joint]
        if same[joint] < -_SAME_MOTION:
            yield joint, "its references have the opposite sign of its motion"
        elif same[joint] > _SAME_MOTION and not 1.0 / _FACTOR < factor < _FACTOR:
            yield joint, f"its references are {factor:.2g} times its motion: another unit?"
        elif (
            max(same[joint], same[nearest]) < _ANOTHER_MOTION
            and alike[joint, nearest] > _SAME_MOTION
        ):
            yield joint, f"it moves as the references of {joints[nearest]} say: another order?"


def repeats_motion(position: FloatArray, reference: FloatArray) -> bool:
    """Whether references are the measured positions, or those of a few samples before.

    A motion comes after its reference, and never so near to it. `position`, `reference`: (s,
    n_joints).
    """
    spreads = np.std(position, axis=0)
    moving = spreads > max(_RESTING, _MOVES * float(spreads.max(initial=0.0)))
    if not moving.any() or len(position) <= _MOST_LATE + 1:
        return False
    later, spreads = reference[_MOST_LATE:, moving], spreads[moving]
    apart = [
        np.std(later - position[_MOST_LATE - lag : len(position) - lag, moving], axis=0) / spreads
        for lag in range(_MOST_LATE + 1)
    ]
    return bool(np.min(apart, axis=0).max() < _REPEATED)


def in_smaller_units(ratios: Mapping[int, float], sizes: Mapping[int, float]) -> dict[int, float]:
    """Joints whose effort has a smaller unit than the others', and how many times as large it is.

    It is far larger than the torque of the masses that it follows, also beside the other joints',
    and far larger than their efforts. A payload at a light wrist makes the first alone; masses that
    are all placeholders make no difference between joints, and masses given too large no effort.

    `ratios`: of efforts to the torques that they follow; `sizes`: of efforts, RMS.
    """
    made = {}
    for joint, ratio in ratios.items():
        usual = [value for other, value in ratios.items() if other != joint and value > 0.0]
        others = [size for other, size in sizes.items() if other != joint]
        if usual and sizes[joint] >= ANOTHER_UNIT * np.median(others):
            middle = float(np.median(usual))
            if ratio > ANOTHER_UNIT * max(1.0, middle):
                made[joint] = ratio / middle
    return made


def _moved_by(
    model: InverseModel, motions: Sequence[Motion], wrong: Sequence[int]
) -> frozenset[int]:
    """Joints whose torque, by the nominal masses, changes where some joints are in degrees."""
    if not wrong:
        return frozenset()
    nominal, torques, changes = model.robot.given.of_links, [], []
    scale = np.ones(len(model.robot.joints))
    scale[wrong] = _DEGREE
    for motion in motions:
        samples = motion.decimation.samples
        states = [state[:: -(-samples // _STATES)] for state in motion.derivatives(0, samples)]
        torques.append(inverse_dynamics(model.robot, nominal, *states))
        right = [state * scale for state in states]
        changes.append(torques[-1] - inverse_dynamics(model.robot, nominal, *right))
    sizes = [np.linalg.norm(np.concatenate(parts), axis=0) for parts in (torques, changes)]
    return frozenset(np.flatnonzero(sizes[1] > _SPOILT * sizes[0]).tolist())


def _too_few_rows(
    model: InverseModel, motions: Sequence[Motion], cutoffs: Cutoffs, joint: int
) -> Iterator[JointFinding]:
    """Say which band, or which duration, would give a joint enough rows."""
    rows = sum(int(motion.kept[:, joint].sum()) for motion in motions)
    columns = int(model.base.active[joint].sum())
    if rows == 0 or rows >= ROWS_PER_COLUMN * columns:
        return
    more = ROWS_PER_COLUMN * columns / rows
    seconds = more * sum(len(motion.position) / motion.signals.rate for motion in motions)
    sentence = (
        f"{rows} rows for its {columns} columns, fewer than {ROWS_PER_COLUMN} for each: record "
        f"{seconds:.3g} s of such motion"
    )
    decimation, position = more * cutoffs.decimation, more * cutoffs.position
    if position < min(motion.signals.rate for motion in motions) / 2.0:
        sentence += (
            f", or raise processing.decimation_cutoff to {decimation:.2g} Hz and position_cutoff "
            f"to {position:.2g} Hz"
        )
    # The other joints know most of these columns: with two rows for each there is still a residual.
    yield JointFinding(joint, "limited", sentence, left_out=rows < FEWEST_ROWS_PER_COLUMN * columns)


def opposite_sign(effort: EffortStatistics) -> str:
    """Say that an effort has the opposite sign; friction that takes energy out excludes it."""
    torque, friction = effort.torque, effort.friction
    if friction is None or friction.certainty > _POSITIVE:
        return ""
    reasons = []
    if friction.certainty < -_SIGNIFICANT and friction.of_variance > _MOSTLY_FRICTION:
        reasons.append(f"friction gives energy ({friction.value:.3g} along the speed)")
    if torque is not None and torque.certainty < -_SIGNIFICANT:
        reasons.append(f"it is {torque.value:.2g} times the nominal masses' torque")
    if not reasons:
        return ""
    return (
        f"the effort has the opposite sign: {' and '.join(reasons)}; give it a negative "
        "signals.effort_scale"
    )


class _Signals:
    """Positions, speeds and efforts of a joint in all recordings, and the tests of them."""

    def __init__(
        self, model: InverseModel, motions: Sequence[Motion], joint: int, effort_unit: str
    ) -> None:
        self.robot, self.joint = model.robot, joint
        kind = model.robot.joint_types[joint]
        self.angle, self.torque = unit_at("rad", kind), unit_at("N m", kind)
        self.in_newton_metres = effort_unit == "N m" and model.robot.has_inertials
        positions = [motion.position[motion.span, joint] for motion in motions]
        rates = [motion.signals.rate for motion in motions]
        speeds = [np.gradient(of, 1.0 / rate) for of, rate in zip(positions, rates, strict=True)]
        self.position, self.speed = np.concatenate(positions), np.concatenate(speeds)
        self.effort = np.concatenate([motion.signals.torque[:, joint] for motion in motions])

    def positions(self) -> Iterator[JointFinding]:
        """Findings on positions and speeds beyond the limits of the URDF."""
        limits = self.robot.limits
        lower, upper = float(limits.lower[self.joint]), float(limits.upper[self.joint])
        fastest = float(limits.velocity[self.joint]) or np.inf
        angle = self.angle
        low, high = np.quantile(self.position, [TAIL, 1.0 - TAIL])
        speed = float(np.quantile(np.abs(self.speed), 1.0 - TAIL))
        span, room = high - low, _BEYOND * (upper - lower)
        moved = f"positions from {low:.3g} to {high:.3g} {angle}"
        limited = bool(np.isfinite(room))
        if limited:
            inside = lower - room <= low * _DEGREE and high * _DEGREE <= upper + room
            degrees = span > _TOO_FAR * (upper - lower) and inside
            given = f"{lower:.3g} to {upper:.3g} {angle} of the URDF"
        else:
            degrees = span > _TURNS and speed > _TOO_FAR * fastest >= _TOO_FAR * speed * _DEGREE
            given = f"the speed limit of {fastest:.3g} {angle}/s of the URDF"
        if angle == "rad" and degrees:
            sentence = (
                f"{moved}, up to {speed:.3g} rad/s, at {given}: degrees, or angles of a motor "
                "before its gear? Record rad, or give robot.motor_to_joint"
            )
            yield JointFinding(self.joint, "unusable", sentence, left_out=True)
            return
        if limited and (low < lower - room or high > upper + room):
            why = "is it the URDF of this robot, and the unit of its signals?"
            if span <= upper - lower + 2.0 * room:
                why = "does its zero differ? Then give robot.position_offset"
            yield JointFinding(self.joint, "limited", f"{moved}, outside {given}: {why}")
        if speed > _TOO_FAST * fastest:
            sentence = (
                f"speeds up to {speed:.3g} {angle}/s, above the {fastest:.3g} of the URDF: look at "
                "the unit of the positions and at the stamps"
            )
            yield JointFinding(self.joint, "limited", sentence)

    def outliers(self) -> Iterator[JointFinding]:
        """A finding where some efforts are far above all others."""
        size = np.abs(self.effort)
        usual = float(np.quantile(size, 1.0 - TAIL))
        count = int(np.count_nonzero(size > _OUTLIER * usual))
        if usual > 0.0 and count:
            sentence = (
                f"{count} of {len(size)} efforts are far above all others (largest "
                f"{size.max():.3g}, usual up to {usual:.3g}): look at the driver"
            )
            yield JointFinding(self.joint, "limited", sentence)

    def efforts(self, effort: EffortStatistics, times: float | None) -> Iterator[JointFinding]:
        """Efforts that cannot be the torque of this joint.

        `times`: by how much the effort is larger than the other joints' units make it, if it is.
        """
        sentence = self._unsigned(effort) or opposite_sign(effort) or self._static(effort)
        if not sentence and times is not None:
            sentence = (
                f"the effort is {times:.2g} times what the nominal masses need in the unit of the "
                "other joints: give what makes it a torque as signals.effort_scale"
            )
        if sentence:
            yield JointFinding(self.joint, "unusable", sentence, left_out=True)
        elif self.in_newton_metres and effort.given_friction > _FRICTION * effort.size:
            given = self.robot.given
            sentence = (
                f"damping {given.viscous[self.joint]:.3g} and friction "
                f"{given.coulomb[self.joint]:.3g} of the nominal model would take "
                f"{effort.given_friction:.3g} {self.torque} (rms) of a measured "
                f"{effort.size:.3g}: are they the gains of a simulated servo? Correct them in the "
                "robot's file"
            )
            yield JointFinding(self.joint, "limited", sentence)

    def _unsigned(self, effort: EffortStatistics) -> str:
        low, high = np.quantile(self.effort, [TAIL, 1.0 - TAIL])
        turning = np.mean(self.speed > 0.0)
        if low < 0.0 < high or not _BOTH_WAYS < turning < 1.0 - _BOTH_WAYS:
            return ""
        if effort.unsigned > _BETTER_WITH_SIGNS * effort.signed:
            return ""
        return (
            "the effort never changes its sign, and a torque that does explains it better "
            f"(residual {effort.unsigned:.3g} instead of {effort.signed:.3g}): the driver "
            "publishes its size alone; record one with a sign"
        )

    def _static(self, effort: EffortStatistics) -> str:
        if not self.in_newton_metres or effort.static_share < _STATIC:
            return ""
        expected, torque = effort.expected, effort.torque
        if torque is not None and torque.certainty > _SIGNIFICANT:  # another unit than N m
            expected *= min(torque.value, 1.0)
        if expected <= effort.residual or effort.shown > _ABSENT * expected:
            return ""
        return (
            f"{100.0 * effort.static_share:.4g} % of the effort is a function of position and "
            f"direction, and of {expected:.2g} {self.torque} (rms) that the nominal masses "
            f"need to accelerate it holds {effort.shown:.2g}: a friction or gravity compensation, "
            "not the whole torque; record that"
        )


def link_findings(motions: Sequence[Motion], joint_types: Sequence[str]) -> Iterator[JointFinding]:
    """Describe every joint that has an encoder behind its gear in all recordings."""
    for joint, kind in enumerate(joint_types):
        pairs = []
        for motion in motions:
            signals, span = motion.signals, motion.span
            if signals.link_position is None or signals.link_valid is None:
                return
            valid = signals.link_valid[span, joint]
            sides = (of[span, joint][valid] for of in (signals.position, signals.link_position))
            if valid.any():
                pairs.append([side - side.mean() for side in sides])
        if len(pairs) < len(motions):
            continue
        motor, link = (np.concatenate(signals_of) for signals_of in zip(*pairs, strict=True))
        energy = float(motor @ motor)
        if energy <= 0.0:
            continue
        ratio = float(motor @ link) / energy
        level: Level = "limited"
        if abs(ratio) < _STANDS_STILL:
            sentence = "the encoder behind the gear stands still while the motor turns"
        elif abs(ratio - 1.0) > _ANOTHER_RATIO:
            sentence = (
                f"the encoder behind the gear turns {ratio:.3g} times as far as the motor: look "
                "at its unit and sign, and at the gear ratio"
            )
        else:
            level, apart = "good", float(np.sqrt(np.mean((motor - link) ** 2)))
            sentence = (
                f"an encoder behind the gear: it differs from the motor by {1e3 * apart:.3g} "
                f"m{unit_at('rad', kind)} rms, twist, play and time offset together; diagnose "
                "tells them apart"
            )
        yield JointFinding(joint, level, sentence)
