"""The node `identifier`: parameters of a robot from its bags, on request or from every new bag."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.node import Node

from idim_iv_interfaces import action, srv
from idim_iv_interfaces.msg import BagClosed
from idim_iv_ros.configuration import Configuration
from idim_iv_ros.errors import IdimError, UsageError, one_line
from idim_iv_ros.nodes.entry import run_node, steady_timer
from idim_iv_ros.nodes.identifier.estimate_history import FolderLock
from idim_iv_ros.nodes.identifier.job_queue import Job, JobListener, JobQueue, Task, requested_job
from idim_iv_ros.nodes.identifier.publishers import GapPublisher, ResultPublisher
from idim_iv_ros.nodes.identifier.request_server import RequestServer, send_last_answers
from idim_iv_ros.nodes.identifier.worker import StartWorker, Worker, warm
from idim_iv_ros.nodes.messages import Diagnostics, diagnostic_status
from idim_iv_ros.nodes.parameters import NodeProgram, read_configuration, with_topics_of_node
from idim_iv_ros.nodes.settings import IdentifierSettings

UNCONFIGURED, INACTIVE, ACTIVE, FINALIZED = "unconfigured", "inactive", "active", "finalized"
_AFTER = {"configure": INACTIVE, "activate": ACTIVE, "deactivate": INACTIVE,
          "cleanup": UNCONFIGURED, "shutdown": FINALIZED}  # fmt: skip
_LOOK = 0.1  # s between two looks whether a job takes too long

ABOUT = """identifier: identify the dynamic parameters of a robot from its bags.

  ros2 run idim_iv_ros identifier --ros-args -p configuration:=ROBOT.yaml -p bag_directory:=DIR
  ros2 service call /identifier/identify idim_iv_interfaces/srv/Identify "{bags: [BAG]}"
  ros2 action send_goal --feedback /identifier/identify_bags idim_iv_interfaces/action/Identify \\
    "{bags: [BAG]}"

With -p auto:=true every bag that the recorder closes is identified. Topics: ~/estimates,
~/result and ~/gap (latched), /diagnostics. With -p autostart:=false it waits for
`ros2 lifecycle set /identifier configure`, then `activate`. Parameters: ros2 param describe
/identifier NAME."""


class ManagedNode(LifecycleNode):
    """A lifecycle node; `transitions` are functions by the name of the transition.

    One that raises an error is logged and leaves the state as it was.
    """

    def __init__(self, name: str, transitions: Mapping[str, Callable[[], None]]) -> None:
        self.state = UNCONFIGURED
        self._transitions, self._starting = transitions, False
        self._failure: Exception | None = None
        for transition in transitions:
            setattr(self, f"on_{transition}", partial(self._run, transition))
        super().__init__(name)  # type: ignore[no-untyped-call]

    def start(self) -> None:
        """Configure and activate the node; an IdimError says why that is impossible."""
        self._starting = True
        for trigger in (self.trigger_configure, self.trigger_activate):
            if trigger() != TransitionCallbackReturn.SUCCESS:  # type: ignore[no-untyped-call]
                assert self._failure is not None
                raise self._failure
        self._starting = False

    def _run(self, transition: str, _: LifecycleState | None = None) -> TransitionCallbackReturn:
        try:
            self._transitions[transition]()
        except Exception as error:  # rclpy would end the node without a word
            self._failure = error
            if not self._starting:
                text = str(error) if isinstance(error, IdimError) else one_line(error)
                node: Node = self
                node.get_logger().error(f"cannot {transition}: {text}")
            return TransitionCallbackReturn.FAILURE
        self.state = _AFTER[transition]
        return TransitionCallbackReturn.SUCCESS


class Identifier(NodeProgram[IdentifierSettings]):
    """The node `identifier`: services, actions and topics around a `JobQueue`."""

    def __init__(self, arguments: Sequence[str] = (), start_worker: StartWorker = Worker) -> None:
        transitions = {name: getattr(self, f"_{name}") for name in _AFTER}
        self._start_worker = start_worker
        self._managed = ManagedNode("identifier", transitions)
        super().__init__(self._managed, IdentifierSettings, arguments)
        node = self.node
        self._configuration: Configuration | None = None
        self._failure = ""
        folder = Path(self._settings.output_directory)
        self._folder = FolderLock(folder)
        self._publisher = ResultPublisher(node, folder, lambda: self._settings)
        self._gaps = GapPublisher(node, folder)
        self._guard = node.create_guard_condition(lambda: self._jobs.poll())
        self._jobs = JobQueue(
            lambda: self._settings, self._guard.trigger, self._job_ended, start_worker=start_worker
        )
        kinds: tuple[tuple[Task, Any, Any, ResultPublisher | GapPublisher], ...] = (
            ("identification", srv.Identify, action.Identify, self._publisher),
            ("diagnosis", srv.Diagnose, action.Diagnose, self._gaps),
        )
        self._servers = [
            RequestServer(
                node,
                f"~/{service.__name__.lower()}",
                service,
                goals,
                partial(self._submit, task),
                self._jobs.cancel,
                partial(getattr, publisher, "last"),
            )
            for task, service, goals, publisher in kinds
        ]
        self._diagnostics = Diagnostics(node)
        node.create_subscription(BagClosed, "recorder/bag_closed", self._bag_closed, 10)
        steady_timer(node, _LOOK, self._jobs.poll)
        steady_timer(node, self._settings.status_period, self._report)
        self._follow_changes()
        if self._settings.autostart:
            self._managed.start()
        else:
            node.get_logger().info(f"unconfigured: {self._next_step()}")

    def _configure(self) -> None:
        self._configuration = self._read_configuration()
        self._folder.take()
        self._publisher.publish_last()
        self._gaps.publish_last()

    def _activate(self) -> None:
        if self._start_worker is Worker:
            warm()
        robot = self._settings.configuration or "no robot configured"
        what = "every new bag of" if self._settings.auto else "on request, from bags in"
        folder = Path(self._settings.bag_directory).resolve()
        results = Path(self._settings.output_directory).resolve()
        self.node.get_logger().info(
            f"ready: {robot}; identifies {what} {folder}; results go to {results}"
        )

    def _deactivate(self) -> None:
        self._jobs.end_all("the identifier was deactivated")
        self.node.get_logger().info("inactive: requests are refused")

    def _cleanup(self) -> None:
        self._configuration, self._failure = None, ""
        self._publisher.forget()
        self._folder.release()

    def _shutdown(self) -> None:
        self._jobs.end_all("the identifier was shut down")
        self._cleanup()

    def _next_step(self) -> str:
        if self._managed.state == FINALIZED:
            return "start the node again"
        name = self.node.get_fully_qualified_name()
        steps = ["activate"] if self._managed.state == INACTIVE else ["configure", "activate"]
        return "call " + ", then ".join(f"ros2 lifecycle set {name} {step}" for step in steps)

    def close(self) -> None:
        """End the running job, and answer all requests."""
        self._managed.state = FINALIZED  # what comes now is refused
        self._jobs.close()
        send_last_answers(self.node)
        for server in self._servers:
            server.actions.destroy()  # type: ignore[no-untyped-call]
        super().close()

    def _read_configuration(self) -> Configuration | None:
        path = self._settings.configuration
        return read_configuration(self.node, path) if path else None

    def _bag_closed(self, message: BagClosed) -> None:
        if not self._settings.auto or self._managed.state != ACTIVE:
            return
        if not message.complete:
            why = f"{message.bag}: not complete, so not identified; to have it so, ask for it"
            self.node.get_logger().warning(why)
            return

        def ended(success: bool, why: str) -> None:
            if not success:  # nobody asked: the diagnostics are the only answer
                self._failure = f"{message.bag}: {why}"

        self._submit("identification", srv.Identify.Request(bags=[message.bag]), JobListener(ended))

    def _submit(self, task: Task, request: Any, listener: JobListener) -> Job | None:
        """Queue a job and return it; None if it was refused, and the listener has the reason."""
        try:
            if self._managed.state != ACTIVE:
                raise UsageError(f"the identifier is {self._managed.state}: {self._next_step()}")
            job = requested_job(task, request, self._settings, self._configuration, listener)
            job.configuration = with_topics_of_node(self.node, job.configuration)
            self._jobs.submit(job)
            return job
        except IdimError as error:
            self.node.get_logger().warning(f"refused: {error}")
            listener.ended(False, str(error))
            return None

    def _job_ended(self, job: Job) -> None:
        """Publish the result of an ended job, or log why there is none; tell the client."""
        log, names = self.node.get_logger(), ", ".join(job.names)
        if job.success:
            try:
                (self._publisher if job.task == "identification" else self._gaps).add(job)
                self._failure = ""
                log.info(f"{names}: {job.message}")
            except IdimError as error:
                job.success, job.message = False, str(error)
        if job.cancelled and not job.success:
            log.info(f"{names}: cancelled")
        elif not job.success:
            self._failure = f"{names}: {job.message}"
            log.error(self._failure)
        job.listener.ended(job.success, job.message)
        self._report()

    def _report(self) -> None:
        """Publish what runs, or an ERROR with why the last job failed, and the last results."""
        name = self.node.get_fully_qualified_name()
        jobs, state = self._jobs, self._managed.state
        level, sentence = DiagnosticStatus.OK, "idle" if state == ACTIVE else state
        if jobs.running is not None:
            sentence = f"{', '.join(jobs.running.names)}: {jobs.running.stage}"
        elif self._failure:
            level, sentence = DiagnosticStatus.ERROR, self._failure
        values = {"state": state, "waiting": jobs.waiting}
        work = diagnostic_status(level, f"{name}: identification", name, sentence, values)
        self._diagnostics.publish(work, *self._publisher.diagnoses(name))

    def _apply(self, given: set[str]) -> None:
        if "configuration" in given and self._managed.state in (INACTIVE, ACTIVE):
            self._configuration = self._read_configuration()


run = partial(run_node, "identifier", Identifier, ABOUT)
