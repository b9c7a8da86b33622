"""Effects that also hold on data not used to fit them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.held_out.held_out import HeldOut, held_out
from idim_iv_ros.diagnosis.identifiability.testability import floor_noise_models
from idim_iv_ros.diagnosis.refit.baseline import Baseline
from idim_iv_ros.diagnosis.refit.noise_floor import NoiseFloor, Repeat, noise_floors, repeats_of
from idim_iv_ros.diagnosis.structural.attribution import Attribution, Found
from idim_iv_ros.diagnosis.structural.causes import NamedModel, built_model, label, named_model
from idim_iv_ros.diagnosis.structural.deviations import differs_from_nothing
from idim_iv_ros.diagnosis.structural.likelihood import Fit
from idim_iv_ros.signals import AutoregressiveModel
from idim_iv_ros.types import FloatArray


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
    """

    model: NamedModel
    tested: HeldOut
    floors: tuple[NoiseFloor, ...]

    def noise(self, refit: Fit) -> tuple[AutoregressiveModel, ...]:
        """Noise models of the refit, no larger than the noise floor."""
        return floor_noise_models(refit, [floor.sigma for floor in self.floors])


def confirmation(data: Baseline, attribution: Attribution) -> Confirmed:
    """Test the effects that were found on data not used to fit; see `confirmed`."""
    repeats = repeats_of(data)
    floors = noise_floors(data, attribution.extended, attribution.fit, repeats)
    model = named_model(attribution)
    return Confirmed(
        *confirmed(data, attribution, model, floors, repeats, data.prepared.given), floors
    )


def confirmed(
    data: Baseline,
    attribution: Attribution,
    model: NamedModel,
    floors: Sequence[NoiseFloor],
    repeats: Sequence[Repeat],
    given: FloatArray | None,
) -> tuple[NamedModel, HeldOut]:
    """Drop effects that do not help on data not used to fit, and test again without them.

    Effects whose size may be zero at 95 % go, too: `deviations.differs_from_nothing`.

    Parameters
    ----------
    model
        With all effects of the catalogue.
    floors
        Of the noise of each joint.
    repeats
        Recordings that repeat one another are held out together.
    given
        (b,) base parameters of the nominal model, None where there is none.

    Returns
    -------
    NamedModel, HeldOut
        The model without them, and the held-out residuals of its stages.
    """

    def tested(model: NamedModel) -> HeldOut:
        labels = [label(data, found) for found in model.found]
        return held_out(
            data,
            model.regression,
            model.fit,
            labels,
            floors,
            repeats,
            given,
            interleaved=any(each.candidate.effect.family == "time" for each in model.found),
        )

    left_out: list[Found] = []
    while True:
        result = tested(model)
        helpful = _helpful(model, result)
        if len(helpful) < len(model.found):
            model = built_model(attribution, helpful, model.nonparametric)
            result = tested(model)
        known = sized(data, model)
        unknown = [each for each in model.found if not any(each is other for other in known)]
        if not unknown:
            return model, result
        # One at a time, the last accepted first: beside it another may be unknown, and not alone.
        # What only corrected its shape has another chance without it.
        left_out.append(unknown[-1])
        rest = [each for each in attribution.found if not any(each is one for one in left_out)]
        model = named_model(replace(attribution, found=tuple(rest)))


def _helpful(model: NamedModel, tested: HeldOut) -> list[Found]:
    """Effects that help on held-out data."""
    helpful: list[Found] = []
    doubtful: set[int] = set()  # joints where what came later may correct what did not hold
    for number, each in enumerate(model.found):
        joint = each.candidate.place.joint
        if joint not in doubtful and _helps(tested, number, each):
            helpful.append(each)
        else:
            doubtful.add(joint)
    return helpful


def sized(data: Baseline, model: NamedModel) -> list[Found]:
    """Effects whose size is known to differ from zero beside the others."""
    starts = np.concatenate([[0], np.cumsum(model.regression.widths)]).astype(int)
    return [
        each
        for each, start in zip(model.found, starts[:-1], strict=True)
        if differs_from_nothing(data, model.regression, model.fit, each.candidate, int(start))
    ]


def _helps(tested: HeldOut, number: int, found: Found) -> bool:
    """Whether the whitened residual and the torque gap shrink on held-out data, not by chance."""
    stage = tested.refit + number
    gap = tested.gap(stage, stage + 1, found.candidate.place.joint)
    gain, helped, folds = tested.gain(number)
    sure = gap.after < gap.before if gap.ci95 is None else gap.ci95[0] > 0.0
    drifts = found.candidate.effect.family == "time"
    least = settings.HELD_OUT_LEAST_FOLDS_OF_DRIFT if drifts else settings.HELD_OUT_LEAST_FOLDS
    return gain >= settings.HELD_OUT_LEAST_GAIN and helped >= least * folds and sure
