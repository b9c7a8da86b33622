"""A wrong gain and friction over the load that differs by direction are in each other's sets."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from idim_iv_ros.diagnosis.parametric.gain_beside_friction import with_friction, with_gains
from idim_iv_ros.diagnosis.refit.baseline import Baseline
from idim_iv_ros.diagnosis.refit.smooth_motion import SmoothMotion
from idim_iv_ros.diagnosis.result import Indistinguishable
from idim_iv_ros.diagnosis.structural.attribution import attribute
from idim_iv_ros.diagnosis.structural.causes import named_model
from idim_iv_ros.effects.load_dependent_friction import LoadDependentFriction
from tests.diagnosis.simulated_sessions import arm2_session
from tests.diagnosis.test_attribution import world


@pytest.fixture(scope="module")
def data() -> Baseline:
    return arm2_session(24.0)


def sets(data: Baseline, gain: float) -> list[list[tuple[str, int]]]:
    """Sets of what is found where joint 1 has friction over the load, and a gain."""

    def torque(motion: SmoothMotion) -> np.ndarray:
        friction = 0.15 * np.abs(motion.load[:, 0]) * motion.slip[:, 0]
        return np.asarray(friction + gain * motion.torque[:, 0])

    found = attribute(data, world(data, 1, 0, torque), [LoadDependentFriction()])
    model = with_gains(data, named_model(found))
    assert [each.candidate.effect.name for each in model.found] == ["load_dependent_friction"]
    return [[other.key[:2] for other, _ in each.indistinguishable_from] for each in model.found]


def test_a_gain_beside_friction_over_the_load_may_be_what_differs_by_direction(
    data: Baseline,
) -> None:
    assert sets(data, 0.08) == [[("torque_gain", 0)]]


def test_friction_that_is_the_same_in_both_directions_holds_no_gain(data: Baseline) -> None:
    assert sets(data, 0.0) == [[]]


@dataclass(frozen=True)
class Named:
    """What the sets ask of a cause."""

    effect: str
    joint: str
    indistinguishable_from: tuple[Indistinguishable, ...] = ()


def test_a_named_gain_has_the_friction_in_its_set_too() -> None:
    friction = Named(
        "load_dependent_friction", "j1", (Indistinguishable("torque_gain", "j1", 0.99),)
    )
    gain, elsewhere = Named("torque_gain", "j1"), Named("torque_gain", "j2")
    assert with_friction([friction, gain, elsewhere]) == [  # type: ignore[list-item, comparison-overlap]
        friction,
        replace(
            gain, indistinguishable_from=(Indistinguishable("load_dependent_friction", "j1", 0.99),)
        ),
        elsewhere,
    ]
