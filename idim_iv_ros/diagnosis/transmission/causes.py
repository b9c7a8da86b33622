"""Measured shafts and play as causes, one with what the torque alone says of them."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import chi2

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.refit.baseline import Baseline
from idim_iv_ros.diagnosis.result import Cause, EffectParameter, Evidence, Gap, Transmission
from idim_iv_ros.diagnosis.structural.likelihood import Regression
from idim_iv_ros.diagnosis.transmission import words
from idim_iv_ros.diagnosis.transmission.fit import LOAD, SIDE, held_out
from idim_iv_ros.diagnosis.transmission.measure import Measured
from idim_iv_ros.diagnosis.transmission.torque import less, link_inertia, twist_torques
from idim_iv_ros.effects.registry import BY_NAME, name_of

# Play counts as play, and not as part of a shaft, from this share of the shaft's largest bending:
# as `effects.backlash`.
_WIDE = 0.3


@dataclass(frozen=True)
class TransmissionCauses:
    """All causes, with the measured ones, and what the encoders exclude."""

    causes: list[Cause]
    notes: tuple[str, ...] = ()


def with_transmissions(
    data: Baseline,
    regression: Regression,
    measured: Sequence[Measured],
    causes: Sequence[Cause],
    without: Collection[str] = (),
) -> TransmissionCauses:
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
                notes.append(words.refuted(each.result, cause.effect))
    return TransmissionCauses(kept, tuple(notes))


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
    if found.stiffness is None or _resonance(data, each) > settings.STIFF_RESONANCE:
        return None
    return name_of("shaft")


def _resonance(data: Baseline, each: Measured) -> float:
    """Of the link against a motor at rest, Hz: median over the motion."""
    assert each.result.stiffness is not None
    inertia = link_inertia(data, each.joint)
    return float(np.sqrt(each.result.stiffness.value / inertia) / (2.0 * np.pi))


def _excluded(found: Transmission, cause: Cause) -> bool:
    """Whether the measured bounds exclude a shaft or play of that size."""
    numbers = {name: each.value for name, each in cause.parameters.items()}
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
    tried = len(fit.gains) * len(data.joints)
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
        sentence=words.backlash(found) if BY_NAME[name].part == "play" else words.elasticity(found),
        parameters=parameters,
        evidence=Evidence(
            statistic=statistic,
            p_value=min(1.0, tried * float(chi2.sf(max(statistic, 0.0), 1))),
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
