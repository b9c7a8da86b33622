"""Causes and hints with numbers, evidence and a sentence, in the order in which they are said."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from idim_iv_ros.diagnosis import sentences, settings
from idim_iv_ros.diagnosis.answer.explained import AssessedTerm, Explained
from idim_iv_ros.diagnosis.comparison.curves import GainRipple
from idim_iv_ros.diagnosis.comparison.model_with_terms import Term
from idim_iv_ros.diagnosis.comparison.select import refit_residuals
from idim_iv_ros.diagnosis.refit.baseline import Baseline
from idim_iv_ros.diagnosis.result.causes import (
    Cause,
    Evidence,
    Gap,
    Hint,
    Indistinguishable,
    ParameterError,
    SimulationGap,
    Unexplained,
)
from idim_iv_ros.diagnosis.result.document import Verdict
from idim_iv_ros.effects.parametric_effect import ParametricEffect
from idim_iv_ros.effects.registry import BY_NAME
from idim_iv_ros.estimation.likelihood import rms
from idim_iv_ros.types import FloatArray


def rivals_of(joints: Sequence[str], terms: Sequence[Term]) -> tuple[Indistinguishable, ...]:
    """What explains the recording as well in the place of terms, the likeliest first."""
    weights: dict[tuple[str, int | None], float] = {}
    for term in terms:
        for key, weight in term.rivals:
            if key[:3] != term.key[:3] and weight >= settings.LEAST_WEIGHT_OF_RIVAL:
                weights.setdefault(key[:2], weight)
    return tuple(
        Indistinguishable(effect, None if joint is None else joints[joint], weight)
        for (effect, joint), weight in weights.items()
    )


def signal_notes(joints: Sequence[str], terms: Sequence[Term]) -> list[str]:
    """What a report says of gains that ripple, which are no causes, and what they may be."""
    notes = []
    for term in terms:
        effect = term.candidate.effect
        if isinstance(effect, GainRipple):
            joint = joints[term.place.joint]
            said = effect.note(joint, term.shape, term.coefficients, term.deviations)
            notes.append(said + sentences.or_else(rivals_of(joints, [term])))
    return notes


def structural_causes(
    explanation: Explained, simulations: Sequence[SimulationGap | None]
) -> list[Cause]:
    """One cause for each structural effect.

    `simulations`: gap of the simulated motion before and after each effect.
    """
    data, tested, causes = explanation.data, explanation.tested, []
    pairs = zip(explanation.effects, simulations, strict=True)
    for number, (judgement, simulation) in enumerate(pairs):
        term, place = judgement.term, judgement.term.place
        gap = tested.gap(number, place.joint, explanation.floors[place.joint].sigma)
        gain, helped, folds = tested.gains[number]
        numbers = explanation.parameters_of(number)
        cause = Cause(
            effect=term.effect.name,
            kind="structural",
            joint=data.joints[place.joint],
            other_joint=None if place.other is None else data.joints[place.other],
            sentence="",
            parameters=data.in_units_at(place.joint, numbers),
            probability=judgement.probability,
            evidence=Evidence(
                statistic=max(2.0 * term.evidence, 0.0),
                held_out_gain=gain,
                folds_positive=f"{helped} of {folds}",
                chosen_in_folds=judgement.chosen,
            ),
            indistinguishable_from=rivals_of(data.joints, [term]),
            torque_gap=gap,
            simulation_gap=simulation,
            joint_gaps=(data.joint_change(place.joint, gap.before, gap.after),),
        )
        said = sentences.structural_cause(data, cause, term.effect.meaning(term.shape))
        causes.append(replace(cause, sentence=said))
    return causes


def parametric_causes(explanation: Explained) -> tuple[list[Cause], tuple[ParameterError, ...]]:
    """One cause for each wrong number, and what parameter errors make of the gap at each joint.

    The number that takes most of the gap beside those before it comes first, after what the
    configuration itself leaves out. The gap is that of the nominal model beside the structural
    causes; errors are empty without a nominal model.
    """
    data, selection = explanation.data, explanation.selection
    ledger, effects = selection.comparison.options.ledger, [e.term for e in explanation.effects]
    gap = list(ledger.gap)
    for term in (*effects, *selection.signals, *selection.curves):
        gap = term.taken_from(gap)
    refit, first = _rms(refit_residuals(ledger, gap)), _rms(gap)
    left, before, causes = list(explanation.numbers), first, []

    def without(judgement: AssessedTerm) -> float:
        return float(np.linalg.norm(_rms(judgement.term.taken_from(gap)) / ledger.sizes))

    while left:
        judgement = min(left, key=without)  # takes most of the gap
        left.remove(judgement)
        gap = judgement.term.taken_from(gap)
        after = _rms(gap)
        causes.append(_parametric_cause(explanation, judgement, before, after))
        before = after
    if data.prepared.given is None:
        return causes, ()
    remaining = np.sqrt(np.maximum(before**2 - refit**2, 0.0))
    table = np.column_stack([first, before, refit, remaining, remaining / data.torque_sizes])
    return causes, tuple(
        ParameterError(name, *table[joint].tolist())
        for joint, name in enumerate(data.joints)
        if joint not in data.left_out
    )


def _rms(gap: Sequence[FloatArray]) -> FloatArray:
    return np.array([rms(left) for left in gap])


def _parametric_cause(
    explanation: Explained, judgement: AssessedTerm, before: FloatArray, after: FloatArray
) -> Cause:
    """One wrong number, with the gap (n_joints,) before and after it is corrected, N m (N)."""
    term, effect = judgement.term, judgement.term.candidate.effect
    assert isinstance(effect, ParametricEffect)
    data, space, joint = explanation.data, explanation.selection.catalogue.space, term.key.joint
    name = None if joint is None else data.joints[joint]
    others = rivals_of(data.joints, [term])
    if joint is not None and term.candidate in explanation.selection.catalogue.not_given:
        inseparable = effect.inseparable_from(space, joint)
        others = tuple(Indistinguishable(other, name, 1.0) for other in inseparable)
    changes = map(data.joint_change, range(len(data.joints)), before, after)
    changed = [
        change
        for change in changes
        if change.joint == name or abs(change.share_of_torque) >= settings.LEAST_PARAMETER_ERROR
    ]
    changed.sort(key=lambda change: (change.joint != name, -change.share_of_torque))
    which = list(range(len(data.joints))) if joint is None else [joint]
    one, two = (float(np.linalg.norm(stage[which])) for stage in (before, after))
    noise = [explanation.floors[number].sigma for number in which]
    floor = None if None in noise else float(np.linalg.norm(np.array(noise, dtype=float)))
    cause = Cause(
        effect=effect.name,
        kind="parametric",
        joint=name,
        sentence="",
        parameters=term.parameters,
        probability=judgement.probability,
        evidence=Evidence(2.0 * term.evidence, chosen_in_folds=judgement.chosen),
        indistinguishable_from=others,
        torque_gap=Gap.between(one, two, floor),
        joint_gaps=tuple(changed),
    )
    return replace(cause, sentence=sentences.parametric_cause(data, cause, effect))


def remaining(errors: Sequence[ParameterError], least: float) -> list[ParameterError]:
    """Joints with more than a share of torque in error that no cause names, the largest first."""
    factor = settings.PARAMETER_ERROR_OVER_REFIT
    large = [e for e in errors if e.share_of_torque > least and e.named > factor * e.refit]
    return sorted(large, key=lambda error: -error.share_of_torque)


def hints_of(explanation: Explained) -> tuple[Hint, ...]:
    """Terms that were selected and are no causes, each with the reason."""
    data, made = explanation.data, []
    for judgement in explanation.doubtful:
        term, place = judgement.term, judgement.term.candidate.place
        if place is None or float(term.whole.max()) <= 0.0:
            continue
        joints = [data.joints[joint] for joint in place.joints]
        numbers = data.in_units_at(place.joint, term.parameters)
        share = float(term.visible[place.joint]) * data.torque_sizes[place.joint]
        rest = explanation.tested.stages[-1].torque_rms[joints[0]]
        made.append(
            Hint(
                effect=term.key.effect,
                joint=joints[0],
                other_joint=joints[1] if len(joints) > 1 else None,
                sentence=sentences.hint(term.key.effect, joints, numbers, judgement.reason),
                reason=judgement.reason,
                probability=judgement.too_unsure,
                parameters=numbers,
                chosen_in_folds=judgement.chosen if term.is_effect else "",
                torque_gap=Gap(float(np.hypot(rest, share)), rest),
            )
        )
    return tuple(made)


def strongest_first(causes: Sequence[Cause], data: Baseline) -> list[Cause]:
    """Sort causes by what they take of the gap, as a share of the torque of the joint.

    Of causes that move several joints the shares of all count. Another control law has no gap of
    the torque: its evidence decides whether it comes before the structural causes or after them.
    A delay of all joints, which was put in before anything else was looked for, comes first.
    """
    laws = [cause for cause in causes if BY_NAME[cause.effect].part == "gains"]
    others = [cause for cause in causes if BY_NAME[cause.effect].part != "gains"]
    others.sort(key=lambda cause: -_taken(cause, data))
    places = [place for place, cause in enumerate(others) if cause.kind == "structural"]
    place = places[-1] + 1 if places else len(others)
    evidence, of_others = (
        max((cause.evidence.statistic for cause in some), default=0.0)
        for some in (laws, [others[number] for number in places])
    )
    if places and evidence > of_others:
        place = places[0]
    ordered = [*others[:place], *laws, *others[place:]]
    return sorted(
        ordered, key=lambda cause: not (BY_NAME[cause.effect].put_in_first and cause.joint is None)
    )


def _taken(cause: Cause, data: Baseline) -> float:
    """Energy of the torque gap that a cause takes, as a share of the torque's, over its joints."""
    if cause.joint_gaps:
        shares = [change.share_of_torque for change in cause.joint_gaps]
        return float(sum(share * abs(share) for share in shares))
    taken = cause.torque_gap.before**2 - cause.torque_gap.after**2
    joints = range(len(data.joints)) if cause.joint is None else [data.joints.index(cause.joint)]
    return taken / sum(float(data.torque_sizes[joint]) ** 2 for joint in joints)


def verdict_of(
    causes: Sequence[Cause],
    outside: Unexplained | None,
    *,
    parameters: bool = False,
    unexplained: bool = False,
) -> Verdict:
    """One word: causes of the catalogue count before what is outside it.

    `parameters`: whether parameters are in error beyond the causes: it is not known which;
    `unexplained`: whether much of the gap remains.
    """
    kinds: set[str] = {cause.kind for cause in causes}
    if parameters and not kinds and not unexplained:
        kinds = {"parametric"}
    if kinds == {"parametric", "structural"}:
        return "both"
    if "parametric" in kinds:
        return "parametric" if outside is None else "unknown"
    if "structural" in kinds:
        return "structural"
    return "unknown" if unexplained or outside is not None else "none"
