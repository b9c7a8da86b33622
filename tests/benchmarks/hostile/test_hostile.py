"""The hostile benchmark: its plants agree with the rigid model, its cells, its scores."""

import json
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from ruamel.yaml import YAML

from benchmarks.hostile.cells import HostileCell
from benchmarks.hostile.comparison import changes, comparison_lines, mcnemar
from benchmarks.hostile.generate import write_cell
from benchmarks.hostile.judge import judge
from benchmarks.hostile.nuisances import Nuisances, drawn
from benchmarks.hostile.plants import chain_of, run
from benchmarks.withheld_effects.cells import Asked
from benchmarks.withheld_effects.motion import rich_motion
from benchmarks.withheld_effects.robot import given_robot, rigid_body_model
from benchmarks.withheld_effects.world import World, plain_world
from idim_iv_ros import load_configuration
from idim_iv_ros.identification.prepare import read_configured
from tests.benchmarks.withheld_effects.test_score import cause, gap, label, truth

SEED = 3
QUIET = dict.fromkeys(("computing", "lateness", "slot", "encoder_noise", "torque_noise"), 0.0)
QUIET |= {"bits": 40.0, "warm_dry": 0.0, "warm_viscous": 0.0}


def smooth_world() -> tuple[World, Nuisances]:
    """An arm without dry friction and noise, whose torque MuJoCo's inverse dynamics knows."""
    given = given_robot("arm2")
    world = plain_world(given, np.random.default_rng(0), altered=False)
    zero = np.zeros(2)
    drive = world.drive._replace(dry_forward=zero, dry_backward=zero)
    nuisances = replace(drawn(np.random.default_rng(0), given, identified=True), **QUIET)
    sensors = replace(nuisances.sensors(given), velocity=zero)
    return replace(world, drive=drive, sensors=sensors), nuisances


@pytest.mark.bench
@pytest.mark.parametrize("plant", ["time_stepping", "mujoco"])
def test_torque_of_a_plant_without_friction_is_that_of_the_inverse_dynamics(plant: str) -> None:
    world, nuisances = smooth_world()
    given, period = world.given, world.controller.period
    motion = rich_motion(given, np.random.default_rng(1), 4.0)
    made = run(world, plant, chain_of(nuisances, 2), motion, 5, np.zeros(2))
    position = made.recorded.position
    velocity = np.gradient(position, period, axis=0)
    acceleration = np.gradient(velocity, period, axis=0)
    # The command of a period is held until the next, so that their mean acts at the stamp.
    acting = 0.5 * (made.recorded.command[1:] + made.recorded.command[:-1])
    model = rigid_body_model(given, world.inertials, world.gravity)
    data = mujoco.MjData(model)
    rigid = []
    for instant in zip(position, velocity, acceleration, strict=True):
        data.qpos[:], data.qvel[:], data.qacc[:] = instant
        torque = np.zeros(2)
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fwdVelocity(model, data)
        mujoco.mj_rne(model, data, 1, torque)
        rigid.append(torque)
    expected = np.array(rigid) + given.armature * acceleration + given.viscous * velocity
    left = (acting - expected[1:])[50:-50]
    # MuJoCo's step is of first order in time: what it calls now is half a step late.
    assert np.sqrt(np.mean(left**2)) < 0.02 * np.sqrt(np.mean(acting**2))


@pytest.mark.bench
@pytest.mark.parametrize("plant", ["time_stepping", "mujoco"])
def test_a_cell_can_be_read_and_its_configuration_does_not_tell_the_truth(
    plant: str, tmp_path: Path
) -> None:
    cell = HostileCell(0, "single", "arm2", plant, (Asked("stribeck", 1, 2.0),), (3.0, 3.5), True)
    write_cell(tmp_path, "one", cell, SEED)
    folder = tmp_path / "cells" / "one"
    configuration = load_configuration(folder / "robot.yaml")
    written = YAML(typ="safe").load((folder / "robot.yaml").read_text(encoding="utf-8"))
    assert "simulated_robot" not in written
    for bag in folder.glob("*.mcap"):
        (recording,) = read_configured([bag], configuration, None)
        assert recording.position.values.shape[1] == 2
        assert np.isfinite(recording.effort.values).all()
    sealed = json.loads((tmp_path / ".sealed" / "one.json").read_text(encoding="utf-8"))
    first = sealed["effects"][0]
    assert (first["effect"], first["joint"]) == ("stribeck", "joint_2")


BACKLASH = ("backlash", "joint_1")
TRUTH = {**truth(*BACKLASH, rho=1.0), "mass": 1.0, "strength": 1.0}
CELL = {"joints": 2, "plant": "mujoco", "seconds": [10.0], "numbers_off": False}
LABEL = {**label(TRUTH), **CELL, "also_true": []}


def test_a_truth_is_a_hit_where_it_stands_first_or_second_in_a_set_and_only_named_third() -> None:
    second = judge(LABEL, gap(cause("presliding", alike=[BACKLASH])), 1.0)
    assert second.ranked[0].hit and not second.false_names and second.sets == (2,)
    alike = [("spring", "joint_1"), BACKLASH]
    third = judge(LABEL, gap(cause("presliding", alike=alike)), 1.0)
    assert not third.ranked[0].hit and third.ranked[0].anywhere and not third.false_names


def test_a_cause_that_has_nothing_to_do_with_the_truth_is_no_hit() -> None:
    """A set of one in which the truth is not is a miss, whatever the place that is asked for."""
    score = judge(LABEL, gap(cause("backlash", "joint_2")), 1.0)
    assert not score.ranked[0].hit and not score.ranked[0].anywhere and not score.ranked[0].first
    assert score.false_names == ("backlash[joint_2]",)
    assert score.outcome == "missed + false"


def test_two_versions_differ_by_the_cells_that_only_one_has_right() -> None:
    hit = judge(LABEL, gap(cause(*BACKLASH)), 1.0)
    missed = judge(LABEL, gap(), 1.0)
    first = {f"{k}": missed for k in range(8)} | {"8": hit, "9": hit}
    second = {f"{k}": hit for k in range(8)} | {"8": missed, "9": hit}
    gained, lost = changes(first, second, lambda cell: cell.right)
    assert (len(gained), lost) == (8, ["8"])
    assert mcnemar(8, 1) == pytest.approx(2 * 10 / 2**9)  # twice the tail of nine fair coins
    assert mcnemar(0, 0) == 1.0
    assert any(line.startswith("| 8 |") for line in comparison_lines(first, second))
