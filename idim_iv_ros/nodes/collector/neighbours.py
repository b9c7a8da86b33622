"""The recorder and the identifier, as the collector asks them."""

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from rclpy.action.client import ActionClient
from rclpy.node import Node
from std_srvs.srv import Trigger

from idim_iv_interfaces.action import Identify
from idim_iv_interfaces.msg import BagClosed, RecorderStatus
from idim_iv_ros.errors import UsageError

_ANSWER = 15.0  # s; the recorder gives up a disk that hangs after ten
_SILENT = 5.0  # s, or three periods of its status, after which the recorder is gone
_PERIODS = 3
_WRITING = {RecorderStatus.RECORDING, RecorderStatus.PAUSED, RecorderStatus.WAITING_FOR_CLOCK}

# Returns when the first holds, at the latest after seconds; the last says what is waited for.
Wait = Callable[[Callable[[], bool], float, str], None]


class RecorderNeighbour:
    """Services ``start``, ``stop`` and ``abort`` of ``recorder``, and what it says meanwhile.

    A recorder that was killed is on the list of services for another 20 s: its silence is noticed
    before.

    Parameters
    ----------
    node : Node
    clock : callable
        Monotonic time, s, in which silence is measured.
    """

    def __init__(self, node: Node, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._start = node.create_client(Trigger, "recorder/start")
        self._stop = node.create_client(Trigger, "recorder/stop")
        self._abort = node.create_client(Trigger, "recorder/abort")
        self._names = {
            client: node.resolve_service_name(client.srv_name)
            for client in (self._start, self._stop, self._abort)
        }
        self._closed: list[str] = []
        self._status: RecorderStatus | None = None
        self._heard_at, self._period = 0.0, 0.0
        self._records = False
        node.create_subscription(BagClosed, "recorder/bag_closed", self._heard, 10)
        node.create_subscription(RecorderStatus, "recorder/status", self._reported, 10)

    def missing(self) -> str:
        """Why it cannot be used now; empty if it can."""
        for client, name in self._names.items():
            if not client.service_is_ready():
                return f"no {name}: start the recorder"
        status = self._status
        if status is None:
            return ""
        if silent := self._silence():
            return silent
        if status.state in _WRITING:
            bag = Path(status.bag).name
            return f"the recorder writes {bag} already: call {self._names[self._stop]}"
        return ""

    def trouble(self) -> str:
        """Why a bag that was begun is not complete; empty if nothing is known of it."""
        status = self._status
        if status is None:
            return ""
        if silent := self._silence():
            return f"{silent}; {Path(status.bag).name or 'the bag'} holds what was written before"
        if status.state == RecorderStatus.WAITING_FOR_CLOCK:
            return f"the recorder does not record yet: {status.fault}"
        if self._records and status.state != RecorderStatus.RECORDING:
            return f"the recorder does not record any more: {status.fault or 'somebody stopped it'}"
        return ""

    def _silence(self) -> str:
        silent = self._clock() - self._heard_at
        if silent > max(_SILENT, _PERIODS * self._period):
            return f"the recorder has been silent for {silent:.0f} s: is it running?"
        return ""

    def _reported(self, message: RecorderStatus) -> None:
        now = self._clock()
        if self._status is not None:
            self._period = now - self._heard_at
        self._status, self._heard_at = message, now
        # What it said before it began may come later.
        self._records = self._records or message.state == RecorderStatus.RECORDING

    def start(self, wait: Wait) -> None:
        """Begin a bag.

        Raises
        ------
        UsageError
            The recorder refuses.
        """
        self._closed.clear()
        self._records = False
        self._ask(self._start, wait)

    def stop(self, wait: Wait, *, aborted: bool = False) -> Path:
        """Close the bag, or give it up, and return its folder.

        Raises
        ------
        UsageError
            The recorder refuses, or does not say which bag it was.
        """
        self._ask(self._abort if aborted else self._stop, wait)
        self._status = None  # that it records is no longer true
        wait(lambda: bool(self._closed), _ANSWER, "the recorder's word on the bag")
        return Path(self._closed[-1])

    def _heard(self, message: Any) -> None:
        self._closed.append(message.bag)

    def _ask(self, client: Any, wait: Wait) -> None:
        future = client.call_async(Trigger.Request())
        wait(future.done, _ANSWER, f"an answer of {self._names[client]}")
        if not future.result().success:
            raise UsageError(f"{self._names[client]}: {future.result().message}")


class IdentifierNeighbour:
    """Action ``identifier/identify_bags``."""

    def __init__(self, node: Node) -> None:
        self._client = ActionClient(node, Identify, "identifier/identify_bags")
        self._name = node.resolve_service_name("identifier/identify_bags")

    def missing(self) -> str:
        """Why it cannot be used now; empty if it can."""
        if self._client.server_is_ready():
            return ""
        return f"no {self._name}: start the identifier, or leave identify out"

    def identify(
        self, bag: Path, estimator: str, say: Callable[[str, float], None], wait: Wait
    ) -> Any:
        """Have a bag identified and return the result message.

        Parameters
        ----------
        bag
            Folder; the identifier's bag directory holds it.
        estimator
        say
            Takes the stage and the share done.
        wait
            May raise: the goal is cancelled then.

        Raises
        ------
        UsageError
            The identifier refuses.
        """

        def heard(message: Any) -> None:
            say(message.feedback.stage, message.feedback.progress)

        if missing := self.missing():
            raise UsageError(missing)
        goal = Identify.Goal(bags=[str(bag)], estimator=estimator)
        sent = self._client.send_goal_async(goal, heard)
        wait(sent.done, _ANSWER, f"an answer of {self._name}")
        result = sent.result().get_result_async()
        try:
            wait(lambda: result.done() or bool(self.missing()), float("inf"), "an end")
            if not result.done():
                raise UsageError("the identifier is gone")
        except Exception:
            sent.result().cancel_goal_async()
            raise
        return result.result().result
