"""Knees of the torque beside the torque that the accepted effects leave to the model.

The search computes its columns from the torque of the refit, and a refit to a saturated torque is
bent by it: fitted to commands of 30 N m where 27 act, it crosses the knee late. With the saturation
in the model its parameters are those of the robot, and the torque that follows from them, with the
other effects, crosses the knee where the robot does. So the knee is fitted again there, and so on.
"""

from dataclasses import replace

from idim_iv_ros.diagnosis.refit.baseline import Baseline, with_parameters
from idim_iv_ros.diagnosis.structural.attribution import Attribution, Found
from idim_iv_ros.diagnosis.structural.candidate import operating_range
from idim_iv_ros.diagnosis.structural.causes import NamedModel, built_model
from idim_iv_ros.diagnosis.structural.search import Search

_ROUNDS = 3  # the knee moves by a fifth of its first error in the last


def with_knees_refitted(data: Baseline, attribution: Attribution, model: NamedModel) -> NamedModel:
    """Return the model with each knee fitted to the torque of the model itself.

    Parameters
    ----------
    attribution
        Of the refit without effects.
    model
        With all effects that hold.
    """
    for _ in range(_ROUNDS):
        found = [
            _refitted(data, attribution, model, each) if each.candidate.effect.beyond_knee else each
            for each in model.found
        ]
        if all(one is other for one, other in zip(found, model.found, strict=True)):
            return model
        model = built_model(attribution, found, model.nonparametric)
    return model


def _refitted(data: Baseline, attribution: Attribution, model: NamedModel, this: Found) -> Found:
    """One effect with its best shape beside the others, on the torque of the model."""
    regression = attribution.regression
    for each in model.found:
        if each is not this:
            regression = regression.with_columns(each.candidate.columns)
    own = with_parameters(data, model.fit.values)
    fit = regression.fit(model.fit.noise_models)
    search = Search(own, operating_range(own), regression, fit, {})
    best = search.best(this.candidate.effect, this.candidate.place)
    return this if best is None else replace(this, candidate=best)
