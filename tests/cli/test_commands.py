"""The commands as a user runs them."""

import json
from pathlib import Path

import numpy as np

from idim_iv_ros.recording import read_recordings


def test_table_becomes_a_bag_is_checked_and_identified(run, config, record, tmp_path: Path) -> None:
    table, bag, out = tmp_path / "run.npz", tmp_path / "run.mcap", tmp_path / "results"
    np.savez(table, q=record.position, tau=record.effort, ref=record.position_reference)
    (tmp_path / "map.yaml").write_text(
        "file: run.npz\nrate: 1000.0\njoints:\n"
        "  joint_1: {position: 'q[0]', effort: 'tau[0]', reference: 'ref[0]'}\n"
        "  joint_2: {position: 'q[1]', effort: 'tau[1]', reference: 'ref[1]'}\n"
    )
    imported = run("import", bag, "--columns", tmp_path / "map.yaml")
    assert imported.status == 0, imported.error
    assert "10000 samples" in imported.out
    checked = run("check", bag, "--config", config(), status=0)
    assert "Usable" in checked.out
    identified = run("identify", bag, "--config", config(), "--out", out, status=0)
    assert "Verdict" in identified.out
    assert len(identified.out.splitlines()) < 40
    assert (out / "report.html").is_file()
    document = json.loads((out / "result.json").read_text())
    assert document["format"] == "idim_iv_ros/identification/1"
    assert document["estimator"] == "idim-iv"
    assert document["converged"] is True
    expected = {
        *("format", "robot", "bags", "software", "estimator", "iterations", "converged"),
        *("parameters", "instruments", "exogeneity", "residuals", "fit", "refined", "timing"),
    }
    assert expected <= set(document)


def test_init_proposes_a_map_that_imports(run, record, tmp_path: Path) -> None:
    header = "Time (ms),Pos J1,Pos J2,q_ref1,q_ref2,Vel J1,Vel J2,Tau J1,Tau J2,mode"
    table = np.column_stack(
        [1e3 * record.time, *[record.position] * 2, *[record.effort] * 2, 0.0 * record.time]
    )
    np.savetxt(tmp_path / "log.csv", table, delimiter=",", header=header, comments="")
    map_path, bag = tmp_path / "map.yaml", tmp_path / "log.mcap"
    run("init", tmp_path / "log.csv", "--out", map_path, status=0)
    assert "# Not used: mode" in map_path.read_text()
    run("import", bag, "--columns", map_path, status=0)
    (recording,) = read_recordings([bag], joints=["joint_1", "joint_2"])
    np.testing.assert_allclose(recording.position.values, record.position, atol=1e-9)
    assert recording.unused_references == ("/joint_reference",)


def test_least_squares_on_request(run, config, bag, tmp_path: Path) -> None:
    out = tmp_path / "results"
    run(f"identify {bag} --config {config()} --out {out} --estimator idim-ls", status=0)
    document = json.loads((out / "result.json").read_text())
    assert document["estimator"] == "idim-ls"
    assert document["instruments"]["tests"][0]["reason"]
