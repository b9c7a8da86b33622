"""Where the gap lies: its share in parts of the samples, against the share of the samples."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.held_out.time_blocks import time_blocks
from idim_iv_ros.diagnosis.joint_units import unit_at
from idim_iv_ros.diagnosis.localisation.joint_gaps import joint_gaps
from idim_iv_ros.diagnosis.localisation.regimes import in_words, joined, regimes_of
from idim_iv_ros.diagnosis.localisation.residual_split import Axis, axes_of, bands, split
from idim_iv_ros.diagnosis.refit.baseline import Baseline
from idim_iv_ros.diagnosis.refit.motion_at_rows import motion_at_rows
from idim_iv_ros.diagnosis.refit.noise_floor import NoiseFloor
from idim_iv_ros.diagnosis.refit.nominal_model import nominal_residuals
from idim_iv_ros.diagnosis.result import JointGap, Regime
from idim_iv_ros.diagnosis.structural.likelihood import Fit, Regression
from idim_iv_ros.types import FloatArray

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
class Where:
    """Where the gap lies.

    Attributes
    ----------
    joint_gaps : tuple of JointGap
    regimes : tuple of Regime
        Of the nominal model's gap (of the refit's where no model is given); largest lift first.
    findings : tuple of str
        The most telling regimes in words, those of what the refit leaves last.
    """

    joint_gaps: tuple[JointGap, ...]
    regimes: tuple[Regime, ...]
    findings: tuple[str, ...]


def where(
    data: Baseline, regression: Regression, refit: Fit, floors: Sequence[NoiseFloor]
) -> Where:
    """Find where the gap lies.

    The nominal model's gap is what the user sees: its shares and regimes are reported. What the
    refit leaves tells of missing effects: where it is above the noise, its findings follow, each
    with "after a refit" in front.
    """
    given = nominal_residuals(data, regression)
    shown = refit.residuals if given is None else given
    gaps = joint_gaps(data.joints, [rows.torque for rows in regression.joints], shown, floors)
    starts = [part.start for part in data.prepared.session.parts]
    axes = [axes_of(motion_at_rows(data, joint), starts) for joint in range(len(data.joints))]
    regimes, findings = _described(data, regression, shown, axes, gaps, "")
    findings = findings[: settings.NOMINAL_FINDINGS]
    if given is not None:
        _, more = _described(data, regression, refit.residuals, axes, gaps, "after a refit, ")
        structured = {
            name
            for name, residual, floor in zip(data.joints, refit.residuals, floors, strict=True)
            if floor.sigma is None
            or np.mean(residual**2) > settings.REFIT_STRUCTURE * floor.sigma**2
        }
        more = [one for one in more if any(f"refit, {name}," in one for name in structured)]
        findings = [*findings, *more[: settings.REFIT_FINDINGS]]
    return Where(gaps, regimes, tuple(findings))


def _described(
    data: Baseline,
    regression: Regression,
    residuals: Sequence[FloatArray],
    axes: Sequence[Sequence[Axis]],
    gaps: Sequence[JointGap],
    prefix: str,
) -> tuple[tuple[Regime, ...], list[str]]:
    """Regimes whose interval excludes 1, and sentences, the most telling first."""
    regimes: list[Regime] = []
    sentences: list[tuple[float, str]] = []
    edge = data.prepared.configuration.processing.decimation_edge
    session = data.prepared.session.parts
    for joint, name in enumerate(data.joints):
        residual = residuals[joint]
        blocks = time_blocks(data.recordings[joint], data.places[joint], data.row_rate)
        splits = [split(axis, residual, blocks) for axis in axes[joint]]
        spectrum = bands(residual, regression.joints[joint].segments, data.row_rate, edge)
        for parts in [*splits, *([] if spectrum is None else [spectrum])]:
            found = regimes_of(name, parts, unit_at(data, joint, _UNITS[parts.name]))
            regimes += found
            best = joined(found)
            # Most of what moves slowly is slow: not worth a word.
            slow = best is not None and parts.name == "frequency" and best.low <= 0.0
            if best is not None and not slow:
                weight = (best.energy_share - best.occupancy) * gaps[joint].share
                sentences.append((weight, prefix + in_words(best, parts.edges, session)))
    regimes.sort(key=lambda regime: -regime.lift)
    sentences.sort(key=lambda sentence: -sentence[0])
    return tuple(regimes), [sentence for _, sentence in sentences]
