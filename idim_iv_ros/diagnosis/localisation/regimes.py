"""Regimes: parts of a joint's samples that hold more or less of the gap than their share."""

from collections.abc import Sequence

import numpy as np

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.held_out.time_blocks import interval, resampled
from idim_iv_ros.diagnosis.localisation.residual_split import Split
from idim_iv_ros.diagnosis.result import Regime
from idim_iv_ros.recording import SessionPart, in_recordings
from idim_iv_ros.types import FloatArray


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
    if len(parts.bins) < settings.REGIME_LEAST_BLOCKS:
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
        if occupancy[k] >= settings.LEAST_OCCUPANCY and (limits[k, 0] > 1.0 or limits[k, 1] < 1.0)
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
        if (
            current.lift < settings.FINDING_LEAST_LIFT
            or current.energy_share < settings.FINDING_LEAST_ENERGY
        ):
            continue
        gain = current.energy_share - current.occupancy
        if best is None or gain > best.energy_share - best.occupancy:
            best = current
    return best


def in_words(regime: Regime, edges: FloatArray, session: Sequence[SessionPart]) -> str:
    """One finding, such as "joint_2, below 0.1 rad/s: 61 % of the gap in 9 % of the samples".

    Parameters
    ----------
    edges
        Of all bins of the axis.
    session
        The recordings: a time is that of one of them.
    """
    low, high = f"{regime.low:.2g}", f"{regime.high:.2g} {regime.unit}"
    first, last = regime.low <= edges[0], regime.high >= edges[-1]
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
    what = {"load": "load ", "reversal": "" if first else "displacement since reversal ",
            "frequency": "residual "}.get(regime.axis, "")  # fmt: skip
    whole = "bandwidth" if regime.axis == "frequency" else "samples"
    return (
        f"{regime.joint}, {what}{part}: {100 * regime.energy_share:.0f} % of the gap in "
        f"{100 * regime.occupancy:.0f} % of the {whole}"
    )
