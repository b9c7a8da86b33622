"""A service and an action of the same name that ask for the same jobs."""

from collections.abc import Callable
from typing import Any

from rclpy.action.server import ServerGoalHandle
from rclpy.node import Node

from idim_iv_ros.nodes.deferred import DeferredActionServer, Later, create_deferred_service
from idim_iv_ros.nodes.identifier.job import Job, JobListener


class RequestServer:
    """Takes requests and goals, and answers each when its job has ended.

    Parameters
    ----------
    node
    name
        Of the service and of the action.
    service, action
        Their types: requests and goals have the same fields, answers `success`, `message` and
        `result`, feedback `stage` and `progress`.
    submit
        Takes a request and who asks; returns its job, or None if it was refused and who asks was
        told why.
    cancel
        Takes a job that is to be cancelled.
    result
        Returns what is published of the job that has ended last.
    """

    def __init__(
        self,
        node: Node,
        name: str,
        service: Any,
        action: Any,
        submit: Callable[[Any, JobListener], Job | None],
        cancel: Callable[[Job], None],
        result: Callable[[], Any],
    ) -> None:
        self._service, self._action = service, action
        self._submit, self._cancel_job, self._result = submit, cancel, result
        self._goals: dict[bytes, Job] = {}
        create_deferred_service(node, service, name, self._asked)
        self._actions = DeferredActionServer(node, action, name, self._accepted, self._cancel)

    def destroy(self) -> None:
        """Take the action away; its goals are lost."""
        self._actions.destroy()

    def _asked(self, request: Any, later: Later) -> None:
        def ended(success: bool, message: str) -> None:
            later.send(self._answer(self._service.Response(), success, message))

        self._submit(request, JobListener(lambda: None, lambda stage, share: None, ended))

    def _accepted(self, goal: ServerGoalHandle) -> None:
        key = bytes(goal.goal_id.uuid)

        def progress(stage: str, share: float) -> None:
            goal.publish_feedback(self._action.Feedback(stage=stage, progress=share))

        def ended(success: bool, message: str) -> None:
            self._goals.pop(key, None)
            result = self._answer(self._action.Result(), success, message)
            self._actions.finish(goal, result)

        job = self._submit(goal.request, JobListener(goal.execute, progress, ended))
        if job is not None:
            self._goals[key] = job

    def _cancel(self, goal: ServerGoalHandle) -> None:
        job = self._goals.get(bytes(goal.goal_id.uuid))
        if job is not None:
            self._cancel_job(job)

    def _answer(self, response: Any, success: bool, message: str) -> Any:
        response.success, response.message = success, message
        if success:
            response.result = self._result()
        return response
