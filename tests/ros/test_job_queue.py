"""Jobs one after the other, with a worker that does what the test says and a clock that it sets."""

import signal
from collections.abc import Callable
from pathlib import Path

import pytest

from idim_iv_ros.configuration import Configuration
from idim_iv_ros.errors import UsageError
from idim_iv_ros.nodes.identifier.job import Job, JobListener
from idim_iv_ros.nodes.identifier.job_queue import JobQueue
from idim_iv_ros.nodes.settings import REFUSE, IdentifierSettings


class ToldWorker:
    """In the place of the process: it begins a job, and the test says how it goes on."""

    def __init__(self, heard: Callable[["ToldWorker", dict], None]) -> None:
        self._heard = heard
        self.requests: list[dict] = []
        self.process_id: int | None = None
        self.ready, self.killed = True, False

    def begin(self, request: dict) -> None:
        self.requests.append(request)
        self.process_id = 99

    def say(self, **event: object) -> None:
        self._heard(self, event)

    def end(self, **answer: object) -> None:
        """Answer, and end the process of the job."""
        self.say(**answer)
        self.process_id = None
        self.say(ended=0)

    def kill(self) -> None:
        self.process_id = None
        self.say(ended=-signal.SIGKILL)

    def close(self) -> None:
        """Nothing is left to be ended."""


class Bench:
    """A queue with what surrounds it."""

    def __init__(self, folder: Path) -> None:
        self.settings = IdentifierSettings(output_directory=str(folder), queue_limit=2)
        self.now = 1000.0
        self.workers: list[ToldWorker] = []
        self.log: list[tuple] = []
        self.queue = JobQueue(
            lambda: self.settings, lambda: None, self._ended, lambda: self.now, self._start
        )

    def _start(self, heard) -> ToldWorker:
        self.workers.append(ToldWorker(heard))
        return self.workers[-1]

    @property
    def worker(self) -> ToldWorker:
        return self.workers[-1]

    def _ended(self, job: Job) -> None:
        self.log.append((*job.names, job.success, job.message))

    def submit(self, name: str, **values: object) -> Job:
        listener = JobListener(
            ended=lambda success, message: None,
            started=lambda: self.log.append((name, "started")),
            progress=lambda stage, share: self.log.append((name, stage, share)),
        )
        configuration = Configuration.model_validate({"robot": {"joints": ["a"]}})
        job = Job("identification", (Path(name),), (name,), configuration, 5.0, listener, **values)
        self.queue.submit(job)
        return job

    def poll(self, seconds: float = 0.0) -> list[tuple]:
        """Let time pass, and return what was heard since the last look."""
        self.now += seconds
        self.queue.poll()
        heard, self.log = self.log, []
        return heard


@pytest.fixture
def bench(tmp_path: Path) -> Bench:
    return Bench(tmp_path)


def test_jobs_are_done_in_order_by_one_process(bench: Bench) -> None:
    bench.submit("a")
    assert bench.poll() == [("a", "waiting", 0.0), ("a", "started")]
    bench.submit("b")
    bench.submit("c")
    assert bench.poll() == [("b", "waiting", 0.0), ("c", "waiting", 0.0)]
    assert (bench.queue.waiting, bench.queue.process_id) == (2, 99)
    bench.worker.say(stage="reading", progress=0.25)
    bench.worker.end(message="valid")
    assert bench.poll() == [("a", "reading", 0.25), ("b", "started"), ("a", True, "valid")]
    bench.worker.end(error="no motion")
    assert bench.poll() == [("c", "started"), ("b", False, "no motion")]
    bench.worker.end(message="valid")
    assert bench.poll() == [("c", True, "valid")]
    assert bench.queue.running is None
    (worker,) = bench.workers
    assert [request["bags"] for request in worker.requests] == [["a"], ["b"], ["c"]]
    there = {str(path) for path in Path(bench.settings.output_directory).iterdir()}
    assert there == {worker.requests[0]["out"], worker.requests[2]["out"]}


def test_too_many_are_refused(bench: Bench) -> None:
    for name in "abc":
        bench.submit(name)
        bench.poll()
    with pytest.raises(UsageError, match="2 jobs wait already"):
        bench.submit("d")
    bench.settings = IdentifierSettings(
        output_directory=bench.settings.output_directory, when_busy=REFUSE
    )
    with pytest.raises(UsageError, match="when_busy"):
        bench.submit("d")
    assert len(bench.worker.requests) == 1


def test_a_request_is_answered_in_time_whether_it_waits_or_is_worked_on(bench: Bench) -> None:
    bench.submit("a")
    bench.poll()
    bench.submit("b", answer_within=0.3)
    bench.submit("c", answer_within=0.5)
    assert (bench.poll(0.29), bench.queue.waiting) == (
        [("b", "waiting", 0.0), ("c", "waiting", 0.0)],
        2,
    )
    assert bench.poll(0.02) == [("b", False, "not begun within 0.3 s: 1 job was before it")]
    bench.worker.end(message="valid")
    assert bench.poll() == [("c", "started"), ("a", True, "valid")]
    assert bench.poll(0.18) == []
    bench.poll(0.02)
    assert bench.poll() == [("c", False, "ended after 0.5 s without a result")]


def test_the_work_on_a_job_is_limited_from_its_start(bench: Bench) -> None:
    bench.submit("a")
    bench.submit("b")
    bench.poll()
    bench.poll(4.9)
    bench.worker.end(message="valid")
    bench.poll()
    bench.poll(4.9)
    assert bench.queue.running is not None
    bench.poll(0.2)
    assert bench.poll() == [("b", False, "ended after 5 s without a result")]
    bench.submit("c")
    assert ("c", "started") in bench.poll()
    assert len(bench.workers) == 1


def test_who_asked_hears_every_second_what_is_done(bench: Bench) -> None:
    bench.submit("a")
    bench.submit("b")
    bench.poll()
    bench.worker.say(stage="regressor", progress=0.5)
    assert bench.poll(0.9) == [("a", "regressor", 0.5)]
    assert bench.poll(0.2) == [("b", "waiting", 0.0)]
    assert bench.poll(0.9) == [("a", "regressor", 0.5)]
    assert bench.poll(0.9) == [("b", "waiting", 0.0)]


def test_jobs_are_cancelled_before_and_while_they_are_worked_on(bench: Bench) -> None:
    first, second = bench.submit("a"), bench.submit("b")
    bench.poll()
    bench.queue.cancel(second)
    assert bench.poll() == [("b", False, "cancelled")]
    bench.queue.cancel(first)
    assert bench.poll() == [("a", False, "cancelled")]
    assert (first.cancelled, second.cancelled) == (True, True)
    assert not list(Path(bench.settings.output_directory).iterdir())


def test_an_answer_that_comes_after_the_end_was_asked_for_does_not_count(bench: Bench) -> None:
    job = bench.submit("a")
    bench.poll()
    bench.worker.say(message="valid")
    bench.queue.cancel(job)
    assert bench.poll() == [("a", False, "cancelled")]


def test_the_next_job_has_a_process_after_one_was_killed(bench: Bench) -> None:
    bench.submit("a")
    bench.submit("b")
    bench.poll()
    bench.worker.say(gone=-signal.SIGKILL)
    heard = bench.poll()
    assert heard == [("b", "started"), ("a", False, "the worker was ended by SIGKILL")]
    assert len(bench.workers) == 2
    bench.workers[0].end(message="late")
    assert bench.poll() == []
    bench.workers[1].end(message="valid")
    assert bench.poll() == [("b", True, "valid")]


def test_a_process_that_cannot_be_started_is_said(bench: Bench, monkeypatch) -> None:
    def start(heard) -> ToldWorker:
        raise OSError(12, "Cannot allocate memory")

    monkeypatch.setattr(bench.queue, "_start_worker", start)
    bench.submit("a")
    assert bench.poll()[-1] == ("a", False, "cannot be begun: Cannot allocate memory")


def test_all_are_answered_when_the_node_ends(bench: Bench) -> None:
    for name in "ab":
        bench.submit(name)
    bench.poll()
    bench.queue.close()
    ended = [item for item in bench.log if len(item) == 3]
    assert sorted(ended) == [(name, False, "the identifier was shut down") for name in "ab"]
