"""Which numbers of the nominal model are in error, and what correcting them takes of the gap."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from idim_iv_ros.diagnosis import sentences, settings
from idim_iv_ros.diagnosis.answer.explained import Explained, JudgedTerm
from idim_iv_ros.diagnosis.answer.numbers import numbers_of
from idim_iv_ros.diagnosis.answer.structural_causes import rivals_of
from idim_iv_ros.diagnosis.comparison.candidate import Kind
from idim_iv_ros.diagnosis.comparison.model_with_terms import Term
from idim_iv_ros.diagnosis.comparison.select import refit_residuals
from idim_iv_ros.diagnosis.refit.baseline import Baseline
from idim_iv_ros.diagnosis.refit.noise_floor import common_floor
from idim_iv_ros.diagnosis.result import (
    NOT_CALIBRATED,
    Cause,
    Evidence,
    Gap,
    Indistinguishable,
    JointChange,
    ParameterError,
)
from idim_iv_ros.effects.parametric_effect import ParameterSpace, ParametricEffect
from idim_iv_ros.types import FloatArray


@dataclass(frozen=True, eq=False)
class NumberErrors:
    """Gap of the nominal model beside the structural causes, and how numbers close it.

    Attributes
    ----------
    causes : tuple of JudgedTerm
        Wrong numbers, the one first that takes most beside those before it; what the
        configuration itself leaves out comes before all others.
    stages : (causes + 1, n_joints)
        RMS of the residual before the first cause, and with one after the other, N m (N).
    refit : (n_joints,)
        With all numbers free.
    """

    causes: tuple[JudgedTerm, ...]
    stages: FloatArray
    refit: FloatArray


def number_errors(found: Explained) -> NumberErrors:
    """Order the wrong numbers and compute the gap before and after each."""
    ledger = found.selection.comparison.options.ledger
    space = found.selection.comparison.catalogue.space
    gap = [left.copy() for left in ledger.gap]
    signals = [term for term in found.selection.terms if term.candidate.kind is Kind.SIGNAL]
    for term in (*(effect.term for effect in found.effects), *signals, *found.selection.curves):
        _take(gap, term)
    refit = refit_residuals(ledger, gap)
    left = list(found.numbers)
    ordered, stages = [], [_rms(gap)]
    while left:
        rest = [_rms(_without(gap, each.term)) for each in left]
        taken = [float(np.sum((stages[-1] ** 2 - after**2) / ledger.sizes**2)) for after in rest]
        first = [_left_out(each, space) for each in left]
        best = max(range(len(left)), key=lambda k: (first[k], taken[k]))
        _take(gap, left[best].term)
        ordered.append(left.pop(best))
        stages.append(rest[best])
    return NumberErrors(tuple(ordered), np.array(stages), _rms(refit))


def _left_out(judged: JudgedTerm, space: ParameterSpace) -> bool:
    effect = judged.term.candidate.effect
    return isinstance(effect, ParametricEffect) and effect.known_to_be_left_out(space)


def _take(gap: list[FloatArray], term: Term) -> None:
    """Take a term's torque out of a gap."""
    for joint, table in term.columns.items():
        gap[joint] = gap[joint] - table @ term.coefficients


def _without(gap: Sequence[FloatArray], term: Term) -> list[FloatArray]:
    rest = list(gap)
    _take(rest, term)
    return rest


def _rms(gap: Sequence[FloatArray]) -> FloatArray:
    return np.array([np.sqrt(np.mean(left**2)) if len(left) else 0.0 for left in gap])


def parameter_errors(data: Baseline, errors: NumberErrors) -> tuple[ParameterError, ...]:
    """Gap of the nominal model at each joint, with the causes and with all parameters refitted."""
    if data.prepared.given is None:
        return ()
    made = []
    for joint, name in enumerate(data.joints):
        if joint in data.left_out:
            continue
        named, refit = float(errors.stages[-1][joint]), float(errors.refit[joint])
        remaining = float(np.sqrt(max(named**2 - refit**2, 0.0)))
        made.append(
            ParameterError(
                joint=name,
                given=float(errors.stages[0][joint]),
                named=named,
                refit=refit,
                remaining=remaining,
                share_of_torque=remaining / float(data.torque_sizes[joint]),
            )
        )
    return tuple(made)


def remaining(errors: Sequence[ParameterError], least: float | None = None) -> list[ParameterError]:
    """Joints at which a parameter error remains that no cause names, the largest share first.

    Parameters
    ----------
    errors
    least
        Share of a joint's torque that counts; None: `LEAST_PARAMETER_ERROR`.
    """
    least = float(settings.LEAST_PARAMETER_ERROR) if least is None else least
    return sorted(
        (
            error
            for error in errors
            if error.share_of_torque > least
            and error.named > settings.PARAMETER_ERROR_OVER_REFIT * error.refit
        ),
        key=lambda each: -each.share_of_torque,
    )


def parametric_causes(data: Baseline, found: Explained, errors: NumberErrors) -> list[Cause]:
    """One cause for each wrong number, in their order."""
    space = found.selection.comparison.catalogue.space
    causes = []
    for judged, before, after in zip(
        errors.causes, errors.stages[:-1], errors.stages[1:], strict=True
    ):
        term, effect = judged.term, judged.term.candidate.effect
        assert isinstance(effect, ParametricEffect)
        place = term.candidate.place
        joint = None if place is None else data.joints[place.joint]
        others = rivals_of(data, judged)
        if effect.known_to_be_left_out(space):
            others = tuple(
                Indistinguishable(name, where, 1.0)
                for name, where in effect.inseparable_from(space)
            )
        changed = _joint_changes(data, joint, before, after)
        numbers = numbers_of(term, found)
        causes.append(
            Cause(
                effect=effect.name,
                kind="parametric",
                joint=joint,
                other_joint=None,
                parameters=numbers,
                probability=judged.probability,
                evidence=Evidence(
                    2.0 * term.evidence,
                    None,
                    None,
                    "",
                    chosen_in_folds=judged.chosen,
                    p_value_from=NOT_CALIBRATED,
                ),
                indistinguishable_from=others,
                torque_gap=_gap(data, joint, before, after, found),
                simulation_gap=None,
                sentence=sentences.parametric_cause(
                    data, effect, joint, numbers, others, changed, judged.probability
                ),
                joint_gaps=changed,
            )
        )
    return causes


def _joint_changes(
    data: Baseline, joint: str | None, before: FloatArray, after: FloatArray
) -> tuple[JointChange, ...]:
    """Joints whose gap a cause changes, its own first and then the largest share first."""
    changed = [
        data.joint_change(number, float(one), float(two))
        for number, (one, two) in enumerate(zip(before, after, strict=True))
    ]
    kept = [
        change
        for change in changed
        if change.joint == joint or abs(change.share_of_torque) >= settings.LEAST_PARAMETER_ERROR
    ]
    return tuple(sorted(kept, key=lambda each: (each.joint != joint, -each.share_of_torque)))


def _gap(
    data: Baseline, joint: str | None, before: FloatArray, after: FloatArray, found: Explained
) -> Gap:
    which = list(range(len(data.joints))) if joint is None else [data.joints.index(joint)]
    one, two = (float(np.sqrt(np.sum(stage[which] ** 2))) for stage in (before, after))
    floor = common_floor([found.floors[number] for number in which])
    room = one - (floor or 0.0)
    shrinkage = (one - two) / room if room > settings.LEAST_ROOM * one else None
    return Gap(one, two, floor, shrinkage, None)
