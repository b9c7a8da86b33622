"""Friction over the load that differs by direction of the power holds a wrong torque gain.

With a share of the load for each direction, the half of their difference is a torque in proportion
to the load: what a wrong gain of the joint adds, beside its drive and friction, which are free. No
recording of the joint tells one from the other.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.parametric.errors_beyond_base import GainError
from idim_iv_ros.diagnosis.parametric.significance import differs
from idim_iv_ros.diagnosis.refit.baseline import Baseline
from idim_iv_ros.diagnosis.result import Cause, Indistinguishable
from idim_iv_ros.diagnosis.structural.attribution import Found
from idim_iv_ros.diagnosis.structural.candidate import Candidate, rows_of
from idim_iv_ros.diagnosis.structural.causes import NamedModel
from idim_iv_ros.diagnosis.structural.likelihood import Columns
from idim_iv_ros.effects.effect import Place, Shape
from idim_iv_ros.effects.load_dependent_friction import LoadDependentFriction, LoadShape
from idim_iv_ros.estimation.qr import NOT_SHOWN, independent_basis

_GAIN = GainError()


def with_gains(data: Baseline, model: NamedModel) -> NamedModel:
    """Put a gain into the set of each friction that differs by direction and may hold it."""
    found = tuple(_with_gain(data, model, each, number) for number, each in enumerate(model.found))
    return replace(model, found=found)


def with_friction(causes: Sequence[Cause]) -> list[Cause]:
    """Put the friction into the set of each gain that is in its own."""
    holding = {
        cause.joint: one.correlation
        for cause in causes
        if cause.effect == LoadDependentFriction.name
        for one in cause.indistinguishable_from
        if one.effect == _GAIN.name and one.joint == cause.joint
    }
    made = []
    for cause in causes:
        known = {(one.effect, one.joint) for one in cause.indistinguishable_from}
        friction = (LoadDependentFriction.name, cause.joint)
        if cause.effect == _GAIN.name and cause.joint in holding and friction not in known:
            other = Indistinguishable(*friction, holding[cause.joint])
            others = (*cause.indistinguishable_from, other)
            cause = replace(cause, indistinguishable_from=others)
        made.append(cause)
    return made


def _with_gain(data: Baseline, model: NamedModel, this: Found, number: int) -> Found:
    candidate, shape = this.candidate, this.candidate.shape
    place = Place(candidate.place.joint)
    if not isinstance(shape, LoadShape) or not shape.two_directions:
        return this
    known = {other.key for other, _ in this.indistinguishable_from}
    if (_GAIN.name, place.joint, None) in known:
        return this
    start = sum(model.regression.widths[:number])
    driving, driven = model.fit.coefficients[start : start + 2]
    covariance = model.fit.coefficient_covariance[start : start + 2, start : start + 2]
    step = np.array([1.0, -1.0])
    gain = 0.5 * float(driving - driven)
    if not differs(gain, 0.5 * float(np.sqrt(step @ covariance @ step))):
        return this
    if abs(gain) < settings.LEAST_PARAMETER_ERROR:
        return this
    columns = rows_of(data, _GAIN, place, [Shape()])[0]
    correlation = _held(model, number, columns)
    if correlation < settings.CONFOUNDER_CORRELATION:
        return this
    imitating = Candidate(
        _GAIN,
        place,
        Shape(),
        columns,
        np.array([gain]),
        {place.joint: candidate.residuals[place.joint]},
        candidate.gain,
        candidate.explained,
        numbers=1,
        tried=1,
    )
    pairs = (*this.indistinguishable_from, (imitating, correlation))
    return replace(this, indistinguishable_from=pairs)


def _held(model: NamedModel, number: int, gain: Columns) -> float:
    """Multiple correlation of a gain's torque, beside the model, with the columns of one effect."""
    regression = model.regression.with_columns(gain)
    factor = regression.fit(model.fit.noise_models, steps=0).factor
    start = regression.parameters + sum(regression.widths[:number])
    own = np.arange(start, start + regression.widths[number])
    others = np.setdiff1d(np.arange(regression.total - 1), own)
    torque = factor[:, [regression.total - 1]]
    alone = independent_basis(factor[:, others], tolerance=NOT_SHOWN).remove(torque)
    beside = independent_basis(factor[:, : regression.total - 1], tolerance=NOT_SHOWN)
    share = float(np.sum(beside.remove(torque) ** 2)) / max(float(np.sum(alone**2)), 1e-300)
    return float(np.sqrt(max(1.0 - share, 0.0)))
