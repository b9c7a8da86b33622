"""Effects that a search over all data accepts, and that do not hold without the data that chose it.

They are shown apart from the causes: with what each would be, and why it is only a hint.
"""

from idim_iv_ros.diagnosis import sentences
from idim_iv_ros.diagnosis.refit.baseline import Baseline
from idim_iv_ros.diagnosis.result import Hint
from idim_iv_ros.diagnosis.structural.attribution import Attribution
from idim_iv_ros.diagnosis.structural.causes import Selection, built_model
from idim_iv_ros.diagnosis.structural.confirmation import Confirmed, tested
from idim_iv_ros.diagnosis.structural.deviations import parameters_of


def hints_of(data: Baseline, attribution: Attribution, held: Confirmed) -> tuple[Hint, ...]:
    """Each doubtful effect beside the causes that hold, the last of the model."""
    hints = []
    for each in held.doubtful:
        kept = held.model
        model = built_model(attribution, [*kept.found, each.found], kept.nonparametric)
        residuals = tested(data, model, held.floors, held.folds).held_out
        last = residuals.refit + len(kept.found)
        candidate, place = each.found.candidate, each.found.candidate.place
        gap = residuals.gap(last, last + 1, place.joint)
        start = sum(model.regression.widths[:-1])
        numbers = parameters_of(data, model.regression, model.fit, candidate, start)
        joints = [data.joints[joint] for joint in candidate.own_joints]
        hints.append(
            Hint(
                effect=candidate.effect.name,
                joint=joints[0],
                other_joint=joints[1] if len(joints) > 1 else None,
                sentence=sentences.hint(candidate.effect.name, joints, numbers, each.reason),
                reason=each.reason,
                parameters=data.in_units_at(place.joint, numbers),
                chosen_in_folds=each.chosen.words,
                torque_gap=gap,
            )
        )
    return tuple(hints)


def selections_of(held: Confirmed) -> tuple[Selection, ...]:
    """How surely each cause was chosen: folds, and a p-value on simulated recordings."""
    found = held.model.found
    made = []
    for each, chosen in zip(found, held.chosen, strict=True):
        others = [other for other in found if other is not each]
        made.append(Selection(chosen.words, *held.folds.p_value(each, others)))
    return tuple(made)
