"""Where the gap lies: its share in parts of the samples, against the share of the samples."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.held_out.time_blocks import interval, resampled, time_blocks
from idim_iv_ros.diagnosis.localisation.residual_split import (
    Axis,
    Split,
    axes_of,
    bands,
    motion_at_rows,
    split,
)
from idim_iv_ros.diagnosis.refit.baseline import Baseline, nominal_residuals
from idim_iv_ros.diagnosis.refit.noise_floor import NoiseFloor
from idim_iv_ros.diagnosis.result import JointGap, Regime, Where
from idim_iv_ros.diagnosis.structural.likelihood import Fit, Regression
from idim_iv_ros.types import FloatArray

_LEAST_OCCUPANCY = 0.005  # of the samples, of a regime
_LEAST_BLOCKS = 5  # of time behind a regime's interval
_LEAST_LIFT = 1.3  # energy share over occupancy from which on a regime is said
_LEAST_ENERGY = 0.2  # of the gap, the same
_NOMINAL_FINDINGS = 3  # at most, about the nominal model
_REFIT_FINDINGS = 2  # at most, about the refit
_REFIT_STRUCTURE = 1.2  # energies of the noise floor from which on the refit's residual is said


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


_UNITS = {
    "speed": "rad/s",
    "direction": "",
    "position": "rad",
    "load": "N m",
    "time": "s",
    "reversal": "rad",
    "frequency": "Hz",
}


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
            if name not in left_out
            and (floor.sigma is None or np.mean(residual**2) > _REFIT_STRUCTURE * floor.sigma**2)
        }
        found = [each for each in found if each.regime.joint in structured]
        findings += found[:_REFIT_FINDINGS]
    return Where(gaps, regimes), tuple(findings)


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
