"""Where the gap lies: its share in parts of the samples, against the share of the samples."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from idim_iv_ros.gap.baseline import Baseline
from idim_iv_ros.gap.likelihood import Fit, Regression
from idim_iv_ros.gap.noise_floor import NoiseFloor
from idim_iv_ros.gap.result import JointGap, Regime
from idim_iv_ros.gap.since_reversal import since_reversal
from idim_iv_ros.gap.time_blocks import interval, resampled, time_blocks

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_UNITS = {
    "speed": "rad/s",
    "direction": "",
    "position": "rad",
    "load": "N m",
    "time": "s",
    "reversal": "rad",
    "frequency": "Hz",
}
_LINEAR_UNITS = {"speed": "m/s", "position": "m", "load": "N", "reversal": "m"}
_BANDS = (0.0, 0.1, 0.3, 0.6, 1.0)  # of the band of the rows
_SEGMENT = 1.0  # s
_LEAST_OCCUPANCY = 0.005
# What is worth a sentence.
_LEAST_LIFT, _LEAST_ENERGY = 1.3, 0.2
_GIVEN_FINDINGS, _REFIT_FINDINGS = 3, 2
# The refit explains it all where its residual has less than this energy above the noise.
_STRUCTURE = 1.2


@dataclass(frozen=True)
class Where:
    """Where the gap lies.

    Attributes
    ----------
    joint_gaps : tuple of JointGap
    regimes : tuple of Regime
        Of the given model's gap (of the refit's where no model is given); largest lift first.
    refit_regimes : tuple of Regime
        Of what the refit leaves: these tell of missing effects.
    findings : tuple of str
    """

    joint_gaps: tuple[JointGap, ...]
    regimes: tuple[Regime, ...]
    refit_regimes: tuple[Regime, ...]
    findings: tuple[str, ...]


@dataclass(frozen=True)
class Axis:
    """One way to split the samples of a joint.

    Attributes
    ----------
    name : str
    edges : (k + 1,)
    bins : (b, k, 2)
        Energy and weight (samples, or bandwidth) of each bin in each block of time.
    """

    name: str
    edges: FloatArray
    bins: FloatArray


def given_values(data: Baseline) -> FloatArray | None:
    """Base parameters (b,) of the given model, None where the URDF has no inertials."""
    model = data.prepared.model
    return model.given if model.robot.has_inertials else None


def given_residuals(data: Baseline, regression: Regression) -> tuple[FloatArray, ...] | None:
    """Measured torque less that of the given model: (r_j,) N m (N) of each joint."""
    values = given_values(data)
    if values is None:
        return None
    return tuple(rows.torque - rows.matrix @ values[rows.columns] for rows in regression.joints)


def where(
    data: Baseline, regression: Regression, refit: Fit, floors: Sequence[NoiseFloor]
) -> Where:
    """Find where the gap lies.

    The given model's gap is what the user sees: its shares and regimes are reported. What the
    refit leaves tells of missing effects: where it is above the noise, its findings follow, each
    with "after a refit" in front.
    """
    given = given_residuals(data, regression)
    shown = refit.residuals if given is None else given
    gaps = joint_gaps(data.joints, [rows.torque for rows in regression.joints], shown, floors)
    axes = [_axes(data, regression, joint) for joint in range(len(data.joints))]
    regimes, findings = _described(data, regression, shown, axes, gaps, "")
    findings = findings[:_GIVEN_FINDINGS]
    refit_regimes = regimes
    if given is not None:
        refit_regimes, more = _described(
            data, regression, refit.residuals, axes, gaps, "after a refit, "
        )
        structured = {
            name
            for name, residual, floor in zip(data.joints, refit.residuals, floors, strict=True)
            if floor.sigma is None or np.mean(residual**2) > _STRUCTURE * floor.sigma**2
        }
        more = [one for one in more if any(f"refit, {name}," in one for name in structured)]
        findings = [*findings, *more[:_REFIT_FINDINGS]]
    return Where(gaps, regimes, refit_regimes, tuple(findings))


def joint_gaps(
    joints: Sequence[str],
    torques: Sequence[FloatArray],
    residuals: Sequence[FloatArray],
    floors: Sequence[NoiseFloor],
) -> tuple[JointGap, ...]:
    """RMS, relative size and share of each joint; energies are divided by those of the torque."""
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


def picked(data: Baseline, joint: int, values: Sequence[FloatArray]) -> FloatArray:
    """Values (s,) of each smooth motion at the instants of one joint's rows, (r,)."""
    return data.counting(
        joint,
        [part[motion.decimation.kept] for part, motion in zip(values, data.motions, strict=True)],
    )


def reversal_distances(data: Baseline, joint: int) -> FloatArray:
    """Distance since the last reversal at the rows of one joint, (r,) rad (m)."""
    slowest = 0.3 * float(data.slowest[joint])
    return picked(
        data,
        joint,
        [since_reversal(m.position[:, joint], m.velocity[:, joint], slowest) for m in data.motions],
    )


def _axes(
    data: Baseline, regression: Regression, joint: int
) -> list[tuple[str, FloatArray, FloatArray]]:
    """Name, value at each row and edges of every way to split one joint's samples."""
    speed = picked(data, joint, [m.velocity[:, joint] for m in data.motions])
    position = picked(data, joint, [m.position[:, joint] for m in data.motions])
    load = np.abs(picked(data, joint, [m.load[:, joint] for m in data.motions]))
    time = picked(data, joint, [m.time for m in data.motions])
    distance = reversal_distances(data, joint)
    quantile = np.linspace(0.0, 1.0, 6)
    return [
        ("speed", np.abs(speed), _logarithmic(np.abs(speed), 6)),
        ("direction", np.sign(speed) * 0.5, np.array([-1.0, 0.0, 1.0])),
        ("position", position, np.linspace(position.min(), position.max(), 9)),
        ("load", load, np.quantile(load, quantile)),
        ("time", time, np.quantile(time, np.linspace(0.0, 1.0, 7))),
        ("reversal", distance, _logarithmic(distance, 6)),
    ]


def _logarithmic(values: FloatArray, count: int) -> FloatArray:
    low, high = max(float(np.quantile(values, 0.01)), 1e-9), float(values.max())
    if high <= 1.01 * low:
        return np.array([0.0, max(high, 1e-9)])
    edges = np.geomspace(low, high, count + 1)
    edges[0] = min(float(values.min()), low)
    return np.asarray(edges)


def split(
    name: str, values: FloatArray, edges: FloatArray, residual: FloatArray, blocks: IntArray
) -> Axis:
    """Energy and samples of each bin of an axis in each block of time."""
    count = len(edges) - 1
    bins = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, count - 1)
    _, block = np.unique(blocks, return_inverse=True)
    place = block * count + bins
    size = (int(block.max()) + 1) * count
    energy = np.bincount(place, weights=residual**2, minlength=size)
    samples = np.bincount(place, minlength=size).astype(float)
    return Axis(name, edges, np.stack([energy, samples], axis=1).reshape(-1, count, 2))


def bands(residual: FloatArray, runs: Sequence[slice], row_rate: float, edge: float) -> Axis | None:
    """Energy of a residual in bands of frequency, from stretches of a second; weight: bandwidth."""
    length = int(_SEGMENT * row_rate)
    if length < 16:
        return None
    pieces = [
        residual[start : start + length]
        for run in runs
        for start in range(run.start, run.stop - length + 1, length)
    ]
    if len(pieces) < 5:
        return None
    window = np.hanning(length)
    power = np.abs(np.fft.rfft(np.array(pieces) * window, axis=1)) ** 2
    frequency = np.fft.rfftfreq(length, 1.0 / row_rate)
    edges = np.array(_BANDS) * 0.5 * edge * row_rate
    # A line of the spectrum stands for half a line on either side of it.
    line = frequency[1]
    bins = np.zeros((len(pieces), len(edges) - 1, 2))
    for k in range(len(edges) - 1):
        low, high = frequency - 0.5 * line, frequency + 0.5 * line
        inside = np.maximum(
            np.minimum(high, edges[k + 1]) - np.maximum(np.maximum(low, 0.0), edges[k]), 0.0
        )
        bins[:, k, 0] = power @ (inside / line)
        bins[:, k, 1] = inside.sum()
    return Axis("frequency", edges, bins)


def lifts(axis: Axis) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Energy share, occupancy and lift (k,) of each bin, and the lift's interval (k, 2)."""
    total = axis.bins.sum(axis=0)
    share = total / np.maximum(total.sum(axis=0), 1e-300)
    draws = resampled(axis.bins)
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


def _described(
    data: Baseline,
    regression: Regression,
    residuals: Sequence[FloatArray],
    axes: Sequence[Sequence[tuple[str, FloatArray, FloatArray]]],
    gaps: Sequence[JointGap],
    prefix: str,
) -> tuple[tuple[Regime, ...], list[str]]:
    """Regimes whose interval excludes 1, and sentences, the most telling first."""
    regimes: list[Regime] = []
    sentences: list[tuple[float, str]] = []
    edge = data.prepared.motions[0].decimation.edge
    for joint, name in enumerate(data.joints):
        residual = residuals[joint]
        linear = data.prepared.model.robot.joint_types[joint] == "prismatic"
        units = _UNITS | (_LINEAR_UNITS if linear else {})
        blocks = time_blocks(data.recordings[joint], data.places[joint], data.row_rate)
        splits = [split(*axis, residual, blocks) for axis in axes[joint]]
        spectrum = bands(residual, regression.joints[joint].runs, data.row_rate, edge)
        for axis in [*splits, *([] if spectrum is None else [spectrum])]:
            found = axis_regimes(name, axis, units[axis.name])
            regimes += found
            best = joined(found)
            # Most of what moves slowly is slow: not worth a word.
            slow = best is not None and axis.name == "frequency" and best.low <= 0.0
            if best is not None and not slow:
                weight = (best.energy_share - best.occupancy) * gaps[joint].share
                sentences.append((weight, prefix + in_words(best, axis.edges)))
    regimes.sort(key=lambda regime: -regime.lift)
    sentences.sort(key=lambda sentence: -sentence[0])
    return tuple(regimes), [sentence for _, sentence in sentences]


def axis_regimes(joint: str, axis: Axis, unit: str) -> list[Regime]:
    """Bins of one axis whose lift differs from 1."""
    if len(axis.bins) < 5:
        return []
    energy, occupancy, lift, limits = lifts(axis)
    return [
        Regime(
            joint=joint,
            axis=axis.name,
            low=float(axis.edges[k]),
            high=float(axis.edges[k + 1]),
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
    """Most telling stretch of adjacent high bins of one axis, None where none is worth a word."""
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


def in_words(regime: Regime, edges: FloatArray) -> str:
    """One finding, such as "joint_2, below 0.1 rad/s: 61 % of the gap in 9 % of the samples"."""
    low, high = f"{regime.low:.2g}", f"{regime.high:.2g} {regime.unit}"
    first, last = regime.low <= edges[0], regime.high >= edges[-1]
    part = f"between {low} and {high}"
    if regime.axis == "direction":
        part = f"moving in the {'negative' if regime.high <= 0.0 else 'positive'} direction"
    elif regime.axis == "reversal" and first:
        part = f"within {high} after a reversal"
    elif regime.axis == "time":
        part = f"from {low} to {high} of the session"
    elif first and regime.axis != "position":
        part = f"below {high}"
    elif last and regime.axis != "position":
        part = f"above {low} {regime.unit}"
    what = {"load": "load ", "reversal": "" if first else "displacement since reversal ",
            "frequency": "residual "}.get(regime.axis, "")  # fmt: skip
    whole = "bandwidth" if regime.axis == "frequency" else "samples"
    return (
        f"{regime.joint}, {what}{part}: {100 * regime.energy_share:.0f} % of the gap in "
        f"{100 * regime.occupancy:.0f} % of the {whole}"
    )
