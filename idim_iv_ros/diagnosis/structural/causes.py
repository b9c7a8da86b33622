"""From accepted effects to causes with numbers, evidence and a sentence."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from idim_iv_ros.diagnosis import sentences, settings
from idim_iv_ros.diagnosis.held_out.held_out import HeldOut
from idim_iv_ros.diagnosis.parametric.errors_beyond_base import ErrorBeyondBase
from idim_iv_ros.diagnosis.parametric.significance import differs
from idim_iv_ros.diagnosis.refit.baseline import Baseline
from idim_iv_ros.diagnosis.result import (
    Cause,
    EffectParameter,
    Evidence,
    Indistinguishable,
    SimulationGap,
)
from idim_iv_ros.diagnosis.structural.attribution import Attribution, Found
from idim_iv_ros.diagnosis.structural.deviations import parameters_of
from idim_iv_ros.diagnosis.structural.likelihood import Fit, Regression
from idim_iv_ros.diagnosis.structural.nonparametric import Nonparametric
from idim_iv_ros.effects.effect import Place
from idim_iv_ros.simulation import SimulatedEffect


@dataclass(frozen=True)
class NamedModel:
    """The refit with the accepted effects of the catalogue.

    Attributes
    ----------
    found : tuple of Found
        In the order in which they were accepted.
    nonparametric : tuple of Found
        Functions outside the catalogue that explain more than any effect does, and effects with
        numbers that no hardware has (`possible`).
    regression : Regression
        With one block for each of `found`.
    fits : tuple of Fit
        Of the refit, and with the first, the first two … effects.
    """

    found: tuple[Found, ...]
    nonparametric: tuple[Found, ...]
    regression: Regression
    fits: tuple[Fit, ...]

    def with_nonparametric(self, sizes: Sequence[float]) -> Regression:
        """With the nonparametric functions that matter, and the constants of the effects' laws.

        Parameters
        ----------
        sizes
            RMS of the torque of each joint, N m (N).
        """
        regression = self.regression
        for each in self.nonparametric:
            if each.candidate.share_of_torque(sizes) >= settings.LEAST_NONPARAMETRIC:
                regression = regression.with_columns(each.candidate.columns)
        for each in self.found:
            if each.candidate.effect.with_constant:
                constants = {
                    joint: np.ones((len(rows), 1)) for joint, rows in each.candidate.columns.items()
                }
                regression = regression.with_columns(constants)
        return regression

    def for_parameters(self, data: Baseline) -> tuple[Regression, Fit]:
        """Regression and fit from which parameter errors are read.

        With the nonparametric functions that matter: parameters in error would pass for them.
        """
        regression = self.with_nonparametric(data.torque_sizes)
        return regression, regression.fit(self.fit.noise_models)

    @property
    def fit(self) -> Fit:
        """With all effects."""
        return self.fits[-1]


def named_model(attribution: Attribution) -> NamedModel:
    """Keep the effects of the catalogue, unless a nonparametric one at the same joint was first."""
    kept: list[Found] = []
    nonparametric: list[Found] = []
    for each in attribution.found:
        if isinstance(each.candidate.effect, ErrorBeyondBase):
            continue
        if isinstance(each.candidate.effect, Nonparametric):
            nonparametric.append(each)
        elif not any(
            set(other.candidate.columns) & set(each.candidate.columns) for other in nonparametric
        ):
            kept.append(each)
    model = built_model(attribution, kept, nonparametric)
    small = _corrections(model)
    if small:
        model = built_model(
            attribution, [each for each in kept if each not in small], nonparametric
        )
    return model


def built_model(
    attribution: Attribution, found: Sequence[Found], nonparametric: Sequence[Found]
) -> NamedModel:
    """Add effects one after the other to the refit."""
    regression = attribution.regression
    fits = [attribution.refit]
    for each in found:
        regression = regression.with_columns(each.candidate.columns)
        fits.append(regression.fit(fits[-1].noise_models, steps=settings.NOISE_MODEL_MORE_STEPS))
    return NamedModel(tuple(found), tuple(nonparametric), regression, tuple(fits))


def _corrections(model: NamedModel) -> list[Found]:
    """Effects that explain almost nothing beside a stronger one at the same joint.

    They correct the shape that the catalogue gives the stronger one.
    """
    taken = []
    for each, before, after in zip(model.found, model.fits[:-1], model.fits[1:], strict=True):
        joint = each.candidate.place.joint
        energy = [float(fit.residuals[joint] @ fit.residuals[joint]) for fit in (before, after)]
        taken.append((joint, energy[0] - energy[1], each.candidate.gain))
    return [
        each
        for each, (joint, energy, gain) in zip(model.found, taken, strict=True)
        if any(
            other == joint and larger > gain and energy < settings.LEAST_BESIDE_STRONGER * best
            for other, best, larger in taken
        )
    ]


def effect_parameters(model: NamedModel, number: int) -> dict[str, EffectParameter]:
    """Parameters of one effect in the model with all of them, its shape held."""
    candidate = model.found[number].candidate
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


def label(data: Baseline, found: Found) -> str:
    """Name of the stage that an effect adds."""
    return f"+{found.candidate.effect.name}[{data.joints[found.candidate.place.joint]}]"


@dataclass(frozen=True)
class Selection:
    """How surely the search chose an effect.

    Attributes
    ----------
    chosen_in_folds : str
        Such as ``5 of 5``.
    p_value : float or None
        See `Evidence`.
    p_value_from : str
    """

    chosen_in_folds: str
    p_value: float | None
    p_value_from: str


def structural_causes(
    data: Baseline,
    model: NamedModel,
    tested: HeldOut,
    simulations: Sequence[SimulationGap | None],
    selections: Sequence[Selection],
) -> list[Cause]:
    """One cause for each accepted effect.

    Parameters
    ----------
    tested
        Held-out residuals of the stages of `model`.
    simulations
        Gap of the simulated motion before and after each effect.
    selections
        How surely each was chosen.
    """
    causes = []
    for number, (found, simulation, selection) in enumerate(
        zip(model.found, simulations, selections, strict=True)
    ):
        candidate, place = found.candidate, found.candidate.place
        stage = tested.refit + number
        gap = tested.gap(stage, stage + 1, place.joint)
        gain, helped, folds = tested.gain(number)
        numbers = parameters_of(
            data, model.regression, model.fit, candidate, sum(model.regression.widths[:number])
        )
        others = [other for other, _ in found.indistinguishable_from]
        known = [each for each in numbers.values() if each.std]
        each_known = not known or any(differs(each.value, each.std) for each in known)
        statistic = max(2.0 * candidate.gain, 0.0)
        causes.append(
            Cause(
                effect=candidate.effect.name,
                kind="structural",
                joint=data.joints[place.joint],
                other_joint=None if place.other is None else data.joints[place.other],
                parameters=data.in_units_at(place.joint, numbers),
                evidence=Evidence(
                    statistic=statistic,
                    p_value=selection.p_value,
                    held_out_gain=gain,
                    folds_positive=f"{helped} of {folds}",
                    chosen_in_folds=selection.chosen_in_folds,
                    p_value_from=selection.p_value_from,
                ),
                indistinguishable_from=tuple(
                    Indistinguishable(
                        other.effect.name, data.joints[other.place.joint], correlation
                    )
                    for other, correlation in found.indistinguishable_from
                ),
                torque_gap=gap,
                simulation_gap=simulation,
                sentence=sentences.structural_cause(
                    data, candidate, others, gap, gain, together=not each_known
                ),
                joint_gaps=(data.joint_change(place.joint, gap.before, gap.after),),
            )
        )
    return causes
