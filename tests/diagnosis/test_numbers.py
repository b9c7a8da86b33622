"""Which numbers of a nominal model are named, in worlds whose torque is written here."""

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from scipy.stats import chi2

from bags.simulated_arms import SimulatedArm, arm2, arm6
from idim_iv_ros.diagnosis.answer.causes import parametric_causes
from idim_iv_ros.diagnosis.answer.explained import Explained, explained, unexplained
from idim_iv_ros.diagnosis.comparison.candidate import Catalogue
from idim_iv_ros.diagnosis.comparison.ledger import errors_of_drives, errors_of_links, torque_ledger
from idim_iv_ros.diagnosis.comparison.select import select
from idim_iv_ros.diagnosis.refit.baseline import Baseline, baseline
from idim_iv_ros.diagnosis.refit.refit import missing_gravity
from idim_iv_ros.diagnosis.result.causes import Cause
from idim_iv_ros.estimation.likelihood import Regression
from idim_iv_ros.model.parameters import parameters_of, with_centre_moved
from tests.diagnosis.motions import arm2_session
from tests.diagnosis.worlds import point_mass, world
from tests.estimation.test_simulated_arms import recorded
from tests.inputs import changed


@pytest.fixture(scope="module")
def data() -> Baseline:
    return arm2_session(12.0)


def explanation_of(data: Baseline, regression: Regression) -> Explained:
    other = replace(data, regression=regression)
    return explained(select(Catalogue(other), torque_ledger(other)))


def causes_of(data: Baseline, regression: Regression) -> list[Cause]:
    """Parametric causes of a world."""
    return parametric_causes(explanation_of(data, regression))[0]


def names(causes: list[Cause]) -> list[tuple[str, str | None]]:
    return [(cause.effect, cause.joint) for cause in causes]


def covers(cause: Cause, name: str, true: float, deviations: float = 3.0) -> bool:
    number = cause.parameters[name]
    assert number.std is not None
    return abs(number.value - true) < deviations * number.std


def errors_of_everything(data: Baseline, seed: int, size: float) -> np.ndarray:
    """Change (b,) of the base parameters: errors of all links, drives and frictions."""
    model = data.prepared.model
    drives = errors_of_drives(model, np.array(data.torque_sizes), model.robot.given)
    standard = np.hstack([errors_of_links(model), drives])
    change = standard @ (size * np.random.default_rng(seed).standard_normal(standard.shape[1]))
    return np.asarray(model.base.grouping @ change)


def test_errors_of_a_weak_drive_are_as_small_as_the_drive(data: Baseline) -> None:
    model = data.prepared.model
    layout, given = model.regressor.layout, model.robot.given
    strong = replace(given, coulomb=np.array([5.0, 0.1]))
    other = replace(model, robot=replace(model.robot, given=strong))
    places = [k for k, number in enumerate(layout.parameters) if number.kind == "Fc"]
    for torques, sizes in (([100.0, 2.0], [5.0, 0.1]), ([100.0, 100.0], [5.0, 2.55])):
        changes = errors_of_drives(other, np.array(torques), given)
        np.testing.assert_allclose(np.diag(changes)[places], sizes)


def test_nothing_is_wrong_where_nothing_was_changed(data: Baseline) -> None:
    for seed in range(3):
        regression = world(data, seed)
        explanation = explanation_of(data, regression)
        assert (explanation.effects, explanation.numbers) == ((), ())
        assert parametric_causes(explanation)[0] == []
        assert unexplained(explanation) is None
        assert missing_gravity(data) is None


def test_gravity_that_is_configured_as_zero_is_found_with_its_size() -> None:
    """A planar arm feels nothing of what pulls it out of its plane."""
    arm = arm2(seconds=8.0, rate=500.0)
    weightless = changed(arm.configuration, "robot", gravity=[0.0, 0.0, 0.0])
    data = baseline([recorded(arm, 1)], weightless)
    gravity = missing_gravity(data)
    assert gravity is not None and gravity.acceleration[1] == 0.0
    assert gravity.acceleration[2] == pytest.approx(-9.81, rel=0.25)  # with the given masses


def test_gravity_of_an_arm_on_its_side_is_found_where_the_configuration_has_it_upright() -> None:
    """So far from the truth that a small rotation is none; the given masses are 10 % off."""
    arm = arm6(seconds=8.0)
    upright = changed(arm.configuration, "robot", gravity=[9.81, 0.0, 0.0])
    data = baseline([recorded(arm, 1)], upright)
    gravity = missing_gravity(data)
    assert gravity is not None
    assert gravity.acceleration == pytest.approx([0.0, 0.0, -9.81], abs=2.0)


def test_efforts_without_gravity_are_said_to_have_none() -> None:
    """A driver that takes the compensation out of what it records: as if nothing were heavy."""
    arm = arm6(seconds=8.0)
    floating = replace(arm, robot=arm.robot.with_gravity(np.zeros(3)))
    gravity = missing_gravity(baseline([recorded(floating, 1)], arm.configuration))
    assert gravity is not None and gravity.compensated
    assert not np.any(gravity.corrected(arm.configuration).robot.gravity)
    assert missing_gravity(baseline([recorded(arm, 1)], arm.configuration)) is None


@pytest.fixture(scope="module")
def six() -> Baseline:
    arm = arm6(seconds=16.0)
    return baseline([recorded(arm, 1)], arm.configuration)


def of_link(data: Baseline, link: int, change: np.ndarray) -> np.ndarray:
    """Change (b,) of the base parameters by one of XX … M (10,) of a link."""
    layout = data.prepared.model.regressor.layout
    standard = np.zeros(len(layout.parameters))
    standard[layout.of_bodies[link]] = change
    return np.asarray(data.prepared.model.base.grouping @ standard)


def ball(mass: float, *centre: float) -> np.ndarray:
    body = pin.Inertia.FromSphere(mass, 0.03)
    body.lever = np.array(centre)
    return parameters_of(body)


def the_cause(data: Baseline, change: np.ndarray, seed: int, noise: float = 0.02) -> Cause:
    regression = world(data, seed, change=change, noise=noise * np.array(data.torque_sizes))
    (cause,) = causes_of(data, regression)
    return cause


def test_a_link_that_is_heavier_is_one_number(six: Baseline) -> None:
    """A cover of another material: mass, first moments and inertia of one link in proportion."""
    given = six.prepared.model.robot.given.of_bodies[3]
    cause = the_cause(six, of_link(six, 3, 0.25 * given), 6)
    assert (cause.effect, cause.joint) == ("link_inertia", six.joints[3])
    assert list(cause.parameters) == ["relative_change_of_mass"]
    assert covers(cause, "relative_change_of_mass", 0.25)


def test_a_centre_of_mass_elsewhere_is_no_change_of_the_next_mass(six: Baseline) -> None:
    given, shift = six.prepared.model.robot.given.of_bodies[1], np.array([0.0, 0.0, -0.05])
    cause = the_cause(six, of_link(six, 1, with_centre_moved(given, shift) - given), 6)
    assert (cause.effect, cause.joint) == ("link_inertia", six.joints[1])
    shown = {name[-1]: name for name in cause.parameters}
    assert all(covers(cause, name, shift["xyz".index(axis)]) for axis, name in shown.items())
    assert "z" in shown


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_load_of_five_link_masses_beside_errors_of_all_numbers(six: Baseline, seed: int) -> None:
    """Errors of the other links hide the direction of the mass: it is unsure there, not zero."""
    mass = 5.0 * float(six.prepared.model.robot.given.inertial[5, 0])
    change = of_link(six, 5, ball(mass, 0.0, 0.02, 0.08)) + errors_of_everything(six, seed, 0.05)
    cause = the_cause(six, change, seed, 0.004)
    assert (cause.effect, cause.joint) == ("payload", "joint_6")
    assert covers(cause, "mass", mass)


def test_a_tool_on_the_last_axis_is_no_other_wrist(six: Baseline) -> None:
    """A ball of 0.8 kg, centred on the last axis, is the same whatever that joint does."""
    cause = the_cause(six, of_link(six, 5, ball(0.8, 0.0, 0.0, 0.1)), 4)
    assert (cause.effect, cause.joint) == ("payload", "joint_6")
    assert covers(cause, "mass", 0.8)
    assert covers(cause, "moment_z", 0.08)
    assert "moment_x" not in cause.parameters


def test_friction_level_with_its_size(data: Baseline) -> None:
    regression = world(data, 1, 1, lambda m: 0.4 * m.slip[:, 1])
    (cause,) = causes_of(data, regression)
    assert (cause.effect, cause.joint) == ("friction_level", "joint_2")
    assert covers(cause, "change_of_coulomb", 0.4)
    assert cause.torque_gap.after < 0.3 * cause.torque_gap.before


def test_a_constant_torque_is_an_offset(data: Baseline) -> None:
    regression = world(data, 5, 1, lambda m: np.full(len(m.time), 0.4))
    (cause,) = causes_of(data, regression)
    assert (cause.effect, cause.joint) == ("torque_offset", "joint_2")
    assert cause.parameters["offset"].unit == "N m"
    assert covers(cause, "offset", 0.4)


def test_a_change_too_small_to_matter_is_not_told(data: Baseline) -> None:
    assert causes_of(data, world(data, 3, 1, lambda m: 0.004 * m.slip[:, 1])) == []


def test_a_payload_of_another_program(data: Baseline) -> None:
    causes = causes_of(data, world(data, 2, torques=point_mass(data, 0.8, (0.28, 0.0, 0.0))))
    assert names(causes) == [("payload", "joint_2")]
    assert covers(causes[0], "mass", 0.8)
    assert causes[0].torque_gap.after < 0.3 * causes[0].torque_gap.before


@pytest.mark.parametrize("joint", [0, 1])
@pytest.mark.parametrize("factor", [0.9, 1.15])
def test_a_wrong_gain_is_named_alone_with_its_size(data, joint, factor) -> None:
    gains = (factor, 1.0) if joint == 0 else (1.0, factor)
    causes = causes_of(data, world(data, 1, gains=gains))
    assert names(causes) == [("torque_gain", data.joints[joint])]
    assert causes[0].parameters["factor"].value == pytest.approx(1.0 / factor, abs=0.01)


def test_errors_of_everything_are_no_gain_and_no_payload(data: Baseline) -> None:
    """Ten percent of all links, drives and frictions: no one number is to blame."""
    said = [
        cause.effect
        for seed in range(3)
        for cause in causes_of(
            data, world(data, seed, change=errors_of_everything(data, seed, 0.1))
        )
    ]
    assert {"torque_gain", "payload"}.isdisjoint(said)


@pytest.mark.slow
def test_a_payload_scatters_as_its_interval_says_though_other_numbers_are_wrong(data) -> None:
    """In twelve draws the rms of (estimate - mass) / deviation was 1.08."""
    mass, lever = 2.0, 0.28  # m: about the end of the last link
    named, errors = 0, []  # in standard deviations
    torques = point_mass(data, mass, (lever, 0.0, 0.0))
    for seed in range(6, 12):
        change = errors_of_everything(data, seed, 0.03)
        causes = causes_of(data, world(data, seed, change=change, torques=torques))
        for cause in causes:
            others = {other.effect for other in cause.indistinguishable_from}
            named += cause.effect == "payload" or "payload" in others
            if cause.effect == "payload":
                number = cause.parameters["mass"]
                assert number.std is not None
                errors.append((number.value - mass) / number.std)
    assert named >= 5  # of a two-joint arm a link's error may be as good
    assert 0.01 < chi2.cdf(np.sum(np.square(errors)), len(errors)) < 0.99


@pytest.mark.parametrize("make", [arm2, arm6])
def test_friction_that_the_file_does_not_give_is_named_at_every_joint(
    make: Callable[..., SimulatedArm], tmp_path: Path
) -> None:
    """With its true size, and nothing else: neither Stribeck friction nor a link."""
    arm, bare = make(seconds=10.0, rate=500.0), tmp_path / "bare.urdf"
    text = arm.configuration.robot.urdf.read_text()
    bare.write_text(re.sub("<dynamics [^>]*/>", "", text))
    data = baseline([recorded(arm, 1)], changed(arm.configuration, "robot", urdf=bare))
    explanation = explanation_of(data, data.regression)
    causes = parametric_causes(explanation)[0]
    assert explanation.effects == ()
    assert sorted(names(causes)) == [("friction_level", joint) for joint in data.joints]
    for cause in causes:
        place = data.joints.index(str(cause.joint))
        assert covers(cause, "change_of_viscous", arm.truth.viscous[place], 4.0)
        assert covers(cause, "change_of_coulomb", arm.truth.coulomb[place], 4.0)


DRIVES = {2: (0.25, 0.1), 6: (0.9, 1.1, 0.55, 0.16, 0.12, 0.06)}  # kg m²
ROW_NOISE = {2: (0.15, 0.05), 6: (0.2, 0.25, 0.13, 0.05, 0.04, 0.02)}  # N m


@pytest.fixture(scope="module")
def bare(request: pytest.FixtureRequest) -> Baseline:
    """An arm whose configuration says nothing of drive inertia."""
    arm = (arm2 if request.param == 2 else arm6)(seconds=15.0, rate=500.0)
    configuration = changed(arm.configuration, "simulator", armature=None)
    return baseline([recorded(arm, 1)], configuration)


def of_drives(data: Baseline) -> list[np.ndarray]:
    return list((data.motions[0].acceleration * DRIVES[len(data.joints)]).T)


def without_drives(data: Baseline, seed: int, torques: list[np.ndarray]) -> list[Cause]:
    noise = ROW_NOISE[len(data.joints)]
    return causes_of(data, world(data, seed, torques=torques, noise=noise))


@pytest.mark.parametrize("bare", [2, 6], indirect=True)
def test_drives_without_inertia_are_named_with_the_value_of_each(bare: Baseline) -> None:
    causes = without_drives(bare, 1, of_drives(bare))
    assert sorted(names(causes)) == [("drive_inertia", joint) for joint in bare.joints]
    for cause in causes:
        true = DRIVES[len(bare.joints)][bare.joints.index(str(cause.joint))]
        assert cause.parameters["change_of_drive_inertia"].unit == "kg m²"
        assert covers(cause, "change_of_drive_inertia", true, 4.0)
    # No torque separates a link about its own axis from its drive.
    (first,) = [cause for cause in causes if cause.joint == bare.joints[0]]
    assert [(one.effect, one.joint) for one in first.indistinguishable_from] == [
        ("link_inertia", bare.joints[0])
    ]


@pytest.mark.parametrize("bare", [6], indirect=True)
def test_a_payload_alone_is_not_told_as_missing_drive_inertia(bare: Baseline) -> None:
    torques = point_mass(bare, 0.8, (0.06, 0.02, 0.05))
    said = [cause.effect for cause in without_drives(bare, 5, torques)]
    assert "drive_inertia" not in said


@pytest.mark.parametrize("bare", [2], indirect=True)
def test_direct_drives_without_inertia_have_no_cause(bare: Baseline) -> None:
    nothing = [np.zeros(len(bare.motions[0].time)) for _ in bare.joints]
    assert without_drives(bare, 1, nothing) == []
