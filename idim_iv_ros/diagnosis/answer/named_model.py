"""The refit with the structural effects that are causes, one stage after the other."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.comparison.beside import Term
from idim_iv_ros.diagnosis.likelihood import Fit, Regression, white_noise_models
from idim_iv_ros.diagnosis.refit.baseline import Baseline
from idim_iv_ros.diagnosis.result import EffectParameter
from idim_iv_ros.diagnosis.structural.candidate import Candidate
from idim_iv_ros.effects.effect import Place
from idim_iv_ros.effects.parametric_effect import ParametricEffect
from idim_iv_ros.simulation import SimulatedEffect


@dataclass(frozen=True)
class NamedModel:
    """The refit with structural effects.

    Attributes
    ----------
    effects : tuple of Candidate
        Of the catalogue, in the order of their stages.
    outside : tuple of Candidate
        Free curves, and effects that are not adequate: what the catalogue does not explain.
    regression : Regression
        With one block for each of `effects`.
    fits : tuple of Fit
        Of the refit, and with the first, the first two … effects.
    whole : Fit
        With what lies outside the catalogue and matters, and with the numbers that no base
        parameters hold, too.
    """

    effects: tuple[Candidate, ...]
    outside: tuple[Candidate, ...]
    regression: Regression
    fits: tuple[Fit, ...]
    whole: Fit

    @property
    def fit(self) -> Fit:
        """With all effects."""
        return self.fits[-1]


def named_model(
    regression: Regression,
    effects: Sequence[Term],
    outside: Sequence[Term],
    numbers: Sequence[Term],
    sizes: Sequence[float],
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
    sizes
        RMS of the torque of each joint, N m (N).
    """
    fits, made = [regression.fit()], []
    for term in effects:
        candidate, regression, fit = _added(regression, fits[-1], term)
        made.append(candidate)
        fits.append(fit)
    whole, curves = regression, []
    for term in outside:
        curve = _added(regression, fits[-1], term)[0]
        curves.append(curve)
        if curve.share_of_torque(sizes) >= settings.LEAST_NONPARAMETRIC:
            whole = whole.with_columns(curve.columns)
    for term in numbers:
        effect = term.candidate.effect
        if not isinstance(effect, ParametricEffect) or not effect.in_base_parameters:
            whole = whole.with_columns(term.columns)
    fit = fits[-1] if whole is regression else whole.fit(fits[-1].noise_models)
    return NamedModel(tuple(made), tuple(curves), regression, tuple(fits), fit)


def _added(regression: Regression, before: Fit, term: Term) -> tuple[Candidate, Regression, Fit]:
    """A term as a candidate beside a regression, and the regression with it, fitted."""
    effect, place = term.candidate.effect, term.candidate.place
    assert not isinstance(effect, ParametricEffect)
    assert place is not None and term.shape is not None
    larger = regression.with_columns(term.columns)
    fit = larger.fit(before.noise_models, steps=settings.NOISE_MODEL_MORE_STEPS)
    white = white_noise_models(regression.joints, before.residuals)
    without, beside = (each.fit(white, steps=0).residuals for each in (regression, larger))
    left = [_energy(beside[j]) / max(_energy(without[j]), 1e-300) for j in place.joints]
    candidate = Candidate(
        effect,
        place,
        term.shape,
        term.columns,
        fit.coefficients[-term.width :],
        {joint: fit.residuals[joint] for joint in place.joints},
        gain=larger.gain_of_last(fit),
        explained=1.0 - float(np.mean(left)),
    )
    return candidate, larger, fit


def _energy(residual: np.ndarray) -> float:
    return float(np.vdot(residual, residual))


def effect_parameters(model: NamedModel, number: int) -> dict[str, EffectParameter]:
    """Parameters of one effect in the model with all of them, at its shape."""
    candidate = model.effects[number]
    start = sum(model.regression.widths[:number])
    part = slice(start, start + candidate.width)
    deviations = np.sqrt(np.maximum(np.diag(model.fit.coefficient_covariance)[part], 0.0))
    return candidate.effect.parameters(candidate.shape, model.fit.coefficients[part], deviations)


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


def label(data: Baseline, candidate: Candidate) -> str:
    """Name of the stage that an effect adds."""
    return f"+{candidate.effect.name}[{data.joints[candidate.place.joint]}]"
