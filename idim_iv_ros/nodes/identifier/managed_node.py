"""A node with the standard lifecycle, whose transitions are plain functions."""

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.node import Node

from idim_iv_ros.errors import IdimError, one_line

UNCONFIGURED, INACTIVE, ACTIVE, FINALIZED = "unconfigured", "inactive", "active", "finalized"
_AFTER = {
    "configure": INACTIVE,
    "activate": ACTIVE,
    "deactivate": INACTIVE,
    "cleanup": UNCONFIGURED,
    "shutdown": FINALIZED,
}


class ManagedNode(LifecycleNode):
    """A node in one of the states unconfigured, inactive, active and finalized.

    A transition that fails leaves the state as it was, with the reason in the log; so does one that
    is not possible in the present state, whose request rclpy would never answer.

    Parameters
    ----------
    name : str
    transitions : mapping
        What is done in ``configure``, ``activate``, ``deactivate``, ``cleanup`` and ``shutdown``;
        an IdimError is why it cannot be done.

    Attributes
    ----------
    state : str
        The present one.
    """

    def __init__(self, name: str, transitions: Mapping[str, Callable[[], None]]) -> None:
        self.state = UNCONFIGURED
        self._transitions, self._starting = transitions, False
        self._failure: Exception | None = None
        for transition in transitions:
            setattr(self, f"on_{transition}", partial(self._do, transition))
        super().__init__(name)  # type: ignore[no-untyped-call]
        change = self._service_change_state
        asked = change.callback

        def answer(request: Any, response: Any) -> Any:
            try:
                return asked(request, response)
            except Exception:  # what `_do` does not catch: this state has no such transition
                what = request.transition.label or request.transition.id
                self._complain(f"transition {what} is not possible: the node is {self.state}")
                response.success = False
                return response

        change.callback = answer

    def start(self) -> None:
        """Configure and activate.

        Raises
        ------
        IdimError
            Why that is not possible; the node is unconfigured.
        """
        self._starting = True
        try:
            for trigger in (self.trigger_configure, self.trigger_activate):
                if trigger() != TransitionCallbackReturn.SUCCESS:  # type: ignore[no-untyped-call]
                    assert self._failure is not None
                    raise self._failure
        finally:
            self._starting = False

    def _do(self, transition: str, _: LifecycleState | None = None) -> TransitionCallbackReturn:
        try:
            self._transitions[transition]()
        except Exception as error:  # rclpy would end the node without a word
            self._failure = error
            if not self._starting:
                text = str(error) if isinstance(error, IdimError) else one_line(error)
                self._complain(f"cannot {transition}: {text}")
            return TransitionCallbackReturn.FAILURE
        self.state = _AFTER[transition]
        return TransitionCallbackReturn.SUCCESS

    def _complain(self, text: str) -> None:
        node: Node = self
        node.get_logger().error(text)
