"""`idim-iv fleet` as a user sees it."""

import builtins
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest
from s3fs import S3FileSystem

from idim_iv_ros.errors import UsageError
from idim_iv_ros.fleet.commands import BAGS, FleetRun, connected
from idim_iv_ros.fleet.source import file_system
from tests.cli.conftest import run as run
from tests.fleet.conftest import CONFIG, BagFolder
from tests.fleet.test_fleet import LocalRun


def test_identify_writes_the_answer_and_says_what_was_left_out(run, folder, tmp_path, monkeypatch):
    monkeypatch.setattr(FleetRun, "tasks", LocalRun.tasks)
    arguments = ("fleet", "identify", folder.path, "--config", CONFIG, "--out", tmp_path)
    outcome = run(*arguments, status=0)
    assert "3 of 4 bags used, 2 robots" in outcome.out
    assert f"Not used: {folder.corrupt}: nothing can be read of it" in outcome.out
    document = json.loads((tmp_path / "fleet.json").read_text(encoding="utf-8"))
    assert document["format"] == "idim_iv_ros/fleet/1"
    assert [bag["status"] for bag in document["bags"]] == ["ok", "ok", "ok", "corrupt"]
    written = {path.name for path in tmp_path.iterdir()}
    assert written == {BAGS, "fleet.json", "fleet.parquet", "fleet.html"}
    assert run(*arguments).status == 0  # its own files are replaced
    (tmp_path / "fleet.parquet").write_bytes(b"PAR1 of somebody else PAR1")
    refused = run(*arguments, status=2)
    assert "fleet.parquet: exists, and was not written by idim_iv_ros" in refused.error


def test_a_bag_that_is_not_there_is_missing_and_not_corrupt(folder, tmp_path, run, monkeypatch):
    monkeypatch.setattr(FleetRun, "tasks", LocalRun.tasks)
    manifest = tmp_path / "manifest.csv"
    lines = ["uri,robot", f"{folder.corrupt},arm-2", "gone/run-1.mcap,arm-3", "gone,arm-3"]
    manifest.write_text("\n".join(lines) + "\n", encoding="utf-8")
    outcome = run(f"fleet identify {manifest} --config {CONFIG} --out {tmp_path / 'out'}", status=1)
    assert f"Next: idim-iv check {folder.corrupt} --config {CONFIG}" in outcome.out
    for path in (tmp_path / "gone" / "run-1.mcap", tmp_path / "gone"):
        assert f"{path}: no such file" in outcome.out
    document = json.loads((tmp_path / "out" / "fleet.json").read_text(encoding="utf-8"))
    assert [bag["status"] for bag in document["bags"]] == ["corrupt", "missing", "missing"]
    assert "2 of 2 bags could not be used: missing" in str(document["robots"])
    page = (tmp_path / "out" / "fleet.html").read_text(encoding="utf-8")
    assert "1 corrupt, 2 missing" in page


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["nowhere.csv"], "nowhere.csv: no such file, folder or URL"),
        (["{empty}"], "no bag found"),
        (["{bags}", "--workers", "0"], "--workers 0: at least one is needed"),
        (["s3x://bucket/bags"], "s3x:// is no kind of store"),
        (["{stores}"], "foo:// is no kind of store"),  # before any bag is looked at
    ],
)
def test_wrong_use_is_one_line(run, folder, tmp_path, arguments, words) -> None:
    empty, stores = tmp_path / "empty", tmp_path / "stores.csv"
    empty.mkdir()
    stores.write_text(f"uri,robot\n{folder.bags[0]},arm-1\nfoo://b/a.mcap,arm-2\n")
    places = {"bags": folder.path, "empty": empty, "stores": stores}
    given = [argument.format(**places) for argument in arguments]
    outcome = run("fleet", "identify", *given, "--config", CONFIG, "--out", tmp_path / "out")
    assert outcome.status == 2
    assert words in outcome.error
    assert outcome.error.count("\n") == 1
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("source", ["s3://nobody/bags", "{manifest}"])
def test_credentials_that_are_missing_are_no_fault_of_the_bags(
    run: Any, folder: BagFolder, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, source: str
) -> None:
    monkeypatch.setattr(S3FileSystem, "_cache", {})  # of clients with credentials
    for name in ("AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY", "AWS_PROFILE"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("AWS_EC2_METADATA_DISABLED", "true")
    monkeypatch.setenv("AWS_ENDPOINT_URL", "http://127.0.0.1:9")
    monkeypatch.setenv("AWS_CONFIG_FILE", str(tmp_path / "none"))
    monkeypatch.setenv("AWS_SHARED_CREDENTIALS_FILE", str(tmp_path / "none"))
    manifest = tmp_path / "manifest.csv"
    manifest.write_text(f"uri,robot\ns3://none/a.mcap,arm-2\n{folder.bags[0]},arm-1\n")
    out = tmp_path / "out"
    command = f"fleet identify {source.format(manifest=manifest)} --config {CONFIG} --out {out}"
    outcome = run(command, status=2)
    assert "no credentials" in outcome.error and "AWS_ACCESS_KEY_ID" in outcome.error
    assert "corrupt" not in outcome.out + outcome.error
    assert not out.exists()


def test_without_the_extra_one_line_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    imported = builtins.__import__

    def missing(name: str, *arguments: Any) -> Any:
        if name.partition(".")[0] in ("dask", "distributed", "fsspec"):
            raise ModuleNotFoundError(name)
        return imported(name, *arguments)

    monkeypatch.setattr(builtins, "__import__", missing)
    for call in (lambda: file_system("bags"), lambda: connected().__enter__()):
        with pytest.raises(UsageError, match=r'pip install "idim-iv-ros\[fleet\]"'):
            call()


@pytest.mark.slow
def test_an_interruption_keeps_what_is_done(folder: BagFolder, tmp_path: Path) -> None:
    many = tmp_path / "bags"
    for robot in range(40):  # far more than are done before the interruption arrives
        (many / f"arm-{robot}").mkdir(parents=True)
        (many / f"arm-{robot}" / "run.mcap").hardlink_to(folder.bags[0])
    command = [sys.executable, "-c", "from idim_iv_ros.cli.main import main; main()"]
    arguments = ["fleet", "identify", many, "--config", CONFIG, "--out", tmp_path]
    process = subprocess.Popen(
        [*command, *map(str, arguments), "--workers", "1"],
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    deadline = time.monotonic() + 300.0
    while not list((tmp_path / BAGS).glob("*.json")) and time.monotonic() < deadline:
        time.sleep(0.05)
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does: to workers, too
    _, error = process.communicate(timeout=60.0)
    assert process.returncode == 130
    said = [line for line in error.splitlines() if not line[:1].isdigit()]
    assert len(said) == 1, error
    assert said[0].startswith("idim-iv: interrupted: ")
    assert said[0].endswith("of 40 bags are done and kept; the same command goes on from there")
    kept = list((tmp_path / BAGS).glob("*.json"))
    assert kept
    assert {json.loads(path.read_text())["format"] for path in kept} == {"idim_iv_ros/bag/1"}
    with pytest.raises(ProcessLookupError):  # no worker is left behind
        while time.monotonic() < deadline:
            os.killpg(process.pid, 0)
            time.sleep(0.05)
