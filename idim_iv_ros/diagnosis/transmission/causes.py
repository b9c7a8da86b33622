"""Measured shafts and play as causes, one with what the torque alone says of them."""

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from idim_iv_ros.diagnosis import sentences
from idim_iv_ros.diagnosis.likelihood import Regression
from idim_iv_ros.diagnosis.refit.baseline import Baseline
from idim_iv_ros.diagnosis.result import Cause, EffectParameter, Evidence, Gap, Transmission
from idim_iv_ros.diagnosis.transmission.fit import LOAD, SIDE, held_out
from idim_iv_ros.diagnosis.transmission.measure import Measured, less, link_inertia, twist_torques
from idim_iv_ros.effects.cause import Part
from idim_iv_ros.effects.registry import name_of, part_of

# Hz, of the link against its motor: a shaft is rigid above what the catalogue looks for.
_STIFF_RESONANCE = 100.0
# Play counts as play, and not as part of a shaft, from this share of the shaft's largest bending:
# as `effects.backlash`.
_WIDE = 0.3
_PARTS = ("shaft", "play")


def with_transmissions(
    data: Baseline,
    regression: Regression,
    measured: Sequence[Measured],
    causes: Sequence[Cause],
    without: Collection[str] = (),
) -> tuple[list[Cause], list[Cause], list[str]]:
    """Put measured shafts and play in place of those that the torque alone suggests.

    Where both name one, it is one cause, with the measured numbers and the torque gap of the other.
    What the encoder behind a gear excludes at 95 % is taken out, with a note.

    Parameters
    ----------
    regression
        Of the refit on the smooth motion.
    without
        Effects that are left out of the catalogue.

    Returns
    -------
    All causes, those of them that were measured, and notes on what is excluded.
    """
    kept, shafts, notes = list(causes), [], []
    for transmission in measured:
        result = transmission.result
        suggested = [c for c in kept if c.joint == result.joint and part_of(c.effect) in _PARTS]
        part = _part(data, transmission)
        if part and name_of(part) not in without:
            cause = _cause(data, regression, transmission, part)
            if suggested:
                cause = replace(
                    cause,
                    torque_gap=suggested[0].torque_gap,
                    joint_gaps=suggested[0].joint_gaps,
                    simulation_gap=suggested[0].simulation_gap,
                )
            kept = [cause, *(other for other in kept if other not in suggested)]
            shafts.append(cause)
            continue
        for cause in suggested:
            if _excluded(result, cause):
                kept.remove(cause)
                notes.append(sentences.refuted(result, cause.effect))
    return kept, shafts, notes


def _part(data: Baseline, transmission: Measured) -> Part:
    """What a measured transmission is, a shaft or play; empty where nothing matters in it."""
    result, fit = transmission.result, transmission.fit
    if fit is None:
        return ""
    stiffness = np.inf if result.stiffness is None else result.stiffness.value
    if result.backlash is not None:
        bending = float(np.max(np.abs(fit.rows.load))) / stiffness
        if result.backlash.value > _WIDE * bending:
            return "play"
    # Of the link against a motor at rest, median over the motion.
    resonance = np.sqrt(stiffness / link_inertia(data, transmission.joint)) / (2.0 * np.pi)
    return "" if resonance > _STIFF_RESONANCE else "shaft"


def _excluded(result: Transmission, cause: Cause) -> bool:
    """Whether the measured bounds exclude a shaft or play of that size."""
    if part_of(cause.effect) == "play":
        most = result.backlash_at_most
        return most is not None and cause.parameters["gap"].value > most
    least = result.stiffness_at_least
    return least is not None and cause.parameters["stiffness"].value < least


def _cause(data: Baseline, regression: Regression, transmission: Measured, part: Part) -> Cause:
    result, fit = transmission.result, transmission.fit
    assert fit is not None
    term = SIDE if part == "play" else LOAD
    gain, helped, folds = held_out(fit, term)
    stiffness = result.stiffness
    if stiffness is None and result.stiffness_at_least is not None:
        unit = data.unit_at(transmission.joint, "N m/rad")
        stiffness = EffectParameter(result.stiffness_at_least, None, unit)
    named = {
        "gap": result.backlash if part == "play" else None,
        "stiffness": stiffness,
        "damping": result.damping,
    }
    parameters = {name: number for name, number in named.items() if number is not None}
    gap = _torque_gap(data, regression, transmission.joint, parameters)
    return Cause(
        effect=name_of(part),
        kind="structural",
        joint=result.joint,
        sentence=sentences.play(result) if part == "play" else sentences.shaft(result),
        parameters=parameters,
        evidence=Evidence(
            statistic=2.0 * (fit.gains[term] + 0.5 * float(np.log(len(fit.rows.load)))),
            held_out_gain=gain,
            folds_positive=f"{helped} of {folds}",
        ),
        torque_gap=gap,
        joint_gaps=(data.joint_change(transmission.joint, gap.before, gap.after),),
    )


def _torque_gap(
    data: Baseline, regression: Regression, joint: int, parameters: dict[str, EffectParameter]
) -> Gap:
    """Residual of the refit at the joint, without and with the measured transmission (rms).

    The transmission is not fitted to the torque; the base parameters are, both times.
    """
    values = {name: parameter.value for name, parameter in parameters.items()}
    before = after = regression.fit()
    if "stiffness" in values:
        damping, play = values.get("damping"), values.get("gap", 0.0)
        columns = twist_torques(data, joint, values["stiffness"], damping, play)
        after = less(regression, columns).fit(before.noise_models, steps=0)
    one, two = (float(np.sqrt(np.mean(fit.residuals[joint] ** 2))) for fit in (before, after))
    return Gap(one, two, None, 1.0 - two / one if one > 0.0 else None, None)
