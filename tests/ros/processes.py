"""Nodes in processes of their own, and a node that watches them."""

import collections
import contextlib
import itertools
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Collection
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rcl_interfaces.srv import GetParameters, SetParameters
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_srvs.srv import Trigger

from idim_iv_interfaces.msg import BagClosed, RecorderStatus
from idim_iv_ros.nodes.settings import (
    CollectorSettings,
    IdentifierSettings,
    PredictorSettings,
    RecorderSettings,
    SimulatorSettings,
)
from idim_iv_ros.recording.bags.folder import Bag
from idim_iv_ros.recording.bags.joint_message_type import JointMessageType

ROOT = Path(__file__).resolve().parents[2]
HANG = 120.0  # s that nothing takes, on however busy a machine
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
SETTINGS = {
    "recorder": RecorderSettings,
    "identifier": IdentifierSettings,
    "collector": CollectorSettings,
    "predictor": PredictorSettings,
    "robot_simulator": SimulatorSettings,
}
_numbers = itertools.count()


class Process:
    """A child process whose output is kept in files."""

    def __init__(self, arguments: list[str], folder: Path, name: str) -> None:
        self.name = name
        self.errors = folder / f"{name}.err"
        with self.errors.open("w") as errors:
            self.process = subprocess.Popen(
                arguments,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=errors,
                text=True,
                cwd=folder,
            )

    def say(self, line: str) -> None:
        self.process.stdin.write(line + "\n")
        self.process.stdin.flush()

    def hear(self) -> str:
        line = self.process.stdout.readline()
        assert line, f"ended: {self.errors.read_text()}"
        return line.strip()

    def cpu(self) -> float:
        """Seconds of processor time so far."""
        fields = Path(f"/proc/{self.process.pid}/stat").read_text().rpartition(")")[2].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

    def kill(self) -> None:
        self.process.kill()
        self.process.wait()
        for pipe in (self.process.stdin, self.process.stdout):
            with contextlib.suppress(OSError):
                pipe.close()

    def end(self) -> None:
        """Interrupt, and kill what does not end."""
        with contextlib.suppress(subprocess.TimeoutExpired):
            self.finish()
        self.kill()

    def finish(self) -> int:
        """Interrupt as Ctrl-C does, and return the exit status."""
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGINT)
        return self.process.wait(HANG)


def end_all(processes: Collection[Process]) -> None:
    """Interrupt all, then wait for each."""
    for process in processes:
        if process.process.poll() is None:
            process.process.send_signal(signal.SIGINT)
    for process in processes:
        process.end()


class Robot(Process):
    """joint_publisher.py: one node after the other."""

    def __init__(self, folder: Path, name: str) -> None:
        script = str(ROOT / "tests" / "ros" / "joint_publisher.py")
        super().__init__([sys.executable, script], folder, name)
        self.busy = False
        self.seconds = 0.0

    def begin(self, **settings: object) -> "Robot":
        """Make a node; its topics have subscribers on return."""
        if self.busy:
            self.end()
        defaults = {
            "node": "robot",
            "count": 100,
            "rate": 500.0,
            "pace": False,
            "topics": [{"name": "/joint_states"}],
        }
        self.say(json.dumps({**defaults, **settings}))
        self.busy = True
        assert self.hear() == "ready"
        return self

    def run(self) -> int:
        """Publish all and return how many."""
        self.say("go")
        return self.sent()

    def sent(self) -> int:
        answer = json.loads(self.hear())
        self.seconds = answer["seconds"]
        return answer["sent"]

    def end(self) -> None:
        """End the node."""
        self.say("end")
        assert self.hear() == "ended"
        self.busy = False


def start_node(
    executable: str,
    folder: Path,
    *remappings: str,
    script: Path | None = None,
    **parameters: object,
) -> Process:
    """Start a node with parameters, under a name that none had before.

    One that is killed is still known to the others for a while, and its services seem to be there.
    """
    name = f"{executable}_{next(_numbers)}"
    arguments = [sys.executable, str(script or ROOT / "scripts" / executable), "--ros-args"]
    for remapping in (f"__node:={name}", *remappings):
        arguments += ["-r", remapping]
    for parameter, value in parameters.items():
        text = str(value).lower() if isinstance(value, bool) else str(value)
        arguments += ["-p", f"{parameter}:={text}"]
    return Process(arguments, folder, name)


def start_launched(executable: str, folder: Path, parameters: dict[str, object]) -> Process:
    """Start a node as launch_ros does: under its own name, with parameters in a file."""
    file = folder / f"{executable}.parameters.yaml"
    file.write_text(json.dumps({"/**": {"ros__parameters": parameters}}))
    script = str(ROOT / "scripts" / executable)
    arguments = [sys.executable, script, "--ros-args", "--params-file", str(file)]
    return Process(arguments, folder, executable)


def start_recorder(folder: Path, **parameters: object) -> Process:
    """Start a recorder with parameters that suit tests."""
    defaults = {"minimum_free_disk": 0, "status_period": 0.2}
    return start_node("recorder", folder, **{**defaults, **parameters})


class Observer:
    """A node that hears what the recorder says and calls its services.

    `statuses` holds the diagnostics that every node published last: by node, then by status.
    """

    def __init__(self) -> None:
        self.node = rclpy.create_node("observer")
        self.executor = SingleThreadedExecutor()
        self.executor.add_node(self.node)
        self.status: RecorderStatus | None = None
        self.closed: list[BagClosed] = []
        self.statuses: dict[str, dict[str, DiagnosticStatus]] = collections.defaultdict(dict)
        self.node.create_subscription(DiagnosticArray, "/diagnostics", self._diagnosis, 10)
        self.name = ""
        self.subscriptions: list = []
        self._clients: dict[tuple[type, str], Any] = {}

    def _status(self, message: RecorderStatus) -> None:
        self.status = message

    def _diagnosis(self, message: DiagnosticArray) -> None:
        for status in message.status:
            node, _, what = status.name.partition(": ")
            self.statuses[node.lstrip("/")][what] = status

    def follow(self, recorder: Process) -> None:
        """Hear this recorder and no other."""
        self.closed.clear()
        self.statuses.pop(recorder.name, None)
        if self.name == recorder.name:
            self.next_status()
            return
        for subscription in self.subscriptions:
            self.node.destroy_subscription(subscription)
        self.name, self.status = recorder.name, None
        subscribe = self.node.create_subscription
        self.subscriptions = [
            subscribe(RecorderStatus, f"/{self.name}/status", self._status, 10),
            subscribe(BagClosed, f"/{self.name}/bag_closed", self.closed.append, 10),
        ]
        self.next_status()

    def until(self, condition: Callable[[], object], what: str) -> None:
        """Spin until a condition is true."""
        deadline = time.monotonic() + HANG
        while not condition():
            assert time.monotonic() < deadline, (
                f"not within {HANG} s: {what}\n{self.status}\n{self.statuses}"
            )
            self.executor.spin_once(timeout_sec=0.05)

    def latched(self, kind: type, topic: str) -> Any:
        """Wait for the message of a topic that keeps its last one for those who come later."""
        heard: list = []
        subscription = self.node.create_subscription(kind, topic, heard.append, LATCHED)
        self.until(lambda: heard, topic)
        self.node.destroy_subscription(subscription)
        return heard[0]

    def next_status(self) -> RecorderStatus:
        self.status = None
        self.until(lambda: self.status is not None, "a status")
        return self.status

    def up_to_date(self) -> None:
        """Wait for a status from now on."""
        now = self.node.get_clock().now().nanoseconds

        def newer() -> bool:
            stamp = self.next_status().header.stamp
            return stamp.sec * 10**9 + stamp.nanosec >= now

        self.until(newer, "a newer status")

    def received(self, count: int, topic: str = "/joint_states") -> None:
        """Wait until the recorder has so many messages."""
        self.until(lambda: self.topic(topic).received == count, f"{count} messages on {topic}")

    def topic(self, name: str):
        return next((topic for topic in self.status.topics if topic.name == name), None)

    def diagnosed(self, topic: str, words: str, level: int) -> None:
        """Wait for a diagnosis with these words, at this level.

        Or at a higher one: on a busy machine the topic may be silent by then.
        """

        def said() -> bool:
            last_level, sentence = self.diagnosis(self.name, topic)
            return words in sentence and last_level >= level

        self.until(said, f"{topic}: {words} at level {level}")

    def diagnosis(self, node: str, what: str) -> tuple[int, str]:
        """Level and sentence of a status; level 0 and nothing before it was heard."""
        status = self.statuses[node].get(what, DiagnosticStatus())
        return status.level[0], status.message

    def call(self, name: str, node: str = "") -> str:
        """Have a service of the node do its work; return what it says."""
        answer = self.request(Trigger, f"/{node or self.name}/{name}")
        assert answer.success, answer.message
        return answer.message

    def refused(self, name: str, words: str) -> None:
        """Call a service that must refuse with these words."""
        answer = self.request(Trigger, f"/{self.name}/{name}")
        assert not answer.success
        assert words in answer.message

    def set(self, **values: object):
        """Set parameters of the recorder."""
        return self.set_on(self.name, **values)

    def set_on(self, node: str, **values: object):
        parameters = [
            Parameter(name, value=value).to_parameter_msg() for name, value in values.items()
        ]
        name = f"/{node}/set_parameters"
        return self.request(SetParameters, name, parameters=parameters).results

    def be_heard(self, node: str) -> None:
        """Wait until a node knows of all clients there are.

        It gives up an answer to one that it has not heard of yet. They become known in the order
        in which they were made: when it answers the youngest, it knows of the others too.
        """
        client = self.node.create_client(GetParameters, f"{node}/get_parameters")
        self.until(client.service_is_ready, f"parameters of {node}")
        asked: list = []
        again = 0.0

        def answered() -> bool:
            nonlocal again
            if time.monotonic() > again:
                again = time.monotonic() + 1.0
                asked.append(client.call_async(GetParameters.Request()))
            return any(future.done() for future in asked)

        self.until(answered, f"an answer of {node}")
        self.node.destroy_client(client)

    def client(self, kind: type, name: str) -> Any:
        """Client of a service that the node behind it knows of; made once."""
        if (kind, name) not in self._clients:
            client = self._clients[kind, name] = self.node.create_client(kind, name)
            self.until(client.service_is_ready, f"service {name}")
            self.be_heard(name.rpartition("/")[0])
        return self._clients[kind, name]

    def forget(self, node: str) -> None:
        """Have no more clients of a node that has ended."""
        for kind, name in list(self._clients):
            if name.startswith(f"/{node}/"):
                self.node.destroy_client(self._clients.pop((kind, name)))

    def request(self, kind: type, name: str, **fields: object) -> Any:
        """Call a service and return its answer."""
        return self.wait(self.client(kind, name).call_async(kind.Request(**fields)))

    def wait(self, future: rclpy.Future) -> Any:
        """Spin until there is an answer and return it."""
        self.until(future.done, "an answer")
        return future.result()


def numbers(bag: Path, topic: str = "/joint_states") -> np.ndarray:
    """First position of every message of a topic, in the order of the file, with our reader."""
    positions = []
    for _, batch in Bag(bag).batches({topic}):
        for k in range(len(batch)):
            raw = batch.message(k)
            message = JointMessageType("sensor_msgs/msg/JointState").read(raw, ["position"])
            positions.append(message.numbers["position"][0])
    return np.array(positions)


def only_bag(folder: Path) -> Path:
    (bag,) = [path for path in folder.iterdir() if path.is_dir()]
    return bag
