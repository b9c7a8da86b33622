"""Recordings held against each other: one set against another, and those of one set."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pinocchio as pin
import pytest

from bags.simulated_arms import SimulatedArm, arm2, arm6
from idim_iv_ros.diagnosis.against.changes import agreement, changes_between, numbers_apart
from idim_iv_ros.diagnosis.against.contrast import contrast_of, contrasted, two_sets
from idim_iv_ros.diagnosis.comparison.candidate import Catalogue, change_rows
from idim_iv_ros.diagnosis.diagnose import of_those_that_agree
from idim_iv_ros.diagnosis.refit.baseline import Baseline, baseline
from idim_iv_ros.diagnosis.result.recordings import ContrastResult, RecordingAgreement
from idim_iv_ros.effects.registry import PARAMETRIC, STRUCTURAL
from idim_iv_ros.estimation.likelihood import Regression
from idim_iv_ros.model import DynamicParameters
from idim_iv_ros.progress import Stopwatch
from idim_iv_ros.recording.recording import Recording
from idim_iv_ros.simulation import SimulatedEffect, record_simulated_robot
from tests.diagnosis.test_numbers import covers
from tests.diagnosis.worlds import point_mass
from tests.estimation.test_simulated_arms import recorded, recording_of

SECONDS = 8.0
# Effects that are looked for; the whole catalogue is that of benchmarks/contrast.py.
LOOKED_FOR = {"stribeck", "load_dependent_friction", "time_delay", "controller_mismatch"}
LEFT_OUT = [effect.name for effect in STRUCTURAL if effect.name not in LOOKED_FOR]
STRIBECK = SimulatedEffect("stribeck", "joint_1", {"excess": 3.0, "speed": 0.1, "exponent": 2.0})


@cache
def arm(motion: int) -> SimulatedArm:
    return arm2(seconds=SECONDS, rate=500.0, seed=motion)


def loaded(mass: float, x: float, z: float) -> DynamicParameters:
    """The true arm with a point mass on its last link."""
    truth = arm(1).truth
    inertial = truth.inertial.copy()
    load = pin.Inertia(mass, np.array([x, 0.0, z]), np.zeros((3, 3)))
    inertial[-1] += load.toDynamicParameters()
    return replace(truth, inertial=inertial)


def run(
    name: str,
    motion: int,
    *,
    truth: DynamicParameters | None = None,
    stiffness: float = 1.0,
    effects: Sequence[SimulatedEffect] = (),
    every: int = 1,
) -> Recording:
    """Record one motion; `stiffness`: kp of joint 1 as a share of the configured one."""
    robot = arm(motion)
    kp = robot.law.kp.copy()
    kp[0] *= stiffness
    made = record_simulated_robot(
        robot.robot,
        robot.truth if truth is None else truth,
        replace(robot.law, kp=kp),
        robot.position_reference,
        robot.velocity_reference,
        rate=robot.rate,
        seed=motion,
        position_noise=2e-5,
        torque_noise=0.005 * np.asarray(robot.configuration.controller.torque_limit),
        effects=list(effects),
    )
    return recording_of(robot, made, name=name, start=100.0 * motion, every=every)


def contrast(reference: Sequence[Recording], against: Sequence[Recording]) -> ContrastResult:
    return contrasted(reference, against, arm(1).configuration, LEFT_OUT)


def stiffer(more: float) -> DynamicParameters:
    """The true arm with more Coulomb friction at its first joint, N m."""
    truth = arm(1).truth
    return replace(truth, coulomb=truth.coulomb + np.array([more, 0.0]))


def test_nothing_changed_is_no_difference_whatever_the_nominal_model_and_the_rate() -> None:
    result = contrast([run("a", 1)], [run("b", 2, every=2)])
    assert not result.differs
    assert result.causes == () and result.unattributed == ()
    assert result.sentence.startswith("No difference")
    for joint in result.joints:
        assert joint.before == pytest.approx(joint.own, rel=0.05)


def in_unit(recording: Recording, factor: Sequence[float]) -> Recording:
    """The same with efforts of another unit or sign."""
    effort = replace(recording.effort, values=recording.effort.values * np.array(factor))
    return replace(recording, effort=effort)


def test_an_effort_in_another_unit_or_of_another_sign_is_compared_nowhere() -> None:
    """A load of tonnes, or no difference where the rows of a joint are left out."""
    milli = contrast([run("a", 1)], [in_unit(run("b", 2), (1e3, 1e3))])
    assert milli.differs is None and milli.causes == () and milli.joints == ()
    assert len(milli.not_compared) == 2 and all("1e+03" in why for why in milli.not_compared)
    opposite = contrast([run("a", 1)], [in_unit(run("b", 2), (1.0, -1.0))])
    assert opposite.causes == () and opposite.differs is not False
    assert [joint.joint for joint in opposite.joints] == ["joint_1"]
    assert len(opposite.not_compared) == 1


def test_another_scale_of_the_recorded_efforts_is_no_change_of_the_law() -> None:
    result = contrast([run("a", 1)], [in_unit(run("b", 2), (1.0, 1.15))])
    (cause,) = result.causes
    assert (cause.effect, cause.joint) == ("torque_gain", "joint_2")
    assert covers(cause, "factor", 1.0 / 1.15), "whatever the nominal masses are"
    assert cause.parameters["factor"].std < 0.003


def test_what_can_be_compared_is_where_another_joint_cannot_be() -> None:
    second = in_unit(run("b", 2, truth=stiffer(2.0)), (1.0, -1.0))
    result = contrast([run("a", 1)], [second])
    (cause,) = result.causes
    assert (cause.effect, cause.joint) == ("friction_level", "joint_1")
    assert result.differs and len(result.not_compared) == 1


def test_a_load_of_the_second_set_is_named_with_its_mass_and_nothing_else() -> None:
    """Stribeck friction that both sets have is no change."""
    heavy = run("b", 2, truth=loaded(0.8, 0.2, 0.05), effects=[STRIBECK])
    result = contrast([run("a", 1, effects=[STRIBECK])], [heavy])
    (cause,) = result.causes
    assert cause.effect == "payload"
    assert covers(cause, "mass", 0.8)
    assert cause.parameters["mass"].std < 0.1
    assert "stribeck at joint_1" in result.common
    worst = max(result.joints, key=lambda joint: joint.share_of_torque)
    assert worst.after < 0.2 * worst.before


@pytest.mark.parametrize("appears", [True, False])
def test_friction_that_one_set_has_is_named_with_the_set(appears: bool) -> None:
    plain, other = [run("a", 1)], [run("b", 2, effects=[STRIBECK])]
    (cause,) = contrast(*((plain, other) if appears else (other, plain))).causes
    assert (cause.effect, cause.joint) == ("stribeck", "joint_1")
    assert cause.change == ("appeared" if appears else "vanished")
    assert bool(cause.against) == appears and bool(cause.reference) != appears


def test_another_gain_is_a_change_of_the_law_and_of_nothing_else() -> None:
    result = contrast([run("a", 1)], [run("b", 2, stiffness=0.8)])
    (cause,) = result.causes
    assert (cause.effect, cause.joint) == ("controller_mismatch", "joint_1")
    assert set(cause.against) == {"kp"}
    configured = arm(1).law.kp[0]
    assert cause.reference["kp"].value == pytest.approx(configured, rel=0.01)
    assert cause.against["kp"].value == pytest.approx(0.8 * configured, rel=0.01)


def test_two_loads_mounted_differently_come_out_as_two() -> None:
    second = [
        run("b1", 2, truth=loaded(0.8, 0.2, 0.05)),
        run("b2", 3, truth=loaded(1.6, 0.05, -0.1)),
    ]
    result = contrast([run("a", 1)], second)
    causes = {cause.bags: cause for cause in result.causes}
    assert {cause.effect for cause in result.causes} == {"payload"}
    assert set(causes) == {("b1",), ("b2",)}
    assert covers(causes["b1",], "mass", 0.8) and covers(causes["b2",], "mass", 1.6)
    assert any("do not agree" in note for note in result.notes)


def test_friction_that_rose_in_all_recordings_of_a_set_is_one_change_of_the_set() -> None:
    """Also where each part of the time that is left out could be one recording."""
    second = [run("b1", 3, truth=stiffer(2.0)), run("b2", 4, truth=stiffer(2.0))]
    result = contrast([run("a1", 1), run("a2", 2)], second)
    (cause,) = result.causes
    assert (cause.effect, cause.joint) == ("friction_level", "joint_1")
    assert cause.bags == ("b1", "b2")
    assert cause.evidence.chosen_in_folds == "4 of 4"
    assert covers(cause, "change_of_coulomb", 2.0)


def test_a_change_that_is_not_confirmed_is_still_a_difference() -> None:
    """Numbers of the second set alone, held out, say so; what comes closest is named as such."""
    sets = two_sets([run("a", 1)], [run("b", 2, truth=stiffer(2.0))], arm(1).configuration)
    scopes = [sets.first, sets.second]
    changes = changes_between(Catalogue(sets.data, LEFT_OUT).differing(scopes, [sets.second]))
    doubtful = replace(changes, accepted={}, doubtful={**changes.accepted, **changes.doubtful})
    result = contrast_of(sets, doubtful, LEFT_OUT)
    assert result.differs and result.causes == ()
    joint = result.joints[0]
    assert joint.before == joint.after > 2.0 * joint.own
    assert joint.unexplained == pytest.approx(2.0, rel=0.1)
    assert "Closest comes friction level at joint_1" in result.sentence


def test_more_noise_is_no_difference_and_is_said() -> None:
    noisy = run("b", 2)
    random = np.random.default_rng(1)
    size = 0.04 * np.sqrt(np.mean(noisy.effort.values**2, axis=0))
    values = noisy.effort.values + size * random.standard_normal(noisy.effort.values.shape)
    noisy = replace(noisy, effort=replace(noisy.effort, values=values))
    result = contrast([run("a", 1)], [noisy])
    assert not result.differs
    assert "more is left of b than of the reference" in result.sentence


NOISE = (0.15, 0.05)  # N m, of a row


@pytest.fixture(scope="module")
def data() -> Baseline:
    arm = arm2(seconds=SECONDS, rate=500.0)
    return baseline([recorded(arm, seed) for seed in (1, 2, 3)], arm.configuration)


def world(data: Baseline, seed: int, change: Mapping[int, list[np.ndarray]]) -> Regression:
    """Rows whose torque is that of other parameters than the nominal, and changes by recording."""
    random = np.random.default_rng(seed)
    plain = data.regression
    truth = 1.1 * data.prepared.model.given
    joints = []
    for joint, rows in enumerate(plain.joints):
        extra = [
            motion.rows(change[number][joint] if number in change else np.zeros(len(motion.time)))
            for number, motion in enumerate(data.motions)
        ]
        noise = NOISE[joint] * random.standard_normal(len(rows.torque))
        torque = rows.matrix @ truth[rows.columns] + data.counting(joint, extra) + noise
        joints.append(replace(rows, torque=torque))
    return Regression(tuple(joints), plain.parameters)


def agreement_of(catalogue: Catalogue) -> tuple[RecordingAgreement, ...]:
    return agreement(catalogue.data, numbers_apart(catalogue))


def differing(
    data: Baseline, seed: int, change: Mapping[int, list[np.ndarray]]
) -> dict[int, RecordingAgreement]:
    """Recordings that differ, by their number."""
    agreements = agreement_of(Catalogue(replace(data, regression=world(data, seed, change))))
    assert [recording.bag for recording in agreements] == [
        part.bag for part in data.prepared.session.parts
    ]
    return {
        number: recording for number, recording in enumerate(agreements) if not recording.agrees
    }


def torques_of_a_load(data: Baseline, number: int, mass: float) -> list[np.ndarray]:
    return point_mass(replace(data, motions=(data.motions[number],)), mass, (0.3, 0.0, 0.0))


def test_recordings_of_one_robot_agree_whatever_the_nominal_model(data: Baseline) -> None:
    assert all(differing(data, seed, {}) == {} for seed in range(5))


@pytest.mark.parametrize("number", [0, 1, 2])
@pytest.mark.parametrize("mass", [0.5, -0.5])
def test_the_recording_with_another_load_is_named_with_the_difference(data, number, mass) -> None:
    """Masses within three standard deviations; the loads of the others do not matter."""
    agreements = differing(data, 1, {number: torques_of_a_load(data, number, mass)})
    assert set(agreements) == {number}
    (cause,) = agreements[number].differences
    assert cause.effect == "payload"
    assert covers(cause, "mass", mass)
    assert cause.parameters["mass"].std < 0.1


def test_a_load_of_one_recording_is_no_mean_load_of_all() -> None:
    """The numbers are those of the recordings without it, which nothing is wrong with."""
    recordings = [run("a", 1), run("b", 2, truth=loaded(0.8, 0.3, 0.0)), run("c", 3)]
    with Stopwatch(None) as watch:
        refit, explanation, agreements = of_those_that_agree(
            recordings, arm(1).configuration, tuple(LEFT_OUT), watch
        )
    assert [of.bag for of in agreements if not of.agrees] == ["b"]
    (difference,) = agreements[1].differences
    assert difference.effect == "payload" and covers(difference, "mass", 0.8)
    assert [part.bag for part in refit.data.prepared.session.parts] == ["a", "c"]
    assert "payload" not in [term.key.effect for term in explanation.selection.terms]


def test_the_same_load_in_two_of_five_recordings_is_found_in_both() -> None:
    arm = arm2(seconds=SECONDS, rate=500.0)
    five = baseline([recorded(arm, seed) for seed in (1, 2, 3, 4, 5)], arm.configuration)
    agreements = differing(
        five, 0, {number: torques_of_a_load(five, number, 0.5) for number in (3, 4)}
    )
    assert set(agreements) == {3, 4}
    for recording in agreements.values():
        (cause,) = recording.differences
        assert cause.effect == "payload" and covers(cause, "mass", 0.5)


def test_a_mount_that_leans_in_all_recordings_is_no_difference_between_them() -> None:
    """No base parameters make up for it: it must be one change of all, not one of each."""
    arm = arm6(seconds=SECONDS)
    data = baseline([recorded(arm, seed) for seed in (1, 2, 3)], arm.configuration)
    space = Catalogue(data).space
    joints = [
        replace(rows, torque=rows.torque + unit @ (0.05 * space.tilt(1)))
        for rows, unit in zip(data.rows, change_rows(data, space), strict=True)
    ]
    regression = replace(data.regression, joints=tuple(joints))
    names = {effect.name for effect in PARAMETRIC} - {"gravity_direction"}
    agreements = agreement_of(Catalogue(replace(data, regression=regression), names))
    assert all(recording.agrees for recording in agreements)


def test_one_recording_is_held_against_nothing(data: Baseline) -> None:
    one = SimpleNamespace(data=replace(data, motions=data.motions[:1]))
    assert agreement_of(one) == ()
