"""The recorder and the identifier, as the collector asks them."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from rclpy.action.client import ActionClient
from rclpy.node import Node
from std_srvs.srv import Trigger

from idim_iv_interfaces.action import Identify
from idim_iv_interfaces.msg import BagClosed
from idim_iv_ros.errors import UsageError

_ANSWER = 15.0  # s; the recorder gives up a disk that hangs after ten

# Returns when the first holds, at the latest after seconds; the last says what is waited for.
Wait = Callable[[Callable[[], bool], float, str], None]


class RecorderNeighbour:
    """Services ``recorder/start`` and ``recorder/stop``."""

    def __init__(self, node: Node) -> None:
        self._start = node.create_client(Trigger, "recorder/start")
        self._stop = node.create_client(Trigger, "recorder/stop")
        self._closed: list[str] = []
        node.create_subscription(BagClosed, "recorder/bag_closed", self._heard, 10)

    def missing(self) -> str:
        """Why it cannot be used now; empty if it can."""
        if self._start.service_is_ready() and self._stop.service_is_ready():
            return ""
        return f"no {self._start.srv_name}: start the recorder"

    def start(self, wait: Wait) -> None:
        """Begin a bag.

        Raises
        ------
        UsageError
            The recorder refuses.
        """
        self._closed.clear()
        self._ask(self._start, wait)

    def stop(self, wait: Wait) -> Path:
        """Close the bag and return its folder.

        Raises
        ------
        UsageError
            The recorder refuses, or does not say which bag it was.
        """
        self._ask(self._stop, wait)
        wait(lambda: bool(self._closed), _ANSWER, "the recorder's word on the bag")
        return Path(self._closed[-1])

    def _heard(self, message: Any) -> None:
        self._closed.append(message.bag)

    def _ask(self, client: Any, wait: Wait) -> None:
        future = client.call_async(Trigger.Request())
        wait(future.done, _ANSWER, f"an answer of {client.srv_name}")
        if not future.result().success:
            raise UsageError(f"{client.srv_name}: {future.result().message}")


class IdentifierNeighbour:
    """Action ``identifier/identify``."""

    def __init__(self, node: Node) -> None:
        self._client = ActionClient(node, Identify, "identifier/identify")
        self._name = "identifier/identify"

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

        goal = Identify.Goal(bags=[str(bag)], estimator=estimator)
        sent = self._client.send_goal_async(goal, heard)
        wait(sent.done, _ANSWER, f"an answer of {self._name}")
        result = sent.result().get_result_async()
        try:
            wait(lambda: result.done() or bool(self.missing()), float("inf"), "an end")
            if not result.done():
                raise UsageError(f"{bag.name} is recorded and usable, but the identifier is gone")
        except Exception:
            sent.result().cancel_goal_async()
            raise
        return result.result().result
