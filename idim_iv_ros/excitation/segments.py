"""Segments of a diagnosis motion: what each kind reveals, and their shapes.

A shape (3, n_samples, n_joints) starts and ends at rest: position, velocity and acceleration
relative to its start, at 0, 1/rate, … up to but without the end, where the next one begins.
"""

from dataclasses import dataclass

import numpy as np

from idim_iv_ros.effects.registry import BY_NAME, CAUSES
from idim_iv_ros.excitation.trajectory import quintic
from idim_iv_ros.types import FloatArray

# Kinds of segment; which effects each reveals is in the files of `effects/`.
KINDS = ("repeat", "range_sweep", "creep", "plateau", "reversals", "multisine")
EFFECTS: dict[str, tuple[str, ...]] = {
    kind: tuple(cause.name for cause in CAUSES if kind in cause.segments) for kind in KINDS
}
NOT_REVEALED = {cause.name: cause.beyond_motion for cause in CAUSES if not cause.segments}

LOWEST_LINE = 0.5  # Hz
_FADE = 1.0  # s

# Pairs that no motion separates.
_NO_MOTION = {
    frozenset({"payload", "link_inertia"}): (
        "no motion does if the load is fixed to the link; take it off and record once more"
    ),
    frozenset({"torque_offset", "asymmetric_friction"}): (
        "no motion does: dry friction that differs between the directions is a constant torque "
        "beside its mean. Measure the torque without the drive's friction, behind the gear"
    ),
    frozenset({"position_ripple", "gain_ripple"}): (
        "no motion does in which the torque of the joint hardly changes: record the same positions "
        "once more under another load"
    ),
}


@dataclass(frozen=True)
class Segment:
    """A stretch of a motion for diagnosis, with the effects that it reveals."""

    name: str
    kind: str
    offset: FloatArray  # (n_joints,): where it starts, relative to the base posture, rad (m)
    shape: FloatArray  # (3, n_samples, n_joints): position, velocity, acceleration from its start
    speed: FloatArray | None = None  # (n_joints,): constant, of the way there, rad/s (m/s)
    amplitude: FloatArray | None = None  # (n_joints,): largest deviation, rad (m)
    frequency: tuple[float, float] | None = None  # (lowest, highest) Hz
    start: float = 0.0  # s, in the motion, once it has a place there
    end: float = 0.0  # s

    @property
    def effects(self) -> tuple[str, ...]:
        """Effects that the segment reveals on a robot with this number of joints."""
        joints = len(self.offset)
        return tuple(name for name in EFFECTS[self.kind] if joints >= BY_NAME[name].joints_needed)


def separating_motion(first: str, second: str) -> str:
    """Return in words which segments of ``excite --for diagnosis`` separate two effects.

    A segment that reveals one effect and not the other separates them; where there is none,
    those that reveal either are named. Empty where nothing is known of either.
    """
    pair = frozenset({first, second})
    if pair in _NO_MOTION:
        return _NO_MOTION[pair]
    apart = [kind for kind, effects in EFFECTS.items() if (first in effects) != (second in effects)]
    either = [kind for kind, effects in EFFECTS.items() if first in effects or second in effects]
    needs = [NOT_REVEALED[answer] for answer in (first, second) if answer in NOT_REVEALED]
    kinds = apart or either
    if kinds:
        names = " and ".join(filter(None, (", ".join(kinds[:-1]), kinds[-1])))
        plural = "s" if len(kinds) > 1 else ""
        needs.insert(0, f"the segment{plural} {names} of idim-iv excite --for diagnosis")
    return "; ".join(needs)


def rest_to_rest(displacement: FloatArray, seconds: float, rate: float) -> FloatArray:
    """Quintic shape from rest to rest, see `quintic`."""
    s, seconds = _phase(seconds, rate)
    return quintic(s) / seconds ** np.arange(3)[:, None, None] * displacement


def there_and_back(speed: FloatArray, plateau: float, ramp: float, rate: float) -> FloatArray:
    """Constant speed for `plateau` s, and the same way back.

    The speed rises and falls within `ramp` s as 3s² - 2s³, so that the acceleration is
    continuous, zero at both ends, and 1.5 speed / ramp at most. Its length is
    speed · (plateau + ramp).
    """
    rise, ramp = _phase(ramp, rate)
    flat = np.zeros((max(round(plateau * rate), 1), 1))
    level = np.vstack([3 * rise**2 - 2 * rise**3, flat + 1.0, 1.0 - 3 * rise**2 + 2 * rise**3])
    slope = 6.0 * rise * (1.0 - rise) / ramp
    slope = np.vstack([slope, flat, -slope])
    up = ramp * (rise**3 - 0.5 * rise**4)
    middle = 0.5 * ramp + np.arange(len(flat))[:, None] / rate
    top = 0.5 * ramp + len(flat) / rate
    way = np.vstack([up, middle, top + ramp * (rise - rise**3 + 0.5 * rise**4)])
    far = top + 0.5 * ramp
    way, level = np.vstack([way, far - way]), np.vstack([level, -level])
    return np.stack([way, level, np.vstack([slope, -slope])]) * speed


def waves(
    amplitude: FloatArray,
    frequency: FloatArray,
    phase: FloatArray,
    seconds: float,
    fade: float,
    rate: float,
) -> FloatArray:
    """Sum of sines of (n_lines, n_joints) each, faded in and out over `fade` s (quintic)."""
    s, seconds = _phase(seconds, rate)
    time = s * seconds
    position, velocity, acceleration = np.zeros((3, len(s), amplitude.shape[1]))
    for a, f, p in zip(amplitude, frequency, phase, strict=True):
        pulsation = 2.0 * np.pi * f
        position += a * np.sin(pulsation * time + p)
        velocity += a * pulsation * np.cos(pulsation * time + p)
        acceleration -= a * pulsation**2 * np.sin(pulsation * time + p)
    distance = np.minimum(time, seconds - time)
    window, slope, curvature = quintic(np.clip(distance / fade, 0.0, 1.0))
    first, second = np.where(time <= seconds / 2.0, 1.0, -1.0) / fade * slope, curvature / fade**2
    faded_velocity = window * velocity + first * position
    faded_acceleration = window * acceleration + 2.0 * first * velocity + second * position
    return np.stack([window * position, faded_velocity, faded_acceleration])


def reversals(
    joints: int, amplitude: float, frequency: float, seconds: float, rate: float
) -> Segment:
    """The same sine, rad (m) and Hz, at all joints, faded in and out over one of its periods."""
    level, line = np.full((1, joints), amplitude), np.full((1, joints), frequency)
    shape = waves(level, line, np.zeros((1, joints)), seconds, 1.0 / frequency, rate)
    return Segment(
        f"reversals_{1000 * amplitude:g}_mrad_{frequency:g}_Hz",
        "reversals",
        np.zeros(joints),
        shape,
        amplitude=level[0],
        frequency=(frequency, frequency),
    )


def multisine(
    highest: FloatArray, amplitude: float, seconds: float, rate: float, seed: int
) -> Segment:
    """Sum of sines of random phase from 0.5 Hz up to `highest`, faded in and out over 1 s.

    No line k/T is shared: k ≡ joint modulo the number of joints, so that what one joint does to
    another is apart from its response. All lines have the same velocity. `highest`: (n_joints,) Hz;
    `amplitude`: largest deviation, rad (m).
    """
    joints = len(highest)
    flat = max(seconds - 2.0 * _FADE, 2.0 / LOWEST_LINE)
    # At least two lines for each joint, however slow its loop.
    highest = np.maximum(highest, LOWEST_LINE + 2.0 * joints / flat)
    numbers = np.arange(1, int(highest.max() * flat) + 1)[:, None]
    lines = numbers / flat
    of_joint = numbers % joints == np.arange(joints)
    used = of_joint & (lines >= LOWEST_LINE) & (lines <= highest)
    phase = np.random.default_rng(seed).uniform(0.0, 2.0 * np.pi, used.shape)
    frequency = np.broadcast_to(lines, used.shape)
    level = np.where(used, 1.0 / frequency, 0.0)
    total = flat + 2.0 * _FADE
    shape = waves(level, frequency, phase, total, _FADE, rate)
    return Segment(
        "multisine",
        "multisine",
        np.zeros(joints),
        amplitude / np.abs(shape[0]).max(axis=0) * shape,
        amplitude=np.full(joints, amplitude),
        frequency=(float(lines[used.any(axis=1)].min()), float(highest.max())),
    )


def _phase(seconds: float, rate: float) -> tuple[FloatArray, float]:
    """Progress from 0 up to but without 1, (n_samples, 1), and the seconds it really takes."""
    samples = max(int(np.ceil(seconds * rate - 1e-6)), 2)
    return np.arange(samples)[:, None] / samples, samples / rate
