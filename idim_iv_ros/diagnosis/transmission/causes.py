"""Measured shafts and play as causes, one with what the torque alone says of them."""

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.likelihood import Regression
from idim_iv_ros.diagnosis.refit.baseline import Baseline
from idim_iv_ros.diagnosis.result import (
    Cause,
    EffectParameter,
    Evidence,
    Gap,
    Transmission,
)
from idim_iv_ros.diagnosis.sentences import with_interval
from idim_iv_ros.diagnosis.transmission.fit import LOAD, SIDE, held_out
from idim_iv_ros.diagnosis.transmission.measure import Measured, less, link_inertia, twist_torques
from idim_iv_ros.effects.registry import BY_NAME, name_of

# Hz, of the link against its motor: a shaft is rigid above what the catalogue looks for.
_STIFF_RESONANCE = 100.0
_EFFECTS = (name_of("shaft"), name_of("play"))
# Play counts as play, and not as part of a shaft, from this share of the shaft's largest bending:
# as `effects.backlash`.
_WIDE = 0.3

_BEHIND = "measured by the encoder behind the gear"
# A shaft this stiff (N m/rad) is only the limit of arithmetic: encoders without noise.
_RIGID = 1e12


def described(found: Transmission) -> str:
    """All that was measured of one transmission, in one sentence."""
    where = f"gear of {found.joint}"
    if found.time_offset is None:
        return f"{where}: {found.reason}"
    small = f"m{found.unit}"
    if found.stiffness is not None:
        text = f"{where}: stiffness {with_interval(found.stiffness)}"
        if found.damping is not None:
            text += f", damping {with_interval(found.damping)}"
    else:
        text = f"{where}: no stiffness is measured, {found.reason}"
        if found.stiffness_at_least is not None and found.stiffness_at_least < _RIGID:
            unit = "N m/rad" if found.unit == "rad" else "N/m"
            text += f" (95 %: at least {found.stiffness_at_least:.2g} {unit})"
    if found.backlash is not None:
        text += f"; play {with_interval(found.backlash, 1e3, small)}"
    elif found.backlash_at_most is not None:
        text += f"; no play is seen, at most {1e3 * found.backlash_at_most:.2g} {small} (95 %)"
    else:
        text += "; play cannot be determined, the load hardly changes its side"
    if found.lost_motion is not None:
        text += (
            f"; {with_interval(found.lost_motion, 1e3, small)} follow the direction of motion "
            "(play that friction keeps on one side, or friction behind the gear)"
        )
    if found.position_error:
        text += "; an error of an encoder over the position was taken out"
    return f"{text}; {offset_words(found)}"


def offset_words(found: Transmission) -> str:
    """Say the time between the two channels."""
    assert found.time_offset is not None
    offset = found.time_offset
    late = "late" if offset.value >= 0.0 else "early"
    half = "" if offset.std is None else f" ± {1e3 * settings.NORMAL_95 * offset.std:.2g}"
    return f"the link is read {1e3 * abs(offset.value):.3g}{half} ms {late}, which is no elasticity"


def elasticity(found: Transmission) -> str:
    """Where a shaft twists, measured by the encoder behind it."""
    assert found.stiffness is not None
    rms = 1e3 * found.twist_rms * found.elastic_share**0.5
    return (
        f"elasticity at {found.joint}, {_BEHIND}: stiffness "
        f"{with_interval(found.stiffness)}; under the load the gear twists by {rms:.2g} "
        f"m{found.unit} rms, {100.0 * found.elastic_share:.0f} % of what motor and link "
        f"differ by ({offset_words(found)})"
    )


def backlash(found: Transmission) -> str:
    """Where a gear has play, measured by the encoder behind it."""
    assert found.backlash is not None
    gap = with_interval(found.backlash, 1e3, f"m{found.unit}")
    text = f"backlash at {found.joint}, {_BEHIND}: gap {gap}"
    if found.stiffness is not None:
        text += f", stiffness beyond it {with_interval(found.stiffness)}"
    return f"{text} ({offset_words(found)})"


def measured_behind(cause: Cause) -> bool:
    """Whether a cause was measured by an encoder behind the gear."""
    return _BEHIND in cause.sentence


def refuted(found: Transmission, effect: str) -> str:
    """Say which effect on the torque the encoder behind the gear excludes."""
    return (
        f"on the torque alone an {effect} at {found.joint} would help; the encoder behind the gear "
        f"excludes one of that size ({described(found)})"
    )


def with_transmissions(
    data: Baseline,
    regression: Regression,
    measured: Sequence[Measured],
    causes: Sequence[Cause],
    without: Collection[str] = (),
) -> tuple[list[Cause], list[str]]:
    """Put measured shafts and play in place of those that the torque alone suggests.

    Where both name one, it is one cause, with the measured numbers and the torque gap of the other.
    What the encoder behind a gear excludes at 95 % is taken out, with a note.

    Parameters
    ----------
    regression
        Of the refit on the smooth motion.
    without
        Effects that are left out of the catalogue.
    """
    kept, notes = list(causes), []
    for each in measured:
        name = _effect(data, each)
        own = [
            cause
            for cause in kept
            if cause.joint == each.result.joint and BY_NAME[cause.effect].part in ("shaft", "play")
        ]
        if name is not None and name not in without:
            found = _cause(data, regression, each, name)
            if own:
                found = replace(
                    found,
                    torque_gap=own[0].torque_gap,
                    joint_gaps=own[0].joint_gaps,
                    simulation_gap=own[0].simulation_gap,
                )
            kept = [found, *(cause for cause in kept if cause not in own)]
            continue
        for cause in own:
            if _excluded(each.result, cause):
                kept.remove(cause)
                notes.append(refuted(each.result, cause.effect))
    return kept, notes


def _effect(data: Baseline, each: Measured) -> str | None:
    """What a measured transmission is called; None where nothing that matters was measured."""
    found, fit = each.result, each.fit
    if fit is None:
        return None
    if found.backlash is not None:
        bending = 0.0
        if found.stiffness is not None:
            bending = float(np.max(np.abs(fit.rows.load))) / found.stiffness.value
        if found.backlash.value > _WIDE * bending:
            return name_of("play")
    if found.stiffness is None or _resonance(data, each) > _STIFF_RESONANCE:
        return None
    return name_of("shaft")


def _resonance(data: Baseline, each: Measured) -> float:
    """Of the link against a motor at rest, Hz: median over the motion."""
    assert each.result.stiffness is not None
    inertia = link_inertia(data, each.joint)
    return float(np.sqrt(each.result.stiffness.value / inertia) / (2.0 * np.pi))


def _excluded(found: Transmission, cause: Cause) -> bool:
    """Whether the measured bounds exclude a shaft or play of that size."""
    numbers = {name: parameter.value for name, parameter in cause.parameters.items()}
    if BY_NAME[cause.effect].part == "play":
        most = found.backlash_at_most
        return most is not None and numbers["gap"] > most
    least = found.stiffness_at_least
    return least is not None and numbers["stiffness"] < least


def _cause(data: Baseline, regression: Regression, each: Measured, name: str) -> Cause:
    found, fit = each.result, each.fit
    assert fit is not None
    term = SIDE if BY_NAME[name].part == "play" else LOAD
    gain, helped, folds = held_out(fit, term)
    statistic = 2.0 * (fit.gains[term] + 0.5 * float(np.log(len(fit.rows.load))))
    parameters, stiffness = {}, found.stiffness
    if BY_NAME[name].part == "play":
        assert found.backlash is not None
        parameters["gap"] = found.backlash
    if stiffness is None and found.stiffness_at_least is not None:
        unit = data.unit_at(each.joint, "N m/rad")
        stiffness = EffectParameter(found.stiffness_at_least, None, unit)
    if stiffness is not None:
        parameters["stiffness"] = stiffness
    if found.damping is not None:
        parameters["damping"] = found.damping
    gap = _torque_gap(data, regression, each, parameters)
    return Cause(
        effect=name,
        kind="structural",
        joint=found.joint,
        other_joint=None,
        sentence=backlash(found) if BY_NAME[name].part == "play" else elasticity(found),
        parameters=parameters,
        evidence=Evidence(
            statistic=statistic,
            held_out_gain=gain,
            folds_positive=f"{helped} of {folds}",
        ),
        indistinguishable_from=(),
        torque_gap=gap,
        joint_gaps=(data.joint_change(each.joint, gap.before, gap.after),),
        simulation_gap=None,
    )


def _torque_gap(
    data: Baseline,
    regression: Regression,
    each: Measured,
    parameters: dict[str, EffectParameter],
) -> Gap:
    """Residual of the refit at the joint, without and with the measured transmission (rms).

    The transmission is not fitted to the torque; the base parameters are, both times.
    """
    values = {name: parameter.value for name, parameter in parameters.items()}
    fit = regression.fit()
    after = fit
    if "stiffness" in values:
        columns = twist_torques(
            data,
            each.joint,
            values["stiffness"],
            values.get("damping"),
            values.get("gap", 0.0),
        )
        after = less(regression, columns).fit(fit.noise_models, steps=0)
    sizes = [float(np.sqrt(np.mean(found.residuals[each.joint] ** 2))) for found in (fit, after)]
    shrinkage = 1.0 - sizes[1] / sizes[0] if sizes[0] > 0.0 else None
    return Gap(sizes[0], sizes[1], None, shrinkage, None)
