"""The motion of the candidates and the friction while a joint sticks, on a simulated arm."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from bags.simulated_arms import SimulatedArm, record
from idim_iv_ros.configuration import Configuration
from idim_iv_ros.diagnosis.refit.baseline import Baseline, baseline, proposals, widened
from idim_iv_ros.diagnosis.refit.smooth_motion import simulated_slips
from idim_iv_ros.diagnosis.sentences import reversals
from idim_iv_ros.recording.recording import Recording
from idim_iv_ros.simulation import inverse_dynamics
from tests.diagnosis.motions import added_by, synthetic, without_jumps
from tests.estimation.test_simulated_arms import recorded
from tests.inputs import changed


def test_velocity_and_acceleration_are_derivatives_of_the_position(data: Baseline) -> None:
    motion = data.motions[0]
    step = 1.0 / motion.rate
    np.testing.assert_allclose(np.diff(motion.time), step, rtol=1e-9)
    inner = slice(5, -5)
    for upper, lower, share in (
        (motion.velocity, motion.position, 0.01),
        (motion.acceleration, motion.velocity, 0.05),
    ):
        slope = np.gradient(lower, step, axis=0)
        error = np.sqrt(np.mean((slope - upper)[inner] ** 2, axis=0))
        assert np.all(error < share * np.std(upper, axis=0))


def test_it_is_closer_to_the_true_motion_than_what_was_measured(arm, data: Baseline) -> None:
    """Against the position and its central differences of a recording without noise."""
    motion = data.motions[0]
    true = record(arm, 1, position_noise=0.0, torque_noise=[0.0, 0.0])
    noisy = record(arm, 1)
    for joint in (0, 1):

        def at(values: np.ndarray, joint: int = joint) -> np.ndarray:
            return np.interp(motion.time, true.time - true.time[0], values[:, joint])

        error = motion.position[:, joint] - at(true.position)
        raw = noisy.position[:, joint] - true.position[:, joint]
        assert np.std(error) < np.std(raw)
        speed = np.gradient(true.position, 1e-3, axis=0)
        error = motion.velocity[:, joint] - at(speed)
        raw = np.gradient(noisy.position - true.position, 1e-3, axis=0)
        assert np.std(error) < 0.3 * np.std(raw[:, joint])


def test_friction_is_a_share_of_its_level_and_the_sign_of_the_speed_elsewhere(data) -> None:
    (slip,) = simulated_slips(data.prepared, data.estimate)
    assert slip is not None
    assert np.abs(slip).max() <= 1.0
    measured = data.prepared.motions[0]
    speed = measured.derivatives(0, measured.span.stop - measured.span.start)[1]
    fast = np.abs(speed) > 0.05
    np.testing.assert_array_equal(slip[fast], np.sign(speed)[fast])
    between = np.abs(slip) < 0.99
    assert 10 < np.sum(between) < 0.05 * slip.size  # it sticks, and not for long
    # While it sticks the friction crosses from one level to the other, it does not jump.
    for joint in (0, 1):
        stuck = between[1:, joint] & between[:-1, joint]
        assert np.median(np.abs(np.diff(slip[:, joint]))[stuck]) < 0.3
    assert np.all(np.abs(data.motions[0].slip) <= 1.0 + 1e-12)


def test_load_is_that_of_the_links_without_drives_and_friction(data: Baseline) -> None:
    """The drive of joint 2 has a parameter of its own; that of joint 1 is grouped with YY1."""
    motion = data.motions[0]
    names, values = data.prepared.model.base.names, data.estimate.linear.values
    given = data.prepared.model.robot.given.drive_inertia[0]
    for joint, drive in enumerate((given, values[names.index("Ia2")])):
        viscous, dry, offset = (
            values[names.index(f"{name}{joint + 1}")] for name in ("Fv", "Fc", "off")
        )
        friction = viscous * motion.velocity[:, joint] + dry * motion.slip[:, joint] + offset
        expected = motion.torque[:, joint] - drive * motion.acceleration[:, joint] - friction
        np.testing.assert_allclose(motion.load[:, joint], expected, atol=1e-9)


def test_band_ends_where_noise_of_the_encoders_reaches_eight_times_that_of_the_torques(arm) -> None:
    """(2πf)² = √5 · 8 σ_τ / (J σ_q), J the largest inertia along the motion; 25 Hz at most."""
    model = arm.robot.pinocchio
    links = [np.diag(pin.crba(model, model.createData(), q)) for q in arm.position_reference[::200]]
    inertia = np.max(links, axis=0) + arm.truth.drive_inertia
    for noise in (1e-4, 1.6e-3, 6.4e-3):
        wide = widened([recorded(arm, 1, position_noise=noise)], arm.configuration).processing
        limit = np.sqrt(np.sqrt(5.0) * 8.0 * np.array([0.45, 0.175]) / (inertia * noise))
        # Inertias and both noises are estimates, and one sample in a multiple of five is kept.
        expected = min(float(limit.min()) / (2 * np.pi), 25.0)
        assert wide.decimation_cutoff == pytest.approx(expected, rel=0.15)
    configured = changed(arm.configuration, "processing", decimation_cutoff=7.0)
    assert widened([recorded(arm, 1)], configured) is configured


def test_noise_of_a_motion_that_is_not_simulated_stays_below_the_torque_s(arm) -> None:
    """In the columns it passes for a delay, which averages it."""
    model = arm.robot.pinocchio
    links = [np.diag(pin.crba(model, model.createData(), q)) for q in arm.position_reference[::200]]
    inertia = np.max(links, axis=0) + arm.truth.drive_inertia
    for noise in (1e-4, 4e-4, 1.6e-3):
        recording = replace(
            recorded(arm, 1, position_noise=noise), position_reference=None, velocity_reference=None
        )
        (section,) = proposals([[recording]], arm.configuration)
        limit = np.sqrt(np.sqrt(5.0) * np.array([0.45, 0.175]) / (inertia * noise))
        cutoff = section.processing.decimation_cutoff
        assert cutoff is not None and cutoff < 1.1 * float(limit.min()) / (2 * np.pi)


def beside_reversals(data: Baseline) -> int:
    """Rows of joint 1 that have a slow sample within one decimated sample."""
    count = 0
    for motion in data.prepared.motions:
        speed = motion.derivatives(0, motion.span.stop - motion.span.start)[1][:, 0]
        slow = np.flatnonzero(np.abs(speed) < data.prepared.minimum_speed[0])
        rows = motion.decimation.kept[motion.kept[:, 0]]
        after = np.minimum(np.searchsorted(slow, rows), len(slow) - 1)
        near = np.minimum(np.abs(slow[after] - rows), np.abs(slow[after - 1] - rows))
        count += int(np.sum(near < motion.decimation.factor - 1))
    return count


@pytest.mark.parametrize("others", [{}, {"decimation_cutoff": 8.0}, {"position_cutoff": 30.0}])
def test_rows_beside_a_reversal_count_where_the_loop_is_simulated(arm, others) -> None:
    """Whatever else the user configures."""
    data = baseline([recorded(arm, 1)], changed(arm.configuration, "processing", **others))
    assert data.sticking
    assert beside_reversals(data) > 0


World = Callable[[SimulatedArm], tuple[Recording, Configuration]]


def unreferenced(arm: SimulatedArm) -> tuple[Recording, Configuration]:
    blind = replace(recorded(arm, 1), position_reference=None, velocity_reference=None)
    return blind, arm.configuration


def unstable(arm: SimulatedArm) -> tuple[Recording, Configuration]:
    """A law with which the simulated loop runs away, as only its simulation shows."""
    wrong = {"kp": [-1200.0, -250.0], "kd": [0.0, 0.0], "torque_limit": None}
    return recorded(arm, 1), changed(arm.configuration, "controller", **wrong)


@pytest.mark.parametrize(
    ("world", "why"), [(unreferenced, "not simulated"), (unstable, "cannot be simulated")]
)
def test_without_a_simulated_loop_no_row_at_a_reversal_has_the_sign_of_the_speed(
    arm: SimulatedArm, world: World, why: str
) -> None:
    recording, configuration = world(arm)
    blind = baseline([recording], configuration)
    assert beside_reversals(blind) == 0
    assert why in reversals(configuration, blind)
    # It is the measured motion: what stands in for the simulated one lacks the upper half of it.
    (motion,), (measured,) = blind.motions, blind.prepared.motions
    places = np.round((motion.time - motion.time[0]) * measured.signals.rate).astype(int)
    first = measured.span.start + int(measured.decimation.kept[0])
    np.testing.assert_array_equal(motion.position, measured.position[first + places])


@pytest.mark.parametrize("margin", [0.0, 3.0])
@pytest.mark.parametrize("world", [None, unreferenced])
def test_what_the_user_says_of_reversals_holds(arm: SimulatedArm, margin: float, world) -> None:
    configuration = changed(arm.configuration, "processing", reversal_margin=margin)
    recording = recorded(arm, 1) if world is None else world(arm)[0]
    data = baseline([recording], configuration)
    assert data.prepared.configuration.processing.reversal_margin == margin
    assert (beside_reversals(data) > 0) == (margin == 0.0)
    warned = "with the sign of the speed" in reversals(configuration, data)
    assert warned == (margin == 0.0 and world is not None)


@pytest.mark.parametrize("links", [True, False])
def test_moved_torques_are_those_of_the_moved_motion(links: bool) -> None:
    motion = without_jumps(synthetic())
    w = 3.1
    shift = 1e-3 * np.sin(w * motion.time)
    moved = motion.moved(1, shift, links=links)
    speed = 1e-3 * w * np.cos(w * motion.time)
    parameters = motion.links if links else motion.whole
    expected = added_by(motion, parameters, shift, speed, -(w**2) * shift)
    inner = slice(3, -3)
    for joint in (0, 1):
        largest = np.abs(expected[:, joint]).max()
        assert np.abs(moved - expected)[inner, joint].max() < 2e-3 * largest


def test_slope_of_a_load_at_rest_is_that_of_gravity() -> None:
    """A link with first moments (mx, mz) about a level axis: central difference of its torque."""
    motion = synthetic(1.0)
    rest, step = np.zeros_like(motion.velocity), 1e-3
    still = replace(motion, velocity=rest, acceleration=rest)
    ends = [added_by(still, still.links, side, 0.0, 0.0) for side in (step, -step)]
    within = 1e-3 * np.abs(inverse_dynamics(still.robot, still.links, still.position, rest, rest))
    slope = (ends[0] - ends[1]) / (2 * step)
    np.testing.assert_allclose(still.slope(1), slope, atol=within.max())
