"""A service and an action of the same name that queue the same jobs and answer later.

An awaiting callback keeps rclpy's executor busy (it resumes every waiting coroutine in each turn,
100 % of a core), and a blocking one needs a thread for each request. Here the request and its
answer are two callbacks.
"""

import time
from collections.abc import Callable
from typing import Any

from action_msgs.msg import GoalStatus
from rclpy.action.server import ActionServer, CancelResponse, ServerGoalHandle
from rclpy.node import Node
from rclpy.qos import QoSProfile

from idim_iv_ros.nodes.identifier.job_queue import Job, JobListener

# Requests that may wait for the executor: the default of services, ten, drops the rest of a burst
# without an answer.
BURST = QoSProfile(depth=1000)
_LAST_ANSWERS = 0.5  # s


class DeferredActionServer(ActionServer):
    """An action server whose goals are executed outside of it.

    `accepted` takes every accepted goal, and calls its `execute` when the work begins; `cancel`
    takes a goal whose work shall end early, by `finish`.
    """

    def __init__(
        self,
        node: Node,
        kind: Any,
        name: str,
        accepted: Callable[[ServerGoalHandle], None],
        cancel: Callable[[ServerGoalHandle], None],
    ) -> None:
        def accept_cancel(goal: ServerGoalHandle) -> CancelResponse:
            cancel(goal)
            return CancelResponse.ACCEPT

        callbacks = {
            "execute_callback": lambda goal: None,
            "handle_accepted_callback": accepted,
            "cancel_callback": accept_cancel,
        }
        qos = {f"{what}_service_qos_profile": BURST for what in ("goal", "result", "cancel")}
        super().__init__(node, kind, name, **callbacks, **qos)  # type: ignore[no-untyped-call]

    def notify_execute(self, *_: Any) -> None:
        """Do nothing: the caller of `execute` does the work."""

    def finish(self, goal: ServerGoalHandle, result: Any) -> None:
        """End a goal with a result: succeeded, or without `success` cancelled or aborted."""
        if goal.status == GoalStatus.STATUS_ACCEPTED:
            goal.execute()  # only then may it be aborted

        def end(handle: ServerGoalHandle) -> Any:
            if result.success:
                handle.succeed()
            elif handle.is_cancel_requested:
                handle.canceled()
            else:
                handle.abort()
            return result

        super().notify_execute(goal, end)  # type: ignore[no-untyped-call]


class RequestServer:
    """Queues a job for every service request and every goal, and answers when the job has ended.

    The action has the `name` of the service and ``_bags``, since equal names look the same in lists
    and policies. Both types have the same request fields, answers `success`, `message`, `result`,
    feedback `stage`, `progress`. `submit` returns the job, or None if it was refused and the
    listener has the reason. `cancel` takes a job; `result` returns the last message.
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
        self._action, self._submit, self._result = action, submit, result
        self._cancel_job = cancel
        goals = node.resolve_service_name(f"{name}_bags")
        self._goals: dict[bytes, Job] = {}
        # The callback returns the request itself, which arrives where else the answer is sent.
        requests = node.create_service(service, name, lambda request, _: request, qos_profile=BURST)
        send = requests.send_response

        def asked(request: Any, header: Any) -> None:
            self._submit_for(request, service.Response(), lambda answer: send(answer, header))

        requests.send_response = asked  # type: ignore[assignment]
        self.actions = DeferredActionServer(node, action, goals, self._start_goal, self._cancel)

    def _start_goal(self, goal: ServerGoalHandle) -> None:
        number = bytes(goal.goal_id.uuid)

        def progress(stage: str, share: float) -> None:
            goal.publish_feedback(self._action.Feedback(stage=stage, progress=share))

        def ended(result: Any) -> None:
            self._goals.pop(number, None)
            self.actions.finish(goal, result)

        callbacks = {"started": goal.execute, "progress": progress}
        job = self._submit_for(goal.request, self._action.Result(), ended, **callbacks)
        if job is not None:
            self._goals[number] = job

    def _submit_for(
        self, request: Any, response: Any, answer: Callable[[Any], None], **callbacks: Any
    ) -> Job | None:
        """Submit a job; `answer` takes the filled-in response when the job has ended."""

        def ended(success: bool, message: str) -> None:
            response.success, response.message = success, message
            if success:
                response.result = self._result()
            answer(response)

        return self._submit(request, JobListener(ended, **callbacks))

    def _cancel(self, goal: ServerGoalHandle) -> None:
        job = self._goals.get(bytes(goal.goal_id.uuid))
        if job is not None:
            self._cancel_job(job)


def send_last_answers(node: Node) -> None:
    """Spin the executor for 0.5 s, so that answers of ended jobs are sent."""
    executor, until = node.executor, time.monotonic() + _LAST_ANSWERS
    while executor is not None and time.monotonic() < until:
        executor.spin_once(timeout_sec=0.1)
