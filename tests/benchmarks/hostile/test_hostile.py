"""The hostile benchmark: its plants agree with the rigid model, its cells, its scores."""

import json
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from ruamel.yaml import YAML

from benchmarks.hostile.cells import SECOND_LACKS, SHARES, HostileCell, hostile_cells
from benchmarks.hostile.generate import write_cell
from benchmarks.hostile.judge import judge
from benchmarks.hostile.nuisances import drawn
from benchmarks.hostile.page import page_lines
from benchmarks.hostile.plants import chain_of, run
from benchmarks.withheld_effects.cells import Asked
from benchmarks.withheld_effects.motion import rich_motion
from benchmarks.withheld_effects.robot import given_robot, rigid_body_model
from benchmarks.withheld_effects.world import World, plain_world
from idim_iv_ros import load_configuration
from idim_iv_ros.identification.prepare import read_configured

SEED = 3
QUIET = {
    "computing": 0.0,
    "lateness": 0.0,
    "slot": 0.0,
    "bits": 40.0,
    "encoder_noise": 0.0,
    "torque_noise": 0.0,
    "warm_dry": 0.0,
    "warm_viscous": 0.0,
}


def smooth_world() -> World:
    """An arm without dry friction and noise, whose torque MuJoCo's inverse dynamics knows."""
    given = given_robot("arm2")
    world = plain_world(given, np.random.default_rng(0), altered=False)
    zero = np.zeros(2)
    drive = world.drive._replace(dry_forward=zero, dry_backward=zero)
    nuisances = replace(drawn(np.random.default_rng(0), given, identified=True), **QUIET)
    sensors = replace(nuisances.sensors(given), velocity=zero)
    return replace(world, drive=drive, sensors=sensors)


@pytest.mark.bench
@pytest.mark.parametrize("plant", ["time_stepping", "mujoco"])
def test_torque_of_a_plant_without_friction_is_that_of_the_inverse_dynamics(plant: str) -> None:
    world = smooth_world()
    given, period = world.given, world.controller.period
    motion = rich_motion(given, np.random.default_rng(1), 4.0)
    nuisances = replace(drawn(np.random.default_rng(0), given, identified=True), **QUIET)
    heat = np.zeros(2)
    made = run(world, plant, chain_of(nuisances, 2), motion, 5, heat)
    position = made.recorded.position
    velocity = np.gradient(position, period, axis=0)
    acceleration = np.gradient(velocity, period, axis=0)
    # The command of a period is held until the next, so that their mean acts at the stamp.
    acting = 0.5 * (made.recorded.command[1:] + made.recorded.command[:-1])
    model = rigid_body_model(given, world.inertials, world.gravity)
    data = mujoco.MjData(model)
    rigid = []
    for each in zip(position, velocity, acceleration, strict=True):
        data.qpos[:], data.qvel[:], data.qacc[:] = each
        torque = np.zeros(2)
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fwdVelocity(model, data)
        mujoco.mj_rne(model, data, 1, torque)
        rigid.append(torque)
    expected = np.array(rigid) + given.armature * acceleration + given.viscous * velocity
    left = (acting - expected[1:])[50:-50]
    # MuJoCo's step is of first order in time: what it calls now is half a step late.
    assert np.sqrt(np.mean(left**2)) < 0.02 * np.sqrt(np.mean(acting**2))


def test_cells_have_the_promised_shares() -> None:
    cells = hostile_cells(60, SEED)
    groups = [cell.group for cell in cells]
    assert {group: groups.count(group) for group in SHARES} == {
        group: 3 * share for group, share in SHARES.items()
    }
    assert sum(cell.robot != "arm2" for cell in cells) == 20
    second = [cell for cell in cells if cell.plant == "mujoco"]
    assert len(second) == 12
    assert not SECOND_LACKS & {each.effect for cell in second for each in cell.effects}
    assert {len(cell.effects) for cell in cells if cell.group in ("pair", "payload")} == {2}


def test_same_seed_draws_the_same_cells_and_another_seed_others() -> None:
    assert hostile_cells(40, SEED) == hostile_cells(40, SEED)
    assert hostile_cells(40, SEED) != hostile_cells(40, SEED + 1)


@pytest.mark.bench
@pytest.mark.parametrize("plant", ["time_stepping", "mujoco"])
def test_a_cell_can_be_read_and_its_configuration_does_not_tell_the_truth(
    plant: str, tmp_path: Path
) -> None:
    cell = HostileCell(0, "single", "arm2", plant, (Asked("stribeck", 1, 2.0),), (3.0, 3.5))
    write_cell(tmp_path, "one", cell, SEED)
    folder = tmp_path / "cells" / "one"
    configuration = load_configuration(folder / "robot.yaml")
    written = YAML(typ="safe").load((folder / "robot.yaml").read_text(encoding="utf-8"))
    assert "simulated_robot" not in written
    for bag in folder.glob("*.mcap"):
        (recording,) = read_configured([bag], configuration, None)
        assert recording.position.values.shape[1] == 2
        assert np.isfinite(recording.effort.values).all()
    label = json.loads((tmp_path / ".sealed" / "one.json").read_text(encoding="utf-8"))
    assert label["effects"][0]["effect"] == "stribeck"
    assert label["effects"][0]["joint"] == "joint_2"


def answer(*causes: tuple[str, str, str | None, list[tuple[str, str | None]]]) -> dict:
    """A gap.json with these causes: effect, kind, joint, and what they cannot be told from."""
    return {
        "format": "idim_iv_ros/gap/1",
        "verdict": "structural",
        "causes": [
            {
                "effect": effect,
                "kind": kind,
                "joint": joint,
                "indistinguishable_from": [
                    {"effect": name, "joint": place, "correlation": 1.0} for name, place in others
                ],
                "torque_gap": {"before": 1.0, "after": 0.5},
                "parameters": {"mass": {"value": 1.1, "std": 0.1, "unit": "kg"}},
            }
            for effect, kind, joint, others in causes
        ],
    }


def label(*effects: tuple[str, str | None], also_true: tuple[str, ...] = ()) -> dict:
    return {
        "group": "single",
        "robot": "arm2",
        "plant": "mujoco",
        "seconds": [10.0],
        "also_true": list(also_true),
        "nuisances": {"knows_controller": True},
        "effects": [
            {
                "effect": name,
                "joint": joint,
                "joints": [],
                "kind": "structural",
                "mass": 1.0,
                "rho": 1.0,
            }
            for name, joint in effects
        ],
    }


def test_a_truth_in_the_set_of_the_first_cause_is_a_hit() -> None:
    said = answer(("presliding", "structural", "joint_1", [("backlash", "joint_1")]))
    judged = judge(label(("backlash", "joint_1")), said, 1.0)
    assert judged.first and judged.found == (True,) and not judged.false_names
    assert judged.sets == (2,)


def test_an_effect_at_another_joint_is_a_false_name() -> None:
    said = answer(("backlash", "structural", "joint_2", []))
    judged = judge(label(("backlash", "joint_1")), said, 1.0)
    assert judged.false_names == ("backlash[joint_2]",)
    assert judged.outcome == "false name"


def test_errors_of_the_nominal_model_are_no_false_names_where_it_has_some() -> None:
    said = answer(
        ("link_inertia", "parametric", "joint_1", []), ("torque_gain", "parametric", "joint_1", [])
    )
    judged = judge(label(also_true=("link_inertia",)), said, 1.0)
    assert judged.false_names == ("torque_gain[joint_1]",)
    judged = judge(label(), said, 1.0)
    assert len(judged.false_names) == 2


def test_mass_of_a_payload_counts_where_it_is_in_its_interval() -> None:
    said = answer(("payload", "parametric", "joint_2", []))
    assert judge(label(("payload", "joint_2")), said, 1.0).mass_in_interval is True
    heavier = label(("payload", "joint_2"))
    heavier["effects"][0]["mass"] = 1.4
    assert judge(heavier, said, 1.0).mass_in_interval is False


def test_another_law_is_not_asked_for_where_none_is_configured() -> None:
    known = label(("controller_mismatch", "joint_1"))
    unknown = {**known, "nuisances": {"knows_controller": False}}
    assert judge(known, answer(), 1.0).outcome == "abstained"
    silent = judge(unknown, answer(), 1.0)
    assert silent.unanswerable == ("controller_mismatch",) and not silent.found
    assert silent.outcome.startswith("right: nothing named")
    said = answer(("torque_saturation", "structural", "joint_1", []))
    assert judge(unknown, said, 1.0).false_names == ("torque_saturation[joint_1]",)
    page = page_lines({"a": judge(known, answer(), 1.0), "b": silent}, {})
    assert any(
        line.startswith("| right effect and joint, 2 joints") and "0/1" in line for line in page
    )
