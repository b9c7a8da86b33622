"""The refit's closed loop sees the speed that the robot's law used, and then moves as the robot."""

from dataclasses import replace

import numpy as np
import pytest

from bags.simulated_arms import SimulatedArm
from idim_iv_ros.diagnosis.refit.baseline import Baseline, baseline
from idim_iv_ros.diagnosis.tracking import simulated_tracking
from idim_iv_ros.estimation.instruments import SimulatedLoop
from idim_iv_ros.recording import Recording
from idim_iv_ros.simulation import ControlLaw
from tests.estimation.test_simulated_arms import recorded

FACTOR = 0.25  # 3.5 ms late at 1 kHz


@pytest.fixture(scope="module")
def late(arm: SimulatedArm) -> Recording:
    robot = replace(arm, law=replace(arm.law, speed_factor=FACTOR))
    return recorded(robot, 1)


@pytest.fixture(scope="module")
def data(arm: SimulatedArm, late: Recording) -> Baseline:
    return baseline([late], arm.configuration)


def law_of(data: Baseline) -> ControlLaw:
    source = data.sources.sources[0]
    assert isinstance(source, SimulatedLoop)
    return source.laws[0]


def tracking(data: Baseline) -> np.ndarray:
    """Simulated less measured motion of the refit, rms of each joint, rad."""
    rms = simulated_tracking(data, data.estimate.linear.values).rms
    assert rms is not None
    return np.array(list(rms.values()))


def with_exact_speed(data: Baseline) -> Baseline:
    source = data.sources.sources[0]
    assert isinstance(source, SimulatedLoop)
    exact = replace(source, laws=tuple(replace(law, speed_factor=None) for law in source.laws))
    return replace(data, sources=replace(data.sources, sources=(exact, *data.sources.sources[1:])))


def test_the_filter_is_found_and_the_loop_moves_as_the_robot(data: Baseline) -> None:
    factor = law_of(data).speed_factor
    assert factor == pytest.approx(FACTOR, rel=0.1)
    assert np.all(tracking(data) < 0.25 * tracking(with_exact_speed(data)))


def test_a_recorded_velocity_that_the_law_uses_is_imitated(arm, late) -> None:
    position = late.position.values
    speed = np.zeros_like(position)
    for k in range(1, len(position)):
        step = (position[k] - position[k - 1]) * late.rate
        speed[k] = speed[k - 1] + FACTOR * (step - speed[k - 1])
    shown = replace(late, velocity=replace(late.position, values=speed))
    assert law_of(baseline([shown], arm.configuration)).speed_factor == pytest.approx(
        FACTOR, rel=0.1
    )


def test_a_law_with_the_exact_speed_keeps_it(arm: SimulatedArm) -> None:
    assert law_of(baseline([recorded(arm, 1)], arm.configuration)).speed_factor is None
