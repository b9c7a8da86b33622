"""Effects that also hold on data not used to fit them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.held_out.held_out import HeldOut, held_out
from idim_iv_ros.diagnosis.identifiability.testability import floor_noise_models
from idim_iv_ros.diagnosis.parametric.gain_beside_friction import with_gains
from idim_iv_ros.diagnosis.refit.baseline import Baseline
from idim_iv_ros.diagnosis.refit.noise_floor import NoiseFloor, noise_floors, repeats_of
from idim_iv_ros.diagnosis.structural.attribution import Attribution, Found
from idim_iv_ros.diagnosis.structural.brief import why_of_pulses
from idim_iv_ros.diagnosis.structural.candidate import operating_range
from idim_iv_ros.diagnosis.structural.causes import NamedModel, built_model, label, named_model
from idim_iv_ros.diagnosis.structural.cross_fitting import Chosen, CrossFitting
from idim_iv_ros.diagnosis.structural.deviations import (
    differs_from_nothing,
    numbers_differ_from_nothing,
)
from idim_iv_ros.diagnosis.structural.knee import with_knees_refitted
from idim_iv_ros.diagnosis.structural.likelihood import Fit
from idim_iv_ros.diagnosis.structural.possible import why_impossible, why_of_the_gain
from idim_iv_ros.signals import AutoregressiveModel


@dataclass(frozen=True)
class FoldTest:
    """A model on data that chose neither its effects nor their shapes and coefficients.

    Attributes
    ----------
    held_out : HeldOut
        Residuals of its stages.
    chosen : tuple of Chosen
        In how many folds each effect is chosen.
    """

    held_out: HeldOut
    chosen: tuple[Chosen, ...]


@dataclass(frozen=True)
class UnconfirmedEffect:
    """An effect that the search accepted and that does not hold without the data that chose it.

    Attributes
    ----------
    found : Found
    chosen : Chosen
    reason : str
        Why it is only a hint.
    nonparametric : bool
        Whether it holds, and only its numbers are impossible: something outside of the catalogue.
    """

    found: Found
    chosen: Chosen
    reason: str
    nonparametric: bool = False


@dataclass(frozen=True)
class Confirmed:
    """The effects that hold on data not used to fit.

    Attributes
    ----------
    model : NamedModel
        The refit with these effects.
    tested : HeldOut
        Held-out residuals of its stages.
    floors : tuple of NoiseFloor
        One for each joint.
    chosen : tuple of Chosen
        In how many folds each of its effects is chosen.
    doubtful : tuple of UnconfirmedEffect
        Effects that were accepted and do not hold.
    folds : CrossFitting
    """

    model: NamedModel
    tested: HeldOut
    floors: tuple[NoiseFloor, ...]
    chosen: tuple[Chosen, ...]
    doubtful: tuple[UnconfirmedEffect, ...]
    folds: CrossFitting

    def noise(self, refit: Fit) -> tuple[AutoregressiveModel, ...]:
        """Noise models of the refit, no larger than the noise floor."""
        return floor_noise_models(refit, [floor.sigma for floor in self.floors])


def confirmation(data: Baseline, attribution: Attribution) -> Confirmed:
    """Test the effects that were found on data not used to fit; see `confirmed`.

    Of those that hold, knees are fitted to the torque of the whole model, and sets hold gains that
    friction may imitate.
    """
    repeats = repeats_of(data)
    floors = noise_floors(data, attribution.extended, attribution.fit, repeats)
    folds = CrossFitting(data, attribution, repeats)
    attribution = replace(attribution, found=folds.with_sets(attribution.found))
    held = confirmed(data, attribution, named_model(attribution), floors, folds)
    settled = with_knees_refitted(data, attribution, held.model)
    return replace(held, model=with_gains(data, settled))


def tested(
    data: Baseline, model: NamedModel, floors: Sequence[NoiseFloor], folds: CrossFitting
) -> FoldTest:
    """Predict every fold with what is chosen without it."""
    given = data.prepared.given
    if not model.found:
        fit = model.fit
        return FoldTest(held_out(data, model.regression, fit, [], floors, folds.repeats, given), ())
    drifts = any(each.candidate.effect.family == "time" for each in model.found)
    crossed = folds.choices(interleaved=drifts)
    labels = [label(data, each) for each in model.found]
    return FoldTest(
        crossed.held_out(model.found, labels, floors, given),
        tuple(crossed.times(each, model.found) for each in model.found),
    )


def confirmed(
    data: Baseline,
    attribution: Attribution,
    model: NamedModel,
    floors: Sequence[NoiseFloor],
    folds: CrossFitting,
) -> Confirmed:
    """Drop effects that do not hold without the data that chose them, and test again.

    Effects whose size may be zero at 95 % go, too: `deviations.differs_from_nothing`; so do those
    of `blurred_names`.

    Parameters
    ----------
    model
        With all effects of the catalogue.
    floors
        Of the noise of each joint.
    """
    left_out: list[Found] = []
    doubtful: list[UnconfirmedEffect] = []
    unsure: list[UnconfirmedEffect] = []
    while True:
        result = tested(data, model, floors, folds)
        weak = judged(model.found, result, impossible(data, model, folds))
        if weak:
            doubtful += weak
            fallen = [each.found for each in weak]
            kept = [each for each in model.found if not _among(each, fallen)]
            nonparametric = [each.found for each in weak if each.nonparametric]
            model = built_model(attribution, kept, [*model.nonparametric, *nonparametric])
            result = tested(data, model, floors, folds)
        unknown = [each for each in model.found if not _among(each, sized(data, model))]
        if not unknown:
            blurred = blurred_names(data, model, result.chosen)
            if not blurred:
                break
            unsure.append(blurred[-1])
            unknown = [blurred[-1].found]
        # One at a time, the last accepted first: beside it another may be unknown, and not alone.
        # What only corrected its shape has another chance without it.
        left_out.append(unknown[-1])
        rest = [each for each in attribution.found if not _among(each, left_out)]
        model = named_model(replace(attribution, found=tuple(rest)))
    hints = [
        each
        for number, each in enumerate(doubtful)
        if not _among(each.found, [*model.found, *left_out])
        and not _among(each.found, [other.found for other in doubtful[number + 1 :]])
    ]
    hints += unsure
    return Confirmed(model, result.held_out, tuple(floors), result.chosen, tuple(hints), folds)


def _among(one: Found, others: Sequence[Found]) -> bool:
    return any(one is other for other in others)


def impossible(data: Baseline, model: NamedModel, folds: CrossFitting) -> list[str]:
    """Why each effect cannot be what it is named; see `possible`."""
    if not model.found:
        return []
    drifts = any(each.candidate.effect.family == "time" for each in model.found)
    divided = folds.choices(interleaved=drifts).folds
    covered = operating_range(data)
    ends = np.cumsum(model.regression.widths)
    reasons = []
    for number, (each, end) in enumerate(zip(model.found, ends, strict=True)):
        coefficients = model.fit.coefficients[end - each.candidate.width : end]
        reasons.append(
            why_impossible(each, coefficients, covered, divided)
            or why_of_the_gain(data, each, model.fit, coefficients)
            or why_of_pulses(data, model, number)
        )
    return reasons


def judged(
    found: Sequence[Found], result: FoldTest, impossible: Sequence[str]
) -> list[UnconfirmedEffect]:
    """Effects that do not hold without the data that chose them, each with the reason.

    Parameters
    ----------
    impossible
        Why each cannot be what it is named; empty where it may be.
    """
    weak: list[UnconfirmedEffect] = []
    joints: dict[int, Found] = {}  # where what came later may correct what does not hold
    for number, (each, chosen, no_such) in enumerate(
        zip(found, result.chosen, impossible, strict=True)
    ):
        joint = each.candidate.place.joint
        doubt = _why_not(result.held_out, number, each, chosen)
        reason = no_such or doubt
        if joint in joints:
            first = joints[joint].candidate.effect.name.replace("_", " ")
            reason = f"it was found beside {first}, which does not hold there"
        if reason:
            joints.setdefault(joint, each)
            weak.append(
                UnconfirmedEffect(
                    each, chosen, reason, nonparametric=not doubt and reason == no_such
                )
            )
    return weak


def sized(data: Baseline, model: NamedModel) -> list[Found]:
    """Effects whose size is known to differ from zero beside the others."""
    starts = np.concatenate([[0], np.cumsum(model.regression.widths)]).astype(int)
    return [
        each
        for each, start in zip(model.found, starts[:-1], strict=True)
        if differs_from_nothing(data, model.regression, model.fit, each.candidate, int(start))
    ]


def blurred_names(
    data: Baseline, model: NamedModel, chosen: Sequence[Chosen]
) -> list[UnconfirmedEffect]:
    """Effects that are there, but neither their numbers nor what else is excluded give the name.

    Where each of its numbers may be zero, an effect is named only if nothing of another family
    predicts as well: a weak bend of the torque passes for a saturation of any knee.
    """
    starts = np.concatenate([[0], np.cumsum(model.regression.widths)]).astype(int)
    made = []
    for each, times, start in zip(model.found, chosen, starts[:-1], strict=True):
        family = each.candidate.effect.family
        others = [o for o, _ in each.indistinguishable_from if o.effect.family != family]
        if others and not numbers_differ_from_nothing(
            data, model.regression, model.fit, each.candidate, int(start)
        ):
            name = others[0].effect.name.replace("_", " ")
            made.append(
                UnconfirmedEffect(
                    each,
                    times,
                    f"each of its numbers may be zero, and {name} at "
                    f"{data.joints[others[0].place.joint]} predicts as well",
                )
            )
    return made


def _why_not(tested: HeldOut, number: int, found: Found, chosen: Chosen) -> str:
    """Why an effect is only a hint; empty where it holds."""
    if chosen.standing_in < settings.LEAST_FOLDS_CHOSEN * chosen.folds:
        return (
            f"a search without one fold finds it in only {chosen.standing_in} of {chosen.folds} "
            "folds"
        )
    stage = tested.refit + number
    gap = tested.gap(stage, stage + 1, found.candidate.place.joint)
    gain, folds, _ = tested.gain(number)
    share, beside_best = tested.helped(number)
    sure = gap.after < gap.before and tested.surely_helped(number)
    drifts = found.candidate.effect.family == "time"
    least = settings.HELD_OUT_LEAST_FOLDS_OF_DRIFT if drifts else settings.HELD_OUT_LEAST_FOLDS
    smallest = settings.HELD_OUT_LEAST_GAIN_OF_DRIFT if drifts else settings.HELD_OUT_LEAST_GAIN
    if gain < smallest:
        return f"it takes only {100.0 * gain:.2g} % of the residual on data that did not choose it"
    if share < least:
        return (
            f"it helps on only {folds} of the {chosen.standing_in} folds that choose it, in which "
            f"{100.0 * share:.0f} % of what it does lies"
        )
    if not beside_best:
        return "it helps on one fold alone: it rests on one stretch of time"
    if not sure:
        return "on data that did not choose it the torque gap may have shrunk by chance"
    return ""
