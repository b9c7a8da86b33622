"""A table instead of a bag: `init` writes the map that `import` takes."""

from pathlib import Path

import numpy as np

from idim_iv_ros.recording import read_recordings

TIME = np.arange(1500) * 0.002
POSITION = np.column_stack([np.sin(TIME), np.cos(2.0 * TIME)])
EFFORT = np.column_stack([3.0 * np.cos(TIME), np.sin(TIME)])


def test_init_proposes_a_map_that_imports(run, tmp_path: Path) -> None:
    header = "Time (ms),Pos J1,Pos J2,q_ref1,q_ref2,Vel J1,Vel J2,Tau J1,Tau J2,mode"
    table = np.column_stack([1e3 * TIME, POSITION, POSITION, EFFORT, EFFORT, np.zeros(len(TIME))])
    np.savetxt(tmp_path / "log.csv", table, delimiter=",", header=header, comments="")
    map_path, bag = tmp_path / "map.yaml", tmp_path / "log.mcap"
    run("init", tmp_path / "log.csv", "--out", map_path, status=0)
    assert "# Not used: mode" in map_path.read_text()
    run("import", bag, "--columns", map_path, status=0)
    (recording,) = read_recordings([bag], joints=["joint_1", "joint_2"])
    np.testing.assert_allclose(recording.position.values, POSITION, atol=1e-9)
    assert recording.unused_references == ("/joint_reference",)
