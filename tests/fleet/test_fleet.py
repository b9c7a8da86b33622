"""Runs over a fleet: interrupted, repeated, on one worker or many, the answer is one."""

import os
import shutil
import signal
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import dask
import numpy as np
import psutil
import pytest
from pyarrow import parquet

from bags import simulated_arms
from idim_iv_ros.configuration import Configuration, load_configuration
from idim_iv_ros.errors import DataError, UsageError
from idim_iv_ros.fleet import commands
from idim_iv_ros.fleet.commands import (
    BAGS,
    FleetRun,
    connected,
    identify_bags,
    identify_task,
    owned_by,
    run_tasks,
)
from idim_iv_ros.fleet.regression import bag_fields
from idim_iv_ros.fleet.result import TABLE, BagResult, write_table
from idim_iv_ros.fleet.source import (
    Robot,
    code_version,
    configuration_digest,
    content_of,
    find_bags,
    robots_of,
)
from idim_iv_ros.identification.identify import identify
from idim_iv_ros.identification.prepare import configured_request
from idim_iv_ros.recording.bags.folder import Bag
from idim_iv_ros.recording.read import read_segments
from idim_iv_ros.recording.writing.write import write_bag
from tests.estimation.test_simulated_arms import truth_of
from tests.fleet.conftest import CONFIG, BagFolder
from tests.inputs import changed


class LocalRun(FleetRun):
    """A run in this process, without Dask."""

    def tasks(
        self,
        function: Callable[..., Any],
        arguments: Sequence[tuple[Any, ...]],
        done: Callable[[int, Any, str], None],
    ) -> None:
        for place, values in enumerate(arguments):
            done(place, function(*values), "")


def kill_workers() -> int:
    """End with kill -9 the processes that Dask started below this one."""
    killed = 0
    for child in psutil.Process().children(recursive=True):
        if "spawn_main" in " ".join(child.cmdline()):
            os.kill(child.pid, signal.SIGKILL)
            killed += 1
    return killed


def rows_of(results: Sequence[BagResult], folder: Path) -> list[dict[str, Any]]:
    write_table(results, folder / TABLE)
    rows: list[dict[str, Any]] = parquet.read_table(folder / TABLE).to_pylist()
    return rows


@pytest.fixture(scope="module")
def serial(folder: BagFolder) -> tuple[BagResult, ...]:
    """The bags one after the other in this process, without Dask."""
    entries, robots = robots_of(find_bags(str(folder.path)), CONFIG)
    return tuple(
        owned_by(identify_task(entry.uri, content_of(entry.uri), "", robots[entry.robot]), entry)
        for entry in entries
    )


def test_a_worker_that_is_killed_changes_nothing(folder, serial, tmp_path) -> None:
    killed = []

    def kill_once(stage: str, share: float) -> None:
        if stage.startswith("identifying 1 of") and not killed:
            killed.append(kill_workers())

    results = identify_bags(FleetRun(str(folder.path), CONFIG, tmp_path, workers=1), kill_once)
    assert killed == [1]
    rows = [rows_of(given, tmp_path) for given in (results, serial)]
    for row, other in zip(*rows, strict=True):
        for name, value in other.items():
            near = pytest.approx(value, rel=1e-12) if isinstance(value, float) else value
            assert row[name] == near, name
    for bag, same in zip(results, serial, strict=True):
        np.testing.assert_allclose(bag.r_factor, same.r_factor, rtol=1e-12, atol=1e-300)


def test_the_estimate_of_a_bag_is_that_of_identify(folder, serial) -> None:
    alone = identify(folder.bags[0], load_configuration(CONFIG))
    bag = serial[0]
    assert (bag.uri, bag.estimator) == (str(folder.bags[0]), "idim-iv")
    assert alone.instruments.accepted
    parameters = [(parameter.value, parameter.std) for parameter in alone.parameters]
    assert list(zip(bag.values, bag.std, strict=True)) == parameters


def test_the_r_factor_holds_the_whitened_regression(serial: tuple[BagResult, ...]) -> None:
    for bag in serial[:3]:
        upper, right = bag.r_factor[:-1, :-1], bag.r_factor[:-1, -1]
        values = np.linalg.solve(upper, right)
        std = np.linalg.norm(np.linalg.inv(upper), axis=1)
        # The same rows, other weights and instruments: the same within a deviation.
        assert np.abs((values - bag.values) / std).max() < 1.0
        # Whitened to variance one: the mean square of the residual, within four deviations of it.
        degrees = bag.rows - len(values)
        assert abs(bag.r_factor[-1, -1] ** 2 / degrees - 1.0) < 4.0 * np.sqrt(2.0 / degrees)


def test_a_corrupt_bag_is_a_row_with_its_reason(folder, serial) -> None:
    corrupt = next(bag for bag in serial if bag.uri == str(folder.corrupt))
    assert (corrupt.status, corrupt.robot) == ("corrupt", "arm-2")
    assert "the file ends in the middle" in corrupt.reason
    assert "\n" not in corrupt.reason
    assert [bag.status for bag in serial if bag is not corrupt] == ["ok"] * 3


def test_a_second_run_does_only_what_is_missing(folder: BagFolder, tmp_path: Path) -> None:
    bags, out = tmp_path / "bags", tmp_path / "out"
    shutil.copytree(folder.path, bags)
    stages: list[str] = []

    def run() -> tuple[BagResult, ...]:
        stages.clear()
        run = LocalRun(str(bags), CONFIG, out)
        return identify_bags(run, lambda stage, share: stages.append(stage))

    first = run()
    assert any(stage.startswith("identifying 4 of 4 bags") for stage in stages)
    assert len(list((out / BAGS).iterdir())) == 4
    again = run()
    assert not any(stage.startswith("identifying") for stage in stages)
    assert [bag.to_document() for bag in again] == [bag.to_document() for bag in first]
    next((out / BAGS).glob(f"{first[1].key}*")).write_text("{", encoding="utf-8")  # torn
    (bags / "arm-1" / "run-1.mcap").rename(bags / "arm-1" / "other-name.mcap")
    third = run()
    assert any(stage.startswith("identifying 1 of 1 bags") for stage in stages)
    assert third[0].uri.endswith("other-name.mcap")
    assert third[0].values == first[0].values


def test_a_recording_that_is_there_twice_counts_once(folder: BagFolder, tmp_path: Path) -> None:
    for name in ("a.mcap", "b.mcap"):
        shutil.copy(folder.bags[0], tmp_path / name)
    first, second = identify_bags(LocalRun(str(tmp_path), CONFIG, tmp_path / "out"))
    assert (first.status, second.status) == ("ok", "unusable")
    assert second.reason == f"the same recording as {tmp_path / 'a.mcap'}"


def test_a_robot_is_its_description_wherever_the_file_lies() -> None:
    robot = Robot.of(load_configuration(CONFIG))
    other = robot.description.replace(b'<mass value="', b'<mass value="1')
    assert configuration_digest(robot.configuration, other) != robot.digest
    moved = changed(robot.configuration, "robot", urdf=Path("/nowhere/arm2.urdf"))
    assert configuration_digest(moved, robot.description) == robot.digest
    path = Robot(moved, robot.description, robot.digest).local().robot.urdf
    assert path is not None and path.read_bytes() == robot.description


@pytest.fixture(scope="module")
def client() -> Iterator[Any]:
    with connected(workers=1) as client:
        yield client


def answers_of(client: Any, function: Any, *arguments: int) -> dict[int, tuple[Any, str]]:
    answers: dict[int, tuple[Any, str]] = {}

    def done(place: int, answer: Any, why: str) -> None:
        answers[place] = (answer, why)

    run_tasks(client, function, [(argument,) for argument in arguments], done)
    return answers


def reciprocal(value: int) -> float:
    if value == 1:
        raise ImportError("no package of that name")
    if value == 0:
        raise ValueError("nothing to divide by")
    return 1.0 / value


def test_workers_keep_no_call_stacks(client: Any) -> None:
    """Dask's profiler keeps those of an hour: a worker would grow with every bag."""
    settings = client.run(dask.config.get, "distributed.worker.profile.enabled")
    assert list(settings.values()) == [False]


def test_a_task_that_fails_is_one_answer_with_its_reason(client: Any) -> None:
    """Also where it looks like a worker without this program, which has the same version here."""
    assert answers_of(client, reciprocal, 4, 0, 1, 2) == {
        0: (0.25, ""),
        1: (None, "ValueError: nothing to divide by"),
        2: (None, "ImportError: no package of that name"),
        3: (0.5, ""),
    }


def test_a_worker_of_another_version_ends_the_run_whenever_it_came(client, monkeypatch) -> None:
    its = code_version()
    monkeypatch.setattr(commands.source, "code_version", lambda: "0.1+other")
    with pytest.raises(UsageError) as refused:
        answers_of(client, reciprocal, 2)
    for words in (client.scheduler.address, its, "0.1+other"):
        assert words in str(refused.value)


def test_workers_and_scheduler_exclude_each_other() -> None:
    with pytest.raises(UsageError, match="--workers is for this machine"):
        FleetRun("bags", CONFIG, "out", scheduler="tcp://x:1", workers=2)


@pytest.fixture(scope="module")
def arm() -> simulated_arms.SimulatedArm:
    return simulated_arms.arm2(seconds=24.0, rate=250.0)


@pytest.fixture(scope="module")
def bag(arm: simulated_arms.SimulatedArm, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("long") / "run.mcap"
    write_bag(path, simulated_arms.joint_topics(arm, simulated_arms.record(arm, 1)))
    return path


def fields(bag: Path, configuration: Configuration, seconds: float) -> dict[str, Any]:
    request = configured_request(configuration)
    return bag_fields(read_segments(Bag(bag), request, seconds), configuration)


@pytest.mark.parametrize(
    "reference", ["/joint_reference", pytest.param(None, marks=pytest.mark.slow)]
)
def test_segments_give_the_true_parameters_as_the_whole_bag_does(arm, bag, reference) -> None:
    filters = {"position_cutoff": 20.0, "decimation_cutoff": 8.0, "minimum_speed": [0.05, 0.05]}
    # So that they do not depend on what is recorded.
    configuration = changed(load_configuration(CONFIG), "processing", **filters)
    configuration = changed(configuration, "signals", reference=reference)
    whole, parts = (fields(bag, configuration, seconds) for seconds in (60.0, 8.0))
    assert parts["checks"][0] == "read in 3 segments"
    assert 0.9 < parts["rows"] / whole["rows"] < 1.0  # four edges more
    truth = truth_of(arm)
    for answer in (whole, parts):
        assert answer["estimator"] == ("idim-iv" if reference else "idim-ls")
        expected = np.array([truth[name] for name in answer["names"]])
        assert np.abs((answer["values"] - expected) / answer["std"]).max() < 4.0
    np.testing.assert_allclose(parts["std"], whole["std"], rtol=0.25)


def test_a_segment_without_an_estimate_is_left_out(bag: Path) -> None:
    configuration = load_configuration(CONFIG)
    segments = list(read_segments(Bag(bag), configured_request(configuration), 8.0))
    whole = bag_fields(segments[1:], configuration)
    answer = bag_fields([DataError("it holds nothing"), *segments[1:]], configuration)
    assert answer["checks"][-1] == "a segment is left out: it holds nothing"
    assert answer["values"] == whole["values"]
    with pytest.raises(DataError, match="it holds nothing"):
        bag_fields([DataError("it holds nothing")], configuration)
