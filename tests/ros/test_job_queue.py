"""Jobs one after the other, with a worker that does what the test says and a clock that it sets."""

import os
import threading
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import pytest
import rclpy
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState

from idim_iv_interfaces.msg import BagClosed
from idim_iv_interfaces.srv import Identify
from idim_iv_ros import load_configuration
from idim_iv_ros.configuration import Configuration
from idim_iv_ros.errors import UsageError
from idim_iv_ros.nodes.identifier.estimate_history import FolderLock
from idim_iv_ros.nodes.identifier.job_queue import Job, JobListener, JobQueue, confined_bag
from idim_iv_ros.nodes.identifier.node import ACTIVE, Identifier
from idim_iv_ros.nodes.settings import REFUSE, IdentifierSettings
from tests.ros.conftest import ARM2
from tests.ros.processes import HANG, Observer
from tests.ros.told_worker import ToldWorker


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

    def _start(self, request, heard) -> ToldWorker:
        self.workers.append(ToldWorker(request, heard))
        return self.workers[-1]

    @property
    def worker(self) -> ToldWorker:
        """The one that works."""
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


def test_jobs_are_done_in_order_with_a_process_for_each(bench: Bench) -> None:
    bench.submit("a")
    assert bench.poll() == [("a", "waiting", 0.0), ("a", "started")]
    bench.submit("b")
    bench.submit("c")
    assert bench.poll() == [("b", "waiting", 0.0), ("c", "waiting", 0.0)]
    assert bench.queue.waiting == 2
    bench.worker.say(stage="reading", progress=0.25)
    bench.worker.end(message="valid")
    assert bench.poll() == [("a", "reading", 0.25), ("b", "started"), ("a", True, "valid")]
    bench.worker.end(error="no motion")
    assert bench.poll() == [("c", "started"), ("b", False, "no motion")]
    bench.worker.end(message="valid")
    assert bench.poll() == [("c", True, "valid")]
    assert bench.queue.running is None
    bags = [tuple(map(Path, name)) for name in "abc"]
    assert [worker.request["bags"] for worker in bench.workers] == bags
    there = set(Path(bench.settings.output_directory).iterdir())
    assert there == {bench.workers[0].request["out"], bench.workers[2].request["out"]}


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
    assert len(bench.workers) == 1


def test_a_request_is_answered_in_time_whether_it_waits_or_is_worked_on(bench: Bench) -> None:
    bench.submit("a")
    bench.poll()
    bench.submit("b", answer_within=0.3)
    bench.submit("c", answer_within=0.5)
    assert bench.poll(0.29) == [("b", "waiting", 0.0), ("c", "waiting", 0.0)]
    assert bench.queue.waiting == 2
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


def test_the_next_job_has_a_process_after_one_was_killed(bench: Bench) -> None:
    bench.submit("a")
    bench.submit("b")
    bench.poll()
    bench.worker.kill()
    assert bench.poll() == [("b", "started"), ("a", False, "the worker was ended by SIGKILL")]
    bench.workers[0].end(message="late")
    assert bench.poll() == []
    bench.worker.end(message="valid")
    assert bench.poll() == [("b", True, "valid")]


def test_a_full_disk_is_one_line(small_disk: Path, simulated_bags: Path) -> None:
    """With the process itself in the place of a worker that is told."""
    settings = IdentifierSettings(output_directory=str(small_disk / "results"))
    woken, over = threading.Event(), list[Job]()
    queue = JobQueue(lambda: settings, woken.set, over.append)
    (small_disk / "ballast").write_bytes(bytes(os.statvfs(small_disk).f_bavail * 4096 - 8192))
    configuration, bag = load_configuration(ARM2), simulated_bags / "bag-1.mcap"
    listener = JobListener(ended=lambda success, message: None)
    asked = ("identification", (bag,), ("bag-1.mcap",), configuration, HANG, listener)
    queue.submit(Job(*asked, estimator="idim-ls"))
    while not over:
        assert woken.wait(HANG)
        woken.clear()
        queue.poll()
    (failed,) = over
    assert not failed.success
    assert "No space left on device" in failed.message
    assert "\n" not in failed.message
    queue.close()


def test_all_are_answered_when_the_node_ends(bench: Bench) -> None:
    for name in "ab":
        bench.submit(name)
    bench.poll()
    bench.queue.close()
    ended = [item for item in bench.log if len(item) == 3]
    assert sorted(ended) == [(name, False, "the identifier was shut down") for name in "ab"]


def test_names_inside_are_found(bags: Path) -> None:
    bag = bags / "day" / "bag"
    bag.mkdir(parents=True)
    (bag / "one.mcap").write_bytes(bytes(100))
    (bag / "metadata.yaml").write_bytes(bytes(10))
    (bags / "latest").symlink_to("day/bag")
    for name in ("day/bag", str(bag), "latest"):
        assert confined_bag(bags, name) == (bag.resolve(), 110)


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("", "names no file"),
        ("bag\0", "names no file"),
        ("../outside.mcap", "'..' is not allowed"),
        ("day/../../outside.mcap", "'..' is not allowed"),
        ("/etc/passwd", "leads out of"),
        ("link.mcap", "leads out of"),
        ("sibling", "leads out of"),  # a folder whose path begins in the same way
        ("folder", "its file one.mcap leads out of"),
        ("pipes", "is no regular file"),
        ("loop", "no such"),
        ("missing.mcap", "no such bag"),
        ("x" * 5000, "5000 characters is too long"),
    ],
)
def test_names_that_lead_out_are_refused(bags: Path, name: str, words: str) -> None:
    outside, sibling = bags.with_name("outside.mcap"), bags.with_name("bags2")
    outside.write_bytes(bytes(100))
    sibling.mkdir()
    (bags / "sibling").symlink_to(sibling)
    (bags / "day").mkdir()
    (bags / "link.mcap").symlink_to(outside)
    (bags / "folder").mkdir()
    (bags / "folder" / "one.mcap").symlink_to(outside)
    (bags / "pipes").mkdir()
    os.mkfifo(bags / "pipes" / "one.mcap")
    (bags / "loop").symlink_to("loop")
    with pytest.raises(UsageError, match=words):
        confined_bag(bags, name)


def test_announced_bag_is_left_alone_without_auto_and_if_it_is_not_whole() -> None:
    node, asked = SimpleNamespace(_managed=SimpleNamespace(state=ACTIVE)), []
    node._submit = lambda _, request, listener: asked.extend(request.bags)
    node.node = SimpleNamespace(get_logger=lambda: SimpleNamespace(warning=print))
    for auto, complete in ((False, True), (True, False), (True, True)):
        node._settings = IdentifierSettings(auto=auto)
        Identifier._bag_closed(node, BagClosed(bag=f"{auto} {complete}", complete=complete))
    assert asked == ["True True"]


class Managed:
    """An identifier in this process, spun by an observer that calls its services."""

    def __init__(self, workers: list[ToldWorker]) -> None:
        def start_worker(request: dict, heard: Callable) -> ToldWorker:
            workers.append(ToldWorker(request, heard))
            return workers[-1]

        self.identifier, self.observer = Identifier((), start_worker), Observer()
        self.observer.executor.add_node(self.identifier.node)

    def change(self, label: str) -> bool:
        transition = Transition(label=label)
        name = "/identifier/change_state"
        return self.observer.request(ChangeState, name, transition=transition).success

    @property
    def state(self) -> str:
        return self.observer.request(GetState, "/identifier/get_state").current_state.label

    def ask(self) -> rclpy.Future:
        client = self.observer.client(Identify, "/identifier/identify")
        return client.call_async(Identify.Request(bags=["bag.mcap"]))

    def refusal(self) -> str:
        request = {"bags": ["bag.mcap"]}
        return self.observer.request(Identify, "/identifier/identify", **request).message


@pytest.fixture
def arm(robot_file: Callable[[str], Path]) -> Path:
    """A configuration that cannot be read yet."""
    return robot_file("robot:\n  joints: [a]\nnonsense: 1\n")


def test_requests_are_accepted_between_activation_and_deactivation(
    begin_ros, tmp_path: Path, arm: Path, capfd
) -> None:
    (tmp_path / "bag.mcap").write_bytes(bytes(100))
    begin_ros(
        autostart="false",
        configuration=arm,
        bag_directory=tmp_path,
        output_directory=tmp_path / "results",
        status_period=0.2,
    )
    workers: list[ToldWorker] = []
    managed = Managed(workers)

    def log() -> str:
        return capfd.readouterr().err

    assert managed.state == "unconfigured"
    assert managed.refusal() == (
        "the identifier is unconfigured: call ros2 lifecycle set /identifier configure, then "
        "ros2 lifecycle set /identifier activate"
    )
    # A file that cannot be read leaves it unconfigured, with the reason in the log.
    assert not managed.change("configure")
    assert managed.state == "unconfigured"
    reason = f"cannot configure: parameter configuration: {arm}: unknown key nonsense"
    assert reason in log()
    arm.write_text("robot:\n  joints: [a]\nsignals:\n  joint_states: joint states\n")
    assert not managed.change("configure")
    assert f"configuration: {arm}: signals: 'joint states' is no topic of ROS" in log()
    arm.write_text(ARM2.read_text().replace("urdf: ", f"urdf: {ARM2.parent}/"))
    assert managed.change("configure")
    assert managed.state == "inactive"
    assert managed.refusal() == (
        "the identifier is inactive: call ros2 lifecycle set /identifier activate"
    )
    observer, until = managed.observer, managed.observer.until
    until(lambda: observer.diagnosis("identifier", "identification")[1] == "inactive", "a status")
    assert managed.change("activate")
    assert f"ready: {arm}; identifies on request" in log()
    asked = [managed.ask() for _ in range(2)]
    until(lambda: workers and managed.identifier._jobs.waiting, "both jobs")
    assert managed.change("deactivate")
    until(lambda: all(future.done() for future in asked), "both answers")
    assert {future.result().message for future in asked} == {"the identifier was deactivated"}
    # The file is read anew when it is configured again.
    arm.write_text("nonsense: 2\n")
    assert managed.change("activate") and managed.change("deactivate")
    assert managed.change("cleanup")
    assert not managed.change("configure")
    assert managed.state == "unconfigured"
    assert managed.change("shutdown")
    assert managed.refusal() == "the identifier is finalized: start the node again"
    assert "Traceback" not in log()
    managed.identifier.close()
    managed.observer.node.destroy_node()


def test_a_folder_of_results_belongs_to_one_identifier(tmp_path: Path) -> None:
    first, second = FolderLock(tmp_path / "results"), FolderLock(tmp_path / "results")
    first.take()
    first.take()
    with pytest.raises(UsageError, match="output_directory: another"):
        second.take()
    FolderLock(tmp_path / "others").take()
    first.release()
    second.take()
    with pytest.raises(UsageError):
        first.take()
