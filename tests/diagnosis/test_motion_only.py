"""Testability, tracking and noise floor on a simulated two-joint arm."""

from dataclasses import replace

import numpy as np
import pytest

from bags.simulated_arms import arm2
from idim_iv_ros.diagnosis.comparison.candidate import Catalogue, Kind
from idim_iv_ros.diagnosis.identifiability import (
    not_shown_by_motion,
)
from idim_iv_ros.diagnosis.likelihood import Regression
from idim_iv_ros.diagnosis.refit.baseline import Baseline, baseline, smooth_regression
from idim_iv_ros.diagnosis.refit.noise_floor import noise_floors, repeats_of
from idim_iv_ros.diagnosis.tracking import simulated_tracking, simulation_gap, tracking_series
from idim_iv_ros.diagnosis.where import where
from idim_iv_ros.effects.registry import STRUCTURAL
from tests.estimation.test_simulated_arms import recorded
from tests.inputs import changed


@pytest.fixture(scope="module")
def data() -> Baseline:
    arm = arm2(seconds=10.0)
    return baseline([recorded(arm, seed) for seed in (1, 2)], arm.configuration)


@pytest.fixture(scope="module")
def regression(data: Baseline) -> Regression:
    return smooth_regression(data)


def test_repeats_tell_the_noise_that_was_put_in(data: Baseline, regression: Regression) -> None:
    repeats = repeats_of(data)
    assert [(r.first, r.second, r.lag) for r in repeats] == [(0, 1, 0)]
    fit = regression.fit()
    limits = np.asarray(data.prepared.configuration.controller.torque_limit)
    rate, edge = data.prepared.motions[0].signals.rate, data.motions[0].decimation.edge
    # White noise of 0.5 % of the limit, through a filter that passes this share of the band.
    expected = 0.005 * limits * np.sqrt(edge * data.row_rate / rate)
    for floor, value in zip(noise_floors(data, regression, fit, repeats), expected, strict=True):
        assert floor.origin == "repeats"
        assert floor.sigma == pytest.approx(value, rel=0.15)
    for floor, colour in zip(
        noise_floors(data, regression, fit, ()), fit.noise_models, strict=True
    ):
        assert floor.origin == "lower bound"
        assert floor.sigma == colour.sigma


def test_efforts_in_ampere_are_not_compared_with_a_model_in_newton_metres(data, regression) -> None:
    configuration = data.prepared.configuration
    current = replace(
        data.prepared, configuration=changed(configuration, "signals", effort_unit="A")
    )
    ampere = replace(data, prepared=current)
    assert current.given is None
    assert "efforts are in A" in current.why_no_given
    fit = regression.fit()
    numbers = [
        {candidate.kind for candidate in Catalogue(one, regression).candidates}
        for one in (ampere, data)
    ]
    assert [Kind.NUMBER in kinds for kinds in numbers] == [False, True]
    gaps, _ = where(ampere, regression, fit, noise_floors(data, regression, fit, ()))
    assert gaps.joints[0].rms == pytest.approx(np.sqrt(np.mean(fit.residuals[0] ** 2)))
    units = {regime.unit for regime in gaps.regimes if regime.axis == "load"}
    assert units <= {"A"}


def test_more_noise_hides_more(data: Baseline, regression: Regression) -> None:
    fit = regression.fit()
    loud = tuple(
        replace(noise, innovation_variance=900.0 * noise.innovation_variance)
        for noise in fit.noise_models
    )
    few = not_shown_by_motion(data, regression, STRUCTURAL, fit.noise_models)
    many = not_shown_by_motion(data, regression, STRUCTURAL, loud)
    assert len(many) > len(few) + 5
    assert {(n.effect, n.joint) for n in few} <= {(n.effect, n.joint) for n in many}
    assert all(refusal.reason and refusal.excitation_needed for refusal in many)


def test_the_refit_tracks_better_than_the_given_model(data: Baseline) -> None:
    given = data.prepared.given
    assert given is not None
    before = simulated_tracking(data, given)
    after = simulated_tracking(data, data.estimate.linear.values)
    assert before.rms is not None
    assert after.rms is not None
    gap = simulation_gap(before, after, 0)
    assert gap is not None
    assert gap.before == pytest.approx(before.rms["joint_1"])
    assert gap.shrinkage is not None
    assert gap.shrinkage > 0.3
    series = tracking_series(data, before, after)
    assert len(series) == 4
    assert max(len(one.time) for one in series) <= 1500
    assert series[0].after is not None
    # Reference less simulated, less reference less measured: what the simulation misses.
    missed = np.sqrt(np.mean([(s.after - s.measured) ** 2 for s in series[::2]]))
    assert missed == pytest.approx(after.rms["joint_1"], rel=0.1)
