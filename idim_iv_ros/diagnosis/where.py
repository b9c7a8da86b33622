"""Where the gap lies: its share in parts of the samples, against the share of the samples."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.refit.baseline import Baseline, nominal_residuals
from idim_iv_ros.diagnosis.refit.held_out import row_blocks
from idim_iv_ros.diagnosis.refit.noise_floor import NoiseFloor
from idim_iv_ros.diagnosis.result.document import JointGap, Regime, Where
from idim_iv_ros.estimation.likelihood import rms
from idim_iv_ros.recording.recording import SessionPart, in_recordings
from idim_iv_ros.statistics.bootstrap import block_sums, interval, resampled
from idim_iv_ros.types import FloatArray, IntArray

_LEAST_OCCUPANCY = 0.005  # of the samples, of a regime
_LEAST_BLOCKS = 5  # of time behind a regime's interval
_LEAST_LIFT = 1.3  # energy share over occupancy from which on a regime is said
_LEAST_ENERGY = 0.2  # of the gap, the same
_NOMINAL_FINDINGS = 3  # at most, about the nominal model
_REFIT_FINDINGS = 2  # at most, about the refit


def since_reversal(position: FloatArray, velocity: FloatArray, slowest: float) -> FloatArray:
    """Path since the last reversal (since the start, before the first): (s,) rad (m).

    `position`, `velocity`: (s,) rad, rad/s; `slowest`: a joint has turned once it is faster than
    this the other way: noise does not turn it.
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


def motion_at_rows(data: Baseline, joint: int) -> dict[str, FloatArray]:
    """Smooth motion of one joint at the rows (r,) that count, over all recordings.

    By name: ``time`` (s), ``position`` (rad, m), ``speed``, ``load``, the torque of the rigid
    bodies alone (N m, N), and ``since_reversal``, the distance since the last one (rad, m).
    """
    slowest = settings.REVERSAL_SPEED * data.covered[joint].slowest
    tables = []
    for motion in data.motions:
        states = motion.position[:, joint], motion.velocity[:, joint]
        values = (motion.time, *states, motion.load[:, joint], since_reversal(*states, slowest))
        tables.append(np.column_stack(values)[motion.decimation.kept])
    names = ("time", "position", "speed", "load", "since_reversal")
    return dict(zip(names, data.counting(joint, tables).T, strict=True))


@dataclass(frozen=True)
class Axis:
    """A quantity by which the energy of a joint's residual is split."""

    name: str
    values: FloatArray  # (r,) at each row
    edges: FloatArray  # (k + 1,)
    unit: str = ""  # of both, of a joint that turns


def axes_of(motion: Mapping[str, FloatArray], starts: Sequence[float]) -> list[Axis]:
    """Every quantity of a joint's motion (`motion_at_rows`) by which its samples are split.

    `starts`: of the recordings in the time of the session, s.
    """
    time, position, distance = motion["time"], motion["position"], motion["since_reversal"]
    speed, load = np.abs(motion["speed"]), np.abs(motion["load"])
    # About six stretches with as many samples each; none holds parts of two recordings.
    recording = np.searchsorted(starts, time, side="right") - 1
    stretches: list[float] = []
    for number in np.unique(recording):
        inside = time[recording == number]
        bins = max(1, round(6 * len(inside) / len(time)))
        stretches.append(starts[int(number)] if stretches else float(inside.min()))
        stretches += np.quantile(inside, np.linspace(0.0, 1.0, bins + 1))[1:-1].tolist()
    return [
        Axis("speed", speed, _logarithmic(speed, 6), "rad/s"),
        Axis("direction", np.sign(motion["speed"]) * 0.5, np.array([-1.0, 0.0, 1.0])),
        Axis("position", position, np.linspace(position.min(), position.max(), 9), "rad"),
        Axis("load", load, np.quantile(load, np.linspace(0.0, 1.0, 6)), "N m"),
        Axis("time", time, np.array([*stretches, time.max()]), "s"),
        Axis("reversal", distance, _logarithmic(distance, 6), "rad"),
    ]


def _logarithmic(values: FloatArray, count: int) -> FloatArray:
    low, high = max(float(np.quantile(values, 0.01)), 1e-9), float(values.max())
    if high <= 1.01 * low:
        return np.array([0.0, max(high, 1e-9)])
    return np.array([min(float(values.min()), low), *np.geomspace(low, high, count + 1)[1:]])


def split(axis: Axis, energy: FloatArray, blocks: IntArray) -> FloatArray:
    """Energy and number of the values of an axis in each bin and block of time: (b, k, 2).

    `energy`: (r,) of the residual at each value, (N m)² (N²); `blocks`: (r,) block of each value
    (`time_blocks`).
    """
    bins = np.searchsorted(axis.edges[1:-1], axis.values, side="right")
    inside = bins[:, None] == np.arange(len(axis.edges) - 1)
    return block_sums(blocks, np.stack([inside * energy[:, None], inside], axis=2))


def lifts(bins: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Energy share, occupancy, lift (k,) and its interval (k, 2) of the bins of `split`.

    The lift is the share of the residual's energy over the share of the samples in a bin.
    """
    total = bins.sum(axis=0)
    energy, occupancy = (total / np.maximum(total.sum(axis=0), 1e-300)).T
    draws = resampled(bins)
    shares = draws / np.maximum(draws.sum(axis=1, keepdims=True), 1e-300)
    limits = np.tile([0.0, np.inf], (len(total), 1))
    for k, (of_energy, of_samples) in enumerate(shares.transpose(1, 2, 0)):
        drawn = of_samples > 0.0
        if drawn.any():
            limits[k] = interval(of_energy[drawn] / of_samples[drawn])
    return energy, occupancy, energy / np.maximum(occupancy, 1e-12), limits


def regimes_of(joint: str, axis: Axis, bins: FloatArray, unit: str) -> list[Regime]:
    """Bins of one axis whose lift differs from 1; `unit` is that of its edges."""
    if len(bins) < _LEAST_BLOCKS:
        return []
    table = np.column_stack([axis.edges[:-1], axis.edges[1:], *lifts(bins)]).tolist()
    return [
        Regime(joint, axis.name, low, high, unit, energy, occupancy, lift, (least, most))
        for low, high, energy, occupancy, lift, least, most in table
        if occupancy >= _LEAST_OCCUPANCY and (least > 1.0 or most < 1.0)
    ]


def joined(regimes: Sequence[Regime]) -> Regime | None:
    """Adjacent high bins of one axis with the largest excess of the gap; None where it is small."""
    runs: list[Regime] = []
    for regime in regimes:
        if regime.lift <= 1.0:
            continue
        if runs and runs[-1].high == regime.low:
            energy = runs[-1].energy_share + regime.energy_share
            occupancy = runs[-1].occupancy + regime.occupancy
            both = replace(regime, low=runs[-1].low, energy_share=energy, occupancy=occupancy)
            regime = replace(both, lift=energy / occupancy, ci95=None)
        runs.append(regime)
    large = [run for run in runs if run.lift >= _LEAST_LIFT and run.energy_share >= _LEAST_ENERGY]
    return max(large, key=lambda run: run.energy_share - run.occupancy, default=None)


def in_words(
    regime: Regime,
    edges: FloatArray,
    session: Sequence[SessionPart] = (),
    *,
    after_refit: bool = False,
) -> str:
    """Say a regime, such as "joint_2, below 0.1 rad/s: 61 % of the gap in 9 % of the samples".

    `edges`: of its axis; `session`: the recordings: a time is that of one of them.
    """
    first, last = regime.low <= edges[0], regime.high >= edges[-1]
    low, high = f"{regime.low:.2g}", f"{regime.high:.2g} {regime.unit}"
    part = f"between {low} and {high}"
    if regime.axis == "direction":
        part = f"moving in the {'negative' if regime.high <= 0.0 else 'positive'} direction"
    elif regime.axis == "reversal" and first:
        part = f"within {high} after a reversal"
    elif regime.axis == "time":
        part = f"from {in_recordings(session, regime.low, regime.high)}"
    elif first and regime.axis != "position":
        part = f"below {high}"
    elif last and regime.axis != "position":
        part = f"above {low} {regime.unit}"
    what = {"load": "load ", "reversal": "" if first else "displacement since reversal "}
    model = "after a refit, " if after_refit else ""
    return (
        f"{model}{regime.joint}, {what.get(regime.axis, '')}{part}: "
        f"{100 * regime.energy_share:.0f} % of the gap in {100 * regime.occupancy:.0f} % of the "
        "samples"
    )


def where(data: Baseline, floors: Sequence[NoiseFloor]) -> tuple[Where, tuple[str, ...]]:
    """Find where the gap lies, and say in which regimes much of it does, the largest first.

    The nominal model's gap is what the user sees: its shares and regimes are reported, those of the
    refit where no model is given. The residual of the refit shows missing effects: findings about
    it follow where it is above the noise. Shares of joints are those of what lies beyond the noise,
    energies divided by those of the torque.
    """
    nominal, residuals = nominal_residuals(data), data.regression.fitted.residuals
    shown, whole = residuals if nominal is None else nominal, data.torque_sizes
    sizes = np.array([rms(residual) for residual in shown])
    noise = np.array([floor.sigma or 0.0 for floor in floors])
    beyond = np.maximum(sizes**2 - noise**2, 0.0) / whole**2
    shares = beyond / max(float(np.sum(beyond)), 1e-300)
    table = np.column_stack([sizes, 100.0 * (sizes / whole), shares]).tolist()
    gaps = tuple(
        JointGap(name, size, percent if said else None, share, floor.sigma, floor.origin)
        for name, (size, percent, share), said, floor in zip(
            data.joints, table, whole > 1e-300, floors, strict=True
        )
    )
    starts, joints = [part.start for part in data.prepared.session.parts], range(len(data.joints))
    axes = [axes_of(motion_at_rows(data, joint), starts) for joint in joints]
    used = set(joints) - data.left_out
    regimes, large = _regimes(data, shown, axes, shares, used, after_refit=False)
    findings = large[:_NOMINAL_FINDINGS]
    if nominal is not None:
        used = {joint for joint in used if above_noise(residuals[joint], floors[joint])}
        _, large = _regimes(data, residuals, axes, shares, used, after_refit=True)
        findings += large[:_REFIT_FINDINGS]
    return Where(gaps, regimes), tuple(findings)


def above_noise(residual: FloatArray, floor: NoiseFloor) -> bool:
    """Whether a joint's residual (r,) holds more than noise; so does one whose noise is unknown."""
    if floor.sigma is None:
        return True
    return float(np.mean(residual**2)) > settings.STRUCTURE_OVER_NOISE * floor.sigma**2


def _regimes(
    data: Baseline,
    residuals: Sequence[FloatArray],
    axes: Sequence[Sequence[Axis]],
    shares: FloatArray,
    used: Collection[int],
    *,
    after_refit: bool,
) -> tuple[tuple[Regime, ...], list[str]]:
    """Regimes whose interval excludes 1, and sentences of the joints `used`, the largest first."""
    regimes: list[Regime] = []
    findings: list[tuple[float, str]] = []
    # A twentieth of the session: regimes may be events, and residuals are predictable for a while.
    rows, parts = sum(len(motion.kept) for motion in data.motions), data.prepared.session.parts
    length = np.clip(rows / data.row_rate / 20, settings.LEAST_TIME_BLOCK, settings.TIME_BLOCK)
    blocks = row_blocks(data, float(length))
    for joint, name in enumerate(data.joints):
        for axis in axes[joint]:
            bins = split(axis, residuals[joint] ** 2, blocks[joint])
            unlike = regimes_of(name, axis, bins, data.unit_at(joint, axis.unit))
            regimes += unlike
            best = joined(unlike)
            if best is not None and joint in used:
                excess = (best.energy_share - best.occupancy) * float(shares[joint])
                said = in_words(best, axis.edges, parts, after_refit=after_refit)
                findings.append((excess, said))
    regimes.sort(key=lambda regime: -regime.lift)
    findings.sort(key=lambda finding: -finding[0])
    return tuple(regimes), [said for _, said in findings]
