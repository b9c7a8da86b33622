"""Numbers that no hardware has, and knees that were not reached."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from idim_iv_ros.diagnosis.structural.attribution import Found
from idim_iv_ros.diagnosis.structural.confidence import _same_torque
from idim_iv_ros.diagnosis.structural.nonparametric import NONPARAMETRIC
from idim_iv_ros.diagnosis.structural.possible import why_impossible, why_not_reached
from idim_iv_ros.effects.backlash import Backlash, BacklashShape
from idim_iv_ros.effects.contribution import Load
from idim_iv_ros.effects.effect import Effect, OperatingRange, Shape
from idim_iv_ros.effects.elasticity import Elasticity, ShaftShape
from idim_iv_ros.effects.load_dependent_friction import LoadDependentFriction, LoadShape
from idim_iv_ros.effects.time_delay import DelayShape, TimeDelay
from idim_iv_ros.effects.torque_saturation import KneeShape, TorqueSaturation

INERTIA = 0.5  # kg m²
ONE = np.ones(1)
COVERED = OperatingRange(
    low=-ONE, high=ONE, slowest=0.01 * ONE, fastest=ONE, load=5.0 * ONE, torque=20.0 * ONE,
    inertia=INERTIA * ONE, duration=20.0, longest=20.0, row_rate=50.0, lever=ONE,
)  # fmt: skip


def shaft(hertz: float, share_of_critical: float) -> ShaftShape:
    """From m ω² = k and c = 2 ζ √(k m)."""
    stiffness = INERTIA * (2.0 * np.pi * hertz) ** 2
    return ShaftShape(stiffness, share_of_critical * 2.0 * np.sqrt(stiffness * INERTIA))


@pytest.mark.parametrize(
    ("effect", "shape", "coefficient", "words"),
    [
        (Elasticity(), shaft(12.0, 0.1), 1.0, ""),
        (Elasticity(), shaft(12.0, 0.9), 1.0, ""),
        (Elasticity(), shaft(12.0, 1.2), 1.0, "1.2 times beyond critical"),
        (Elasticity(), shaft(3.4, 0.1), 1.0, "swing at 3.4 Hz"),
        # A coefficient of a quarter is a shaft that is four times as stiff: twice the frequency.
        (Elasticity(), shaft(60.0, 0.1), 0.25, "swing at 120 Hz"),
        (Elasticity(), shaft(3.0, 0.1), 0.25, ""),
        (Backlash(), BacklashShape(0.039, 1e3, 1.0, 5.0), 1.0, ""),
        (Backlash(), BacklashShape(0.06, 1e3, 1.0, 5.0), 1.0, "a play of 0.06 rad"),
        (TimeDelay(), DelayShape(0.012), 1.5, ""),
        (TimeDelay(), DelayShape(0.012), 2.0, "24 ms"),
        (LoadDependentFriction(), LoadShape(1.0, 5.0, False, Load.LINKS), 0.4, ""),
        (
            LoadDependentFriction(),
            LoadShape(1.0, 5.0, False, Load.LINKS),
            1.3,
            "1.3 times the load",
        ),
    ],
)
def test_numbers_that_no_arm_has(
    effect: Effect, shape: Shape, coefficient: float, words: str
) -> None:
    said = effect.impossible(shape, np.array([coefficient]), 0, COVERED)
    assert words in said
    assert bool(said) == bool(words)


FOLDS = np.repeat([0, 1, 2, -1], 100)


def beyond(*shares: float) -> np.ndarray:
    """Torque that acts on a share of the rows of each fold."""
    torque = np.zeros(len(FOLDS))
    for fold, share in enumerate(shares):
        torque[100 * fold : 100 * fold + round(100 * share)] = 2.0
    return torque


@pytest.mark.parametrize(
    ("torque", "words"),
    [
        (beyond(0.1, 0.03, 0.0), ""),
        (beyond(0.1, 0.0, 0.0), "in 1 of 3 folds"),
        (beyond(0.0, 0.0, 0.0), "in 0 of 3 folds"),
        (beyond(0.9, 0.95, 0.9), "% of the motion is beyond the knee"),
    ],
)
def test_a_knee_is_passed_seldom_and_in_two_folds(torque: np.ndarray, words: str) -> None:
    said = why_not_reached(torque, FOLDS)
    assert words in said
    assert bool(said) == bool(words)


def found(effect: Effect, torque: np.ndarray) -> Found:
    candidate: Any = SimpleNamespace(
        effect=effect,
        shape=KneeShape(5.0),
        place=SimpleNamespace(joint=0),
        columns={0: torque[:, None]},
    )
    return Found(candidate)


def test_only_effects_with_a_knee_are_asked_for_it() -> None:
    everywhere = found(TorqueSaturation(), beyond(1.0, 1.0, 1.0))
    assert "no limit" in why_impossible(everywhere, ONE, COVERED, [FOLDS])
    seldom = found(TorqueSaturation(), beyond(0.1, 0.1, 0.0))
    assert why_impossible(seldom, ONE, COVERED, [FOLDS]) == ""


@pytest.mark.parametrize(
    ("effect", "same"), [(Elasticity(), False), (TimeDelay(), True)], ids=["elasticity", "delay"]
)
def test_a_lag_of_the_drive_is_compared_with_a_shaft_and_describes_a_delay(
    effect: Effect, same: bool
) -> None:
    (lags,) = (each for each in NONPARAMETRIC if each.name == "dynamics of the torque")
    other: Any = SimpleNamespace(effect=lags)
    assert _same_torque(found(effect, beyond(0.1)), other) == same
