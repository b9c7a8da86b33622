import hashlib

import pytest

from benchmarks.withheld_effects.cells import RATIOS, Asked, Cell, all_cells, chosen_cells
from benchmarks.withheld_effects.effects import EFFECTS, STRUCTURAL, VARIANTS
from benchmarks.withheld_effects.generate import LABELS, SEAL, write_cell, write_cells
from benchmarks.withheld_effects.score import open_labels

SINGLE = Cell(7, "single", "arm2", True, (Asked("stribeck", 1, 1.0),), seconds=5.0)
CLEAN = Cell(8, "none", "arm2", False, seconds=5.0)
CELLS = {"aaaaaaaaaaaa": SINGLE, "bbbbbbbbbbbb": CLEAN}


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


def test_the_list_holds_what_the_benchmark_promises():
    cells = all_cells()
    assert [cell.index for cell in cells] == list(range(len(cells)))
    quiet = [cell for cell in cells if cell.group == "none" and cell.robot == "arm2"]
    assert sum(not cell.altered and cell.without is None for cell in quiet) >= 100
    single = {(c.effects[0].effect, c.effects[0].rho) for c in cells if c.group == "single"}
    assert {(name, rho) for name in STRUCTURAL for rho in RATIOS} <= single
    assert {cell.without for cell in cells if cell.group == "without"} == set(STRUCTURAL)
    assert {asked.effect for cell in cells for asked in cell.effects} == {*EFFECTS} - {*VARIANTS}
    assert set(chosen_cells("families")) < set(chosen_cells("fast")) < set(cells)
    assert all_cells() == cells
    assert all_cells(1) != cells


@pytest.mark.bench
def test_folders_tell_nothing_of_the_label(written):
    out = written
    contents = []
    for name in CELLS:
        folder = out / "cells" / name
        contents.append(sorted(path.name for path in folder.iterdir()))
        for path in folder.iterdir():
            assert b"stribeck" not in path.read_bytes()
        assert (folder / "robot.yaml").read_bytes() == (
            out / "cells" / "bbbbbbbbbbbb" / "robot.yaml"
        ).read_bytes()
    assert contents[0] == contents[1]


@pytest.mark.bench
def test_labels_are_sealed_and_a_changed_one_is_refused(written):
    out = written
    text = (out / LABELS).read_text()
    assert (out / SEAL).read_text().split()[0] == hashlib.sha256(text.encode()).hexdigest()
    label = open_labels(out)["aaaaaaaaaaaa"]
    (effect,) = label["effects"]
    assert (effect["effect"], effect["joint"]) == ("stribeck", "joint_2")
    assert effect["rho"] == pytest.approx(1.0, rel=0.15)
    assert label["residual_rms"]["with"]["joint_2"] > label["residual_rms"]["without"]["joint_2"]
    (out / LABELS).write_text(text.replace("stribeck", "backlash"))
    try:
        with pytest.raises(ValueError, match="sealed"):
            open_labels(out)
    finally:
        (out / LABELS).write_text(text)
