"""Tasks on workers of this machine: what they run, and that it is the same program."""

from collections.abc import Iterator
from typing import Any

import dask
import pytest

from idim_iv_ros.errors import UsageError
from idim_iv_ros.fleet import run as scheduling
from idim_iv_ros.fleet.robots import code_version
from idim_iv_ros.fleet.run import connected, run_tasks


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
    monkeypatch.setattr(scheduling, "code_version", lambda: "0.1+other")
    with pytest.raises(UsageError) as refused:
        answers_of(client, reciprocal, 2)
    for words in (client.scheduler.address, its, "0.1+other"):
        assert words in str(refused.value)
