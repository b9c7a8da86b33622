"""The benchmark of withheld effects: its cells, its plant, and the cells that are judged fast."""

import hashlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from scipy.signal import butter, sosfiltfilt

from benchmarks.withheld_effects.cells import Asked, Cell
from benchmarks.withheld_effects.drive import altered
from benchmarks.withheld_effects.generate import LABELS, SEAL, generate, write_cell, write_cells
from benchmarks.withheld_effects.run import run
from benchmarks.withheld_effects.score import open_labels, score
from benchmarks.withheld_effects.tables import page_lines
from benchmarks.withheld_effects.verdict import CellScore
from benchmarks.withheld_effects.world import record, with_drive
from tests.benchmarks.withheld_effects.sessions import courses, silent, world

SINGLE = Cell(7, "single", "arm2", True, (Asked("stribeck", 1, 1.0),), seconds=5.0)
CLEAN = Cell(8, "none", "arm2", False, seconds=5.0)
CELLS = {"aaaaaaaaaaaa": SINGLE, "bbbbbbbbbbbb": CLEAN}
pytestmark = pytest.mark.bench


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    out = tmp_path_factory.mktemp("cells")
    (out / "cells").mkdir()
    for name, cell in CELLS.items():
        write_cell(out, name, cell, 3)
    stamps = {path: path.stat().st_mtime_ns for path in (out / "cells").rglob("*.mcap")}
    # All cells are whole: nothing is left but to seal.
    write_cells(out, CELLS, master=3, processes=1)
    assert {path: path.stat().st_mtime_ns for path in stamps} == stamps
    return out


def test_folders_tell_nothing_of_the_label(written):
    folders = [written / "cells" / name for name in CELLS]
    first, second = ({path.name: path.read_bytes() for path in f.iterdir()} for f in folders)
    assert first.keys() == second.keys()
    assert first["robot.yaml"] == second["robot.yaml"]
    assert not any(b"stribeck" in content for content in (*first.values(), *second.values()))


def test_labels_are_sealed_and_a_changed_one_is_refused(written):
    text = (written / LABELS).read_text()
    assert (written / SEAL).read_text().split()[0] == hashlib.sha256(text.encode()).hexdigest()
    label = open_labels(written)["aaaaaaaaaaaa"]
    (effect,) = label["effects"]
    assert (effect["effect"], effect["joint"]) == ("stribeck", "joint_2")
    assert effect["rho"] == pytest.approx(1.0, rel=0.15)
    assert label["residual_rms"]["with"]["joint_2"] > label["residual_rms"]["without"]["joint_2"]
    (written / LABELS).write_text(text.replace("stribeck", "backlash"))
    try:
        with pytest.raises(ValueError, match="sealed"):
            open_labels(written)
    finally:
        (written / LABELS).write_text(text)


@pytest.mark.parametrize("robot", ["arm2", "arm6"])
def test_without_effects_the_torque_is_pinocchios_inverse_dynamics(robot):
    noise = world(robot).sensors.torque
    true = silent(world(robot))
    course = courses(robot, 8.0)[0]
    recorded = record(true, course.position, course.velocity, seed=1)
    period = true.controller.period
    velocity = np.gradient(recorded.position, period, axis=0)
    acceleration = (
        np.roll(recorded.position, -1, 0)
        - 2.0 * recorded.position
        + np.roll(recorded.position, 1, 0)
    ) / period**2
    model = pin.buildModelFromUrdf(str(true.given.urdf))
    for k in range(model.nv):
        model.inertias[k + 1] = pin.Inertia(
            true.inertials.mass[k], true.inertials.centre[k], true.inertials.inertia[k]
        )
    data = model.createData()
    motion = zip(recorded.position, velocity, acceleration, strict=True)
    torque = np.array([pin.rnea(model, data, *instant) for instant in motion])
    torque += true.drive.inertia * acceleration + true.drive.viscous_forward * velocity
    torque += true.drive.dry_forward * np.sign(velocity)
    low = butter(4, 20.0, fs=1.0 / period, output="sos")
    gap = sosfiltfilt(low, recorded.clean_effort - torque, axis=0)
    for j in range(model.nv):
        slow = np.abs(velocity[:, j]) < 0.02
        moving = np.convolve(slow, np.ones(161), "same") == 0.0
        moving[:300] = moving[-300:] = False
        assert moving.sum() > 1000
        # Far below the noise that the recordings get (0.2 of its deviation passes the filter).
        assert np.sqrt(np.mean(gap[moving, j] ** 2)) < 0.04 * noise[j]


def test_a_delay_shifts_the_torque_by_itself():
    true = silent(world())
    late = with_drive(true, altered(true.drive, 0, delay=3.4e-3))
    pulse = np.zeros((400, 2))
    pulse[100:, 0] = 5.0
    moved = []
    for arm in (true, late):
        # Frictionless, so that the first torque of the pulse moves the joint.
        none = np.zeros(2)
        arm = with_drive(arm, arm.drive._replace(dry_forward=none, dry_backward=none))
        still = np.tile(arm.given.centre, (400, 1))

        def feedforward(_, position):
            return np.concatenate([np.zeros((len(position) - 400, 2)), pulse])

        law = arm.controller._replace(kp=none, kd=none)
        arm = replace(arm, controller=law, feedforward=feedforward, gravity=np.zeros(3))
        moved.append(record(arm, still, np.zeros_like(still), seed=1).link[:, 0])
    swing = moved[0] - moved[0][0]
    time = np.arange(400) * 1e-3
    shifted = np.interp(time - 3.4e-3, time, swing)
    assert np.abs(moved[1] - moved[1][0] - shifted).max() < 5e-3 * swing.max()


@pytest.fixture(scope="module")
def scores(tmp_path_factory) -> list[CellScore]:
    out: Path = tmp_path_factory.mktemp("withheld")
    generate(out, "fast")
    assert run(out) == 0
    scored = score(out)
    print("\n" + "\n".join(page_lines(scored)))
    assert not scored.missing
    return list(scored.cells.values())


def of_group(cells: list[CellScore], *groups: str) -> list[CellScore]:
    """Cells of these groups, of which there are some."""
    chosen = [cell for cell in cells if cell.label["group"] in groups]
    assert chosen
    return chosen


def tolerated(cells: list[CellScore], share: float) -> int:
    """So many of these cells may be wrong."""
    return int(share * len(cells))


@pytest.mark.parametrize(
    ("groups", "share"),
    [(("none",), 1 / 12), (("outside",), 1 / 4), (("poor", "coloured", "jitter"), 1 / 5)],
    ids=["nothing", "outside the catalogue", "poor motions, coloured noise, uneven stamps"],
)
def test_what_is_not_there_is_not_named(scores: list[CellScore], groups, share: float) -> None:
    cells = [cell for cell in of_group(scores, *groups) if not cell.label["without"]]
    assert sum(bool(cell.false_alarms) for cell in cells) <= tolerated(cells, share)


def test_right_effect_at_the_right_joint_comes_first(scores: list[CellScore]) -> None:
    single = of_group(scores, "single")
    assert sum(not cell.first for cell in single) <= tolerated(single, 2 / 16)
    sizes = [cell.set_size for cell in single if cell.set_size]
    assert sum(sizes) / len(sizes) <= 1.5


def test_both_of_a_pair_are_found(scores: list[CellScore]) -> None:
    pairs = of_group(scores, "pair")
    named = [named for cell in pairs for named in cell.named]
    assert named.count(False) <= tolerated(named, 1 / 4)


def test_wrong_numbers_are_found(scores: list[CellScore]) -> None:
    assert all(cell.first for cell in of_group(scores, "parametric"))
