"""Parameter errors that may be there, and that are not named: hints."""

from collections.abc import Sequence
from dataclasses import dataclass

from idim_iv_ros.diagnosis import sentences
from idim_iv_ros.diagnosis.parametric.change_regression import ChangeRegression
from idim_iv_ros.diagnosis.parametric.evidence import ParametricCause
from idim_iv_ros.diagnosis.parametric.sure import SureOnlyTogether
from idim_iv_ros.diagnosis.refit.baseline import Baseline
from idim_iv_ros.diagnosis.result import EffectParameter, Gap, Hint
from idim_iv_ros.effects.parametric_effect import ParametricEffect

EACH_MAY_BE_ZERO = (
    "its numbers differ from zero together, but beside errors of all other given numbers each of "
    "them may be zero"
)


@dataclass(frozen=True)
class ParametricDoubt:
    """A parameter error whose numbers differ from zero together, while each of them may be zero.

    Attributes
    ----------
    effect : ParametricEffect
    joint : int
    parameters : dict of str to EffectParameter
        If it were a cause, beside errors of all other given numbers.
    before, after : float
        RMS of the nominal model's residual at the joint, and with it alone, N m (N).
    """

    effect: ParametricEffect
    joint: int
    parameters: dict[str, EffectParameter]
    before: float
    after: float


def doubts_of(
    joints: Sequence[str],
    changes: ChangeRegression,
    doubtful: Sequence[SureOnlyTogether],
    causes: Sequence[ParametricCause],
) -> tuple[ParametricDoubt, ...]:
    """Doubtful errors of single joints; not those that are named among all given numbers."""
    named = {(cause.effect.name, cause.joint) for cause in causes}
    return tuple(
        _doubt(changes, each, each.hypothesis.joint)
        for each in doubtful
        if each.hypothesis.joint is not None
        and (each.hypothesis.effect.name, joints[each.hypothesis.joint]) not in named
    )


def _doubt(changes: ChangeRegression, doubtful: SureOnlyTogether, joint: int) -> ParametricDoubt:
    """What it would be at its joint, by itself."""
    effect = doubtful.hypothesis.effect
    alone = changes.explain(doubtful.hypothesis.changes).contributions.sum(axis=1)
    before, after = (float(each[joint]) for each in changes.rms(alone))
    parameters = effect.parameters(changes.space, joint, doubtful.numbers)
    return ParametricDoubt(effect, joint, parameters, before, after)


def parametric_hints(data: Baseline, doubts: Sequence[ParametricDoubt]) -> tuple[Hint, ...]:
    """Parameter errors that are not named, since each of their numbers may be zero."""
    hints = []
    for each in doubts:
        joint, name = data.joints[each.joint], each.effect.name
        shrinkage = (each.before - each.after) / each.before if each.before > 0.0 else None
        hints.append(
            Hint(
                effect=name,
                joint=joint,
                other_joint=None,
                sentence=sentences.hint(
                    each.effect.name, [joint], each.parameters, EACH_MAY_BE_ZERO
                ),
                reason=EACH_MAY_BE_ZERO,
                parameters=each.parameters,
                chosen_in_folds="",
                torque_gap=Gap(each.before, each.after, None, shrinkage, None),
            )
        )
    return tuple(hints)
