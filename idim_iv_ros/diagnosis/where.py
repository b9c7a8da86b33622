"""Where the gap lies: its share in parts of the samples, against the share of the samples."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.likelihood import Fit, Regression
from idim_iv_ros.diagnosis.refit.baseline import Baseline, nominal_residuals
from idim_iv_ros.diagnosis.refit.held_out import interval, resampled, time_blocks
from idim_iv_ros.diagnosis.refit.noise_floor import NoiseFloor
from idim_iv_ros.diagnosis.result import JointGap, Regime, Where
from idim_iv_ros.types import FloatArray, IntArray

_BANDS = (0.0, 0.1, 0.3, 0.6, 1.0)  # of the band of the rows
_LEAST_OCCUPANCY = 0.005  # of the samples, of a regime
_LEAST_BLOCKS = 5  # of time behind a regime's interval
_LEAST_LIFT = 1.3  # energy share over occupancy from which on a regime is said
_LEAST_ENERGY = 0.2  # of the gap, the same
_NOMINAL_FINDINGS = 3  # at most, about the nominal model
_REFIT_FINDINGS = 2  # at most, about the refit
_UNITS = {
    "speed": "rad/s",
    "direction": "",
    "position": "rad",
    "load": "N m",
    "time": "s",
    "reversal": "rad",
    "frequency": "Hz",
}

_LEAST_PIECE = 16  # rows of a piece of a residual's spectrum


def since_reversal(position: FloatArray, velocity: FloatArray, slowest: float) -> FloatArray:
    """Path since the last reversal (since the start, before the first): (s,) rad (m).

    Parameters
    ----------
    position, velocity
        (s,) rad, rad/s.
    slowest
        A joint has turned once it is faster than this the other way: noise does not turn it.
    """
    path = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(position)))])
    ways = np.where(np.abs(velocity) >= slowest, np.sign(velocity), 0.0)
    moving = np.flatnonzero(ways)
    turned = moving[1:][np.diff(ways[moving]) != 0.0]
    # The joint stood at its turning point when the speed crossed zero, a little before.
    crossing = np.flatnonzero(np.diff(np.sign(velocity)) != 0.0) + 1
    if len(crossing) and len(turned):
        turned = crossing[np.maximum(np.searchsorted(crossing, turned, side="right") - 1, 0)]
    starts = np.concatenate([[0], turned]).astype(np.int64)
    last = starts[np.searchsorted(starts, np.arange(len(position)), side="right") - 1]
    return np.asarray(path - path[last])


@dataclass(frozen=True)
class MotionAtRows:
    """What one joint does at its rows, over all recordings; (r,) each.

    Attributes
    ----------
    time : s
    position, velocity : rad, rad/s (m, m/s)
    load : N m (N)
        Torque of the rigid bodies alone.
    since_reversal : rad (m)
        Distance since the last reversal.
    """

    time: FloatArray
    position: FloatArray
    velocity: FloatArray
    load: FloatArray
    since_reversal: FloatArray


def motion_at_rows(data: Baseline, joint: int) -> MotionAtRows:
    """Take the smooth motion of one joint at the rows that count."""
    motions = data.motions
    slowest = settings.REVERSAL_SPEED * float(data.slowest[joint])

    def at_rows(values: Sequence[FloatArray]) -> FloatArray:
        kept = [part[motion.decimation.kept] for part, motion in zip(values, motions, strict=True)]
        return data.counting(joint, kept)

    return MotionAtRows(
        time=at_rows([motion.time for motion in motions]),
        position=at_rows([motion.position[:, joint] for motion in motions]),
        velocity=at_rows([motion.velocity[:, joint] for motion in motions]),
        load=at_rows([motion.load[:, joint] for motion in motions]),
        since_reversal=at_rows(
            [
                since_reversal(motion.position[:, joint], motion.velocity[:, joint], slowest)
                for motion in motions
            ]
        ),
    )


@dataclass(frozen=True)
class Axis:
    """A quantity by which the samples of a joint are split.

    Attributes
    ----------
    name : str
    values : (r,)
        At each row.
    edges : (k + 1,)
    """

    name: str
    values: FloatArray
    edges: FloatArray


@dataclass(frozen=True)
class Split:
    """Energy of one joint's residual, split along one axis.

    Attributes
    ----------
    name : str
        Of the axis.
    edges : (k + 1,)
    bins : (b, k, 2)
        Energy and weight (samples, or bandwidth) of each bin in each block of time.
    """

    name: str
    edges: FloatArray
    bins: FloatArray


def axes_of(motion: MotionAtRows, starts: Sequence[float]) -> list[Axis]:
    """Every quantity of a joint's motion by which its samples are split.

    Parameters
    ----------
    starts
        Of the recordings in the time of the session, s.
    """
    speed, load = np.abs(motion.velocity), np.abs(motion.load)
    position, time, distance = motion.position, motion.time, motion.since_reversal
    return [
        Axis("speed", speed, _logarithmic(speed, 6)),
        Axis("direction", np.sign(motion.velocity) * 0.5, np.array([-1.0, 0.0, 1.0])),
        Axis("position", position, np.linspace(position.min(), position.max(), 9)),
        Axis("load", load, np.quantile(load, np.linspace(0.0, 1.0, 6))),
        Axis("time", time, _in_recordings(time, starts, 6)),
        Axis("reversal", distance, _logarithmic(distance, 6)),
    ]


def _in_recordings(time: FloatArray, starts: Sequence[float], count: int) -> FloatArray:
    """Edges of about `count` bins with as many samples each; none holds parts of two recordings.

    Where there are as many recordings as bins, a bin holds whole ones.
    """
    recording = np.searchsorted(starts, time, side="right") - 1
    samples = np.bincount(recording, minlength=len(starts))
    used = np.flatnonzero(samples)
    if len(used) >= count:
        before = np.cumsum(samples[used]) - samples[used]
        _, firsts = np.unique(before * count // len(time), return_index=True)
        inner = [starts[int(used[first])] for first in firsts[1:]]
        return np.array([time.min(), *inner, time.max()])
    edges: list[float] = []
    for which in used:
        bins = max(1, round(count * samples[which] / len(time)))
        own = np.quantile(time[recording == which], np.linspace(0.0, 1.0, bins + 1))
        first = float(own[0]) if not edges else starts[int(which)]
        edges += [first, *own[1:-1].tolist()]
    return np.array([*edges, time.max()])


def _logarithmic(values: FloatArray, count: int) -> FloatArray:
    low, high = max(float(np.quantile(values, 0.01)), 1e-9), float(values.max())
    if high <= 1.01 * low:
        return np.array([0.0, max(high, 1e-9)])
    edges = np.geomspace(low, high, count + 1)
    edges[0] = min(float(values.min()), low)
    return np.asarray(edges)


def split(axis: Axis, residual: FloatArray, blocks: IntArray) -> Split:
    """Energy and samples of each bin of an axis in each block of time.

    Parameters
    ----------
    residual
        (r,) N m (N).
    blocks
        (r,) block of each row (`time_blocks`).
    """
    count = len(axis.edges) - 1
    bins = np.clip(np.searchsorted(axis.edges, axis.values, side="right") - 1, 0, count - 1)
    _, block = np.unique(blocks, return_inverse=True)
    place = block * count + bins
    size = (int(block.max()) + 1) * count
    energy = np.bincount(place, weights=residual**2, minlength=size)
    samples = np.bincount(place, minlength=size).astype(float)
    return Split(axis.name, axis.edges, np.stack([energy, samples], axis=1).reshape(-1, count, 2))


def bands(
    residual: FloatArray, runs: Sequence[slice], row_rate: float, edge: float
) -> Split | None:
    """Energy of a residual in bands of frequency, from stretches of a second; weight: bandwidth.

    None where there are too few stretches.

    Parameters
    ----------
    residual
        (r,) N m (N).
    runs
        Rows without a gap in time.
    row_rate
        Hz.
    edge
        Share of the rows' Nyquist frequency that the decimation passes.
    """
    length = int(settings.LEAST_TIME_BLOCK * row_rate)
    if length < _LEAST_PIECE:
        return None
    pieces = [
        residual[start : start + length]
        for run in runs
        for start in range(run.start, run.stop - length + 1, length)
    ]
    if not pieces:
        return None
    window = np.hanning(length)
    power = np.abs(np.fft.rfft(np.array(pieces) * window, axis=1)) ** 2
    frequency = np.fft.rfftfreq(length, 1.0 / row_rate)
    edges = np.array(_BANDS) * 0.5 * edge * row_rate
    # A line of the spectrum covers half a line on either side of it.
    line = frequency[1]
    bins = np.zeros((len(pieces), len(edges) - 1, 2))
    for k in range(len(edges) - 1):
        low, high = frequency - 0.5 * line, frequency + 0.5 * line
        inside = np.maximum(
            np.minimum(high, edges[k + 1]) - np.maximum(np.maximum(low, 0.0), edges[k]), 0.0
        )
        bins[:, k, 0] = power @ (inside / line)
        bins[:, k, 1] = inside.sum()
    return Split("frequency", edges, bins)


def joint_gaps(
    joints: Sequence[str],
    torques: Sequence[FloatArray],
    residuals: Sequence[FloatArray],
    floors: Sequence[NoiseFloor],
) -> tuple[JointGap, ...]:
    """RMS, relative size and share of each joint; energies are divided by those of the torque.

    Parameters
    ----------
    joints
        Names.
    torques, residuals
        (r_j,) N m (N) of each joint.
    floors
    """
    energy = [float(residual @ residual) for residual in residuals]
    whole = [float(torque @ torque) for torque in torques]
    relative = np.array([e / w if w > 0.0 else 0.0 for e, w in zip(energy, whole, strict=True)])
    total = float(relative.sum())
    return tuple(
        JointGap(
            joint=name,
            rms=float(np.sqrt(energy[j] / max(len(residuals[j]), 1))),
            relative_percent=100.0 * float(np.sqrt(relative[j])) if whole[j] > 0.0 else None,
            share=float(relative[j] / total) if total > 0.0 else 0.0,
            noise_floor=floors[j].sigma,
            floor_origin=floors[j].origin,
        )
        for j, name in enumerate(joints)
    )


def lifts(parts: Split) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Energy share, occupancy and lift (k,) of each bin, and the lift's interval (k, 2)."""
    total = parts.bins.sum(axis=0)
    share = total / np.maximum(total.sum(axis=0), 1e-300)
    draws = resampled(parts.bins)
    shares = draws / np.maximum(draws.sum(axis=1, keepdims=True), 1e-300)
    ratio = shares[:, :, 0] / np.maximum(shares[:, :, 1], 1e-12)
    usable = shares[:, :, 1] > 0.0
    limits = np.array(
        [
            interval(ratio[usable[:, k], k]) if usable[:, k].any() else (0.0, np.inf)
            for k in range(ratio.shape[1])
        ]
    )
    lift = share[:, 0] / np.maximum(share[:, 1], 1e-12)
    return share[:, 0], share[:, 1], lift, limits


def regimes_of(joint: str, parts: Split, unit: str) -> list[Regime]:
    """Bins of one axis whose lift differs from 1; `unit` is that of its edges."""
    if len(parts.bins) < _LEAST_BLOCKS:
        return []
    energy, occupancy, lift, limits = lifts(parts)
    return [
        Regime(
            joint=joint,
            axis=parts.name,
            low=float(parts.edges[k]),
            high=float(parts.edges[k + 1]),
            unit=unit,
            energy_share=float(energy[k]),
            occupancy=float(occupancy[k]),
            lift=float(lift[k]),
            ci95=(float(limits[k, 0]), float(limits[k, 1])),
        )
        for k in range(len(lift))
        if occupancy[k] >= _LEAST_OCCUPANCY and (limits[k, 0] > 1.0 or limits[k, 1] < 1.0)
    ]


def joined(regimes: Sequence[Regime]) -> Regime | None:
    """Adjacent high bins of one axis with the largest excess of the gap; None where it is small."""
    best: Regime | None = None
    current: Regime | None = None
    for regime in regimes:
        if regime.lift <= 1.0:
            continue
        if current is not None and current.high == regime.low:
            energy = current.energy_share + regime.energy_share
            occupancy = current.occupancy + regime.occupancy
            current = Regime(
                current.joint, current.axis, current.low, regime.high, current.unit,
                energy, occupancy, energy / occupancy, None,
            )  # fmt: skip
        else:
            current = regime
        if current.lift < _LEAST_LIFT or current.energy_share < _LEAST_ENERGY:
            continue
        gain = current.energy_share - current.occupancy
        if best is None or gain > best.energy_share - best.occupancy:
            best = current
    return best


@dataclass(frozen=True)
class Finding:
    """A regime, or adjacent ones, in which much of the gap lies.

    Attributes
    ----------
    regime : Regime
    first, last : bool
        Whether it begins or ends where the axis does.
    after_refit : bool
        Whether the gap is that of the refit.
    excess : float
        Energy share less occupancy, times the joint's share of the whole gap.
    """

    regime: Regime
    first: bool
    last: bool
    after_refit: bool
    excess: float


def where(
    data: Baseline, regression: Regression, refit: Fit, floors: Sequence[NoiseFloor]
) -> tuple[Where, tuple[Finding, ...]]:
    """Find where the gap lies, and in which regimes much of it, the largest first.

    The nominal model's gap is what the user sees: its shares and regimes are reported, those of the
    refit where no model is given. The residual of the refit shows missing effects: findings about
    it follow where it is above the noise.
    """
    nominal = nominal_residuals(data, regression)
    shown = refit.residuals if nominal is None else nominal
    left_out = {data.joints[joint] for joint in data.left_out}
    gaps = joint_gaps(data.joints, [rows.torque for rows in regression.joints], shown, floors)
    starts = [part.start for part in data.prepared.session.parts]
    axes = [axes_of(motion_at_rows(data, joint), starts) for joint in range(len(data.joints))]
    regimes, found = _regimes(data, regression, shown, axes, gaps, after_refit=False)
    found = [each for each in found if each.regime.joint not in left_out]
    findings = found[:_NOMINAL_FINDINGS]
    if nominal is not None:
        _, found = _regimes(data, regression, refit.residuals, axes, gaps, after_refit=True)
        structured = {
            name
            for name, residual, floor in zip(data.joints, refit.residuals, floors, strict=True)
            if name not in left_out and above_noise(residual, floor)
        }
        found = [each for each in found if each.regime.joint in structured]
        findings += found[:_REFIT_FINDINGS]
    return Where(gaps, regimes), tuple(findings)


def above_noise(residual: FloatArray, floor: NoiseFloor) -> bool:
    """Whether a joint's residual (r,) holds more than noise; so does one whose noise is unknown."""
    if floor.sigma is None:
        return True
    return float(np.mean(residual**2)) > settings.STRUCTURE_OVER_NOISE * floor.sigma**2


def _regimes(
    data: Baseline,
    regression: Regression,
    residuals: Sequence[FloatArray],
    axes: Sequence[Sequence[Axis]],
    gaps: Sequence[JointGap],
    *,
    after_refit: bool,
) -> tuple[tuple[Regime, ...], list[Finding]]:
    """Regimes whose interval excludes 1, and findings, the largest first."""
    regimes: list[Regime] = []
    findings: list[Finding] = []
    edge = data.prepared.configuration.processing.decimation_edge
    for joint, name in enumerate(data.joints):
        residual = residuals[joint]
        # Regimes may be events: blocks of the shortest length.
        blocks = time_blocks(
            data.recordings[joint], data.places[joint], data.row_rate, settings.LEAST_TIME_BLOCK
        )
        splits = [split(axis, residual, blocks) for axis in axes[joint]]
        spectrum = bands(residual, regression.joints[joint].segments, data.row_rate, edge)
        for parts in [*splits, *([] if spectrum is None else [spectrum])]:
            found = regimes_of(name, parts, data.unit_at(joint, _UNITS[parts.name]))
            regimes += found
            best = joined(found)
            # Most of what moves slowly is slow: no finding.
            if best is None or (parts.name == "frequency" and best.low <= 0.0):
                continue
            excess = (best.energy_share - best.occupancy) * gaps[joint].share
            ends = ends_of(best, parts.edges)
            findings.append(Finding(best, *ends, after_refit, excess))
    regimes.sort(key=lambda regime: -regime.lift)
    findings.sort(key=lambda each: -each.excess)
    return tuple(regimes), findings


def ends_of(regime: Regime, edges: FloatArray) -> tuple[bool, bool]:
    """Whether a regime begins, and ends, where the axis with these edges does."""
    return bool(regime.low <= edges[0]), bool(regime.high >= edges[-1])
