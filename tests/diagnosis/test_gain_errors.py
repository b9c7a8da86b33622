"""A wrong torque gain is named where errors of inertials, friction and drives cannot imitate it."""

from dataclasses import replace

import numpy as np
import pytest

from idim_iv_ros.diagnosis.parametric.causes import ParametricOutcome, parametric_causes
from idim_iv_ros.diagnosis.parametric.change_regression import change_regression
from idim_iv_ros.diagnosis.parametric.confirmed import confirmed
from idim_iv_ros.diagnosis.parametric.other_errors import errors_of_drives, errors_of_links
from idim_iv_ros.diagnosis.parametric.significance import differs
from idim_iv_ros.diagnosis.refit.baseline import Baseline, smooth_regression
from idim_iv_ros.diagnosis.structural.likelihood import Regression
from idim_iv_ros.effects.parametric_effect import Change
from tests.diagnosis.simulated_sessions import arm2_session

NOISE = (0.15, 0.05)  # N m, of a row


@pytest.fixture(scope="module")
def data() -> Baseline:
    return arm2_session(12.0)


def world(
    data: Baseline, seed: int, error: np.ndarray, gains: tuple[float, float] = (1.0, 1.0)
) -> Regression:
    """Rows where the base parameters are off by an error and recorded torques scaled."""
    random = np.random.default_rng(seed)
    plain = smooth_regression(data)
    true = data.prepared.model.given + error
    joints = tuple(
        replace(
            rows,
            torque=gain * (rows.matrix @ true[rows.columns])
            + noise * random.standard_normal(len(rows.torque)),
        )
        for rows, gain, noise in zip(plain.joints, gains, NOISE, strict=True)
    )
    return Regression(joints, plain.parameters)


def found(data: Baseline, regression: Regression) -> ParametricOutcome:
    return parametric_causes(data, regression, regression.fit())


def of_everything(data: Baseline, seed: int, size: float) -> np.ndarray:
    """Errors of all links, drives and frictions by some relative size."""
    model = data.prepared.model
    random = np.random.default_rng(seed)
    standard = np.hstack([errors_of_links(model), errors_of_drives(model)])
    change = standard @ (size * random.standard_normal(standard.shape[1]))
    return np.asarray(model.base.grouping @ change)


def names(outcome: ParametricOutcome) -> list[tuple[str, str | None]]:
    return [(cause.effect.name, cause.joint) for cause in outcome.causes]


@pytest.mark.parametrize("joint", [0, 1])
@pytest.mark.parametrize("factor", [0.9, 1.15])
def test_a_wrong_gain_is_named_alone_with_its_size(
    data: Baseline, joint: int, factor: float
) -> None:
    gains = (factor, 1.0) if joint == 0 else (1.0, factor)
    outcome = found(data, world(data, 1, np.zeros(len(data.prepared.model.given)), gains))
    assert names(outcome) == [("torque_gain", data.joints[joint])]
    number = outcome.causes[0].parameters["factor"]
    assert number.std is not None
    assert abs(number.value - 1.0 / factor) < 4.0 * number.std + 0.005


@pytest.mark.parametrize("joint", [0, 1])
def test_errors_of_all_other_numbers_do_not_confirm_a_gain(data: Baseline, joint: int) -> None:
    """By the noise alone nearly every gain differs from one; a true one beside them is confirmed.

    Errors of ten percent of everything but the gains, twelve models.
    """
    differing, imitated, told = 0, 0, 0
    for seed in range(12):
        error = of_everything(data, seed, 0.1)
        for factor in (1.0, 1.3):
            gains = (factor, 1.0) if joint == 0 else (1.0, factor)
            regression = world(data, seed, error, gains)
            changes = change_regression(data, regression, regression.fit())
            gain = Change("recorded_more", "", changes.space.gain(joint))
            own = changes.explain([gain]).found
            if factor == 1.0:
                differing += differs(own[0].value, own[0].std)
                imitated += confirmed(changes, own)
            else:
                told += confirmed(changes, [replace(own[0], value=0.3)])
        outcome = found(data, world(data, seed, error))
        assert all(name != "torque_gain" for name, _ in names(outcome))
    assert differing >= 9
    assert imitated == 0
    assert told >= 9


def test_what_imitates_a_gain_is_said(data: Baseline, monkeypatch: pytest.MonkeyPatch) -> None:
    """A gain that takes nearly all, but that base parameters make up for as well."""
    monkeypatch.setattr(
        "idim_iv_ros.diagnosis.parametric.evidence.confirmed", lambda changes, own: False
    )
    right = np.zeros(len(data.prepared.model.given))
    outcome = found(data, world(data, 1, right, (1.0, 1.15)))
    others = {(each.effect, each.joint) for each in outcome.causes[0].indistinguishable_from}
    joint = data.joints[1]
    assert others >= {("friction_level", joint), ("link_inertia", joint)}
