"""Structural causes and hints with numbers, evidence and a sentence."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from idim_iv_ros.diagnosis import sentences, settings
from idim_iv_ros.diagnosis.answer.explained import Explained, JudgedTerm
from idim_iv_ros.diagnosis.answer.numbers import numbers_of, parameters_of
from idim_iv_ros.diagnosis.comparison.candidate import Kind
from idim_iv_ros.diagnosis.likelihood import Fit
from idim_iv_ros.diagnosis.refit.baseline import Baseline
from idim_iv_ros.diagnosis.result import (
    NOT_CALIBRATED,
    Cause,
    EffectParameter,
    Evidence,
    Gap,
    Hint,
    Indistinguishable,
    SimulationGap,
)


def rivals_of(data: Baseline, judged: JudgedTerm) -> tuple[Indistinguishable, ...]:
    """What explains the recording as well in the place of a term, the likeliest first."""
    names = dict.fromkeys(
        (key[0], None if key[1] is None else data.joints[key[1]])
        for key, weight in judged.term.rivals
        if key != judged.term.key and weight >= settings.LEAST_WEIGHT_OF_RIVAL
    )
    weights = {key[:2]: weight for key, weight in judged.term.rivals}
    joints = {name: number for number, name in enumerate(data.joints)}
    return tuple(
        Indistinguishable(effect, joint, weights[(effect, joints[joint] if joint else None)])
        for effect, joint in names
    )


def structural_causes(
    data: Baseline, found: Explained, simulations: Sequence[SimulationGap | None]
) -> list[Cause]:
    """One cause for each structural effect.

    Parameters
    ----------
    simulations
        Gap of the simulated motion before and after each effect.
    """
    causes, model, tested = [], found.model, found.tested
    for number, (judged, simulation) in enumerate(zip(found.effects, simulations, strict=True)):
        term = model.effects[number]
        place = term.place
        stage = tested.refit + number
        gap = tested.gap(stage, stage + 1, place.joint)
        gain, helped, folds = tested.gain(number)
        start = sum(model.regression.widths[:number])
        numbers = parameters_of(data, model.regression, _beside_nominal(found), term, start)
        numbers = data.in_units_at(place.joint, numbers)
        others = rivals_of(data, judged)
        causes.append(
            Cause(
                effect=term.effect.name,
                kind="structural",
                joint=data.joints[place.joint],
                other_joint=None if place.other is None else data.joints[place.other],
                parameters=numbers,
                probability=judged.probability,
                evidence=Evidence(
                    statistic=max(2.0 * judged.term.evidence, 0.0),
                    p_value=None,
                    held_out_gain=gain,
                    folds_positive=f"{helped} of {folds}",
                    chosen_in_folds=judged.chosen,
                    p_value_from=NOT_CALIBRATED,
                ),
                indistinguishable_from=others,
                torque_gap=gap,
                simulation_gap=simulation,
                sentence=sentences.structural_cause(
                    data, term, numbers, others, gap, judged.probability
                ),
                joint_gaps=(data.joint_change(place.joint, gap.before, gap.after),),
            )
        )
    return causes


def _beside_nominal(found: Explained) -> Fit:
    """The refit with the coefficients that effects have beside the errors of the nominal model."""
    values = found.model.fit.coefficients.copy()
    values[:] = np.concatenate([effect.term.coefficients for effect in found.effects])
    return replace(found.model.fit, coefficients=values)


def hints_of(data: Baseline, found: Explained) -> tuple[Hint, ...]:
    """Terms that were selected and are no causes, each with the reason."""
    made = []
    for judged in found.doubtful:
        term, place = judged.term, judged.term.candidate.place
        if place is None or float(term.whole.max()) <= 0.0:
            continue
        joints = [data.joints[joint] for joint in place.joints]
        numbers: dict[str, EffectParameter] = data.in_units_at(place.joint, numbers_of(term, found))
        share = float(term.visible[place.joint]) * data.torque_sizes[place.joint]
        rest = found.tested.rms(len(found.tested.names) - 1, place.joint)[0]
        made.append(
            Hint(
                effect=term.key[0],
                joint=joints[0],
                other_joint=joints[1] if len(joints) > 1 else None,
                sentence=sentences.hint(term.key[0], joints, numbers, judged.reason),
                reason=judged.reason,
                parameters=numbers,
                chosen_in_folds=judged.chosen if term.candidate.kind is Kind.EFFECT else "",
                torque_gap=Gap(float((rest**2 + share**2) ** 0.5), rest, None, None, None),
            )
        )
    return tuple(made)
