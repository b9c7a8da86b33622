"""The refit with the structural effects that are causes, one stage after the other."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.comparison.model_with_terms import Term
from idim_iv_ros.diagnosis.likelihood import Fit, Regression
from idim_iv_ros.diagnosis.refit.baseline import Baseline
from idim_iv_ros.diagnosis.result import EffectParameter
from idim_iv_ros.effects.effect import Place
from idim_iv_ros.effects.parametric_effect import ParametricEffect
from idim_iv_ros.simulation import SimulatedEffect


@dataclass(frozen=True)
class NamedModel:
    """The refit with structural effects.

    Attributes
    ----------
    effects : tuple of Term
        Of the catalogue, in the order of their stages.
    outside : tuple of Term
        Free curves, and effects that are not adequate: what the catalogue does not explain.
    regression : Regression
        With one block for each of `effects`.
    fits : tuple of Fit
        Of the refit, and with the first, the first two … effects.
    whole : Fit
        With what lies outside the catalogue and matters, and with the numbers that no base
        parameters hold, too.
    """

    effects: tuple[Term, ...]
    outside: tuple[Term, ...]
    regression: Regression
    fits: tuple[Fit, ...]
    whole: Fit

    @property
    def fit(self) -> Fit:
        """With all effects."""
        return self.fits[-1]


def matters(term: Term) -> bool:
    """Whether what lies outside the catalogue is large enough to be said."""
    return float(term.visible[term.place.joint]) >= settings.LEAST_NONPARAMETRIC


def named_model(
    regression: Regression,
    effects: Sequence[Term],
    outside: Sequence[Term],
    numbers: Sequence[Term],
) -> NamedModel:
    """Add effects one after the other to the refit.

    Parameters
    ----------
    regression
        Of the refit.
    effects, outside
        Terms that are causes, and what lies outside the catalogue.
    numbers
        Further terms; those that are no base parameters are part of the whole.
    """
    fits = [regression.fit()]
    for term in effects:
        regression = regression.with_columns(term.columns)
        fits.append(regression.fit(fits[-1].noise_models, steps=settings.NOISE_MODEL_MORE_STEPS))
    whole = regression
    for term in filter(matters, outside):
        whole = whole.with_columns(term.columns)
    for term in numbers:
        effect = term.candidate.effect
        if not isinstance(effect, ParametricEffect) or not effect.in_base_parameters:
            whole = whole.with_columns(term.columns)
    fit = fits[-1] if whole is regression else whole.fit(fits[-1].noise_models)
    return NamedModel(tuple(effects), tuple(outside), regression, tuple(fits), fit)


def effect_parameters(model: NamedModel, number: int) -> dict[str, EffectParameter]:
    """Parameters of one effect in the model with all of them, at its shape."""
    term = model.effects[number]
    start = sum(model.regression.widths[:number])
    part = slice(start, start + term.width)
    deviations = np.sqrt(np.maximum(np.diag(model.fit.coefficient_covariance)[part], 0.0))
    return term.effect.parameters(term.shape, model.fit.coefficients[part], deviations)


def simulated_effects(
    data: Baseline, causes: Sequence[tuple[str, Place, dict[str, EffectParameter]]]
) -> list[SimulatedEffect]:
    """Effects as the simulator takes them."""
    return [
        SimulatedEffect(
            name,
            data.joints[place.joint],
            {key: parameter.value for key, parameter in parameters.items()},
            None if place.other is None else data.joints[place.other],
        )
        for name, place, parameters in causes
    ]


def label(data: Baseline, term: Term) -> str:
    """Name of the stage that an effect adds."""
    return f"+{term.effect.name}[{data.joints[term.place.joint]}]"
