"""What users of the identifier do: ask, listen, cancel, watch."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from rcl_interfaces.msg import ParameterValue
from rcl_interfaces.srv import GetParameters
from rclpy.action import ActionClient
from rclpy.parameter import parameter_value_to_python
from scipy.stats import binom

from idim_iv_interfaces.action import Identify as IdentifyAction
from idim_iv_interfaces.msg import IdentificationResult, ParameterEstimates
from idim_iv_interfaces.srv import Identify
from tests.ros.processes import Observer, Process

_OUTSIDE = 0.0027  # probability of more than 3 σ
_LEVEL = 1e-3


class IdentifierClient:
    """Asks one identifier; the observer spins."""

    def __init__(self, observer: Observer, process: Process) -> None:
        self.observer, self.process, self.name = observer, process, process.name
        self.node = observer.node
        observer.statuses.pop(self.name, None)
        observer.until(lambda: self.diagnosis("identification")[1], "the identifier")
        self.wait = observer.wait
        self.service = observer.client(Identify, f"/{self.name}/identify")
        self.connect()

    def connect(self) -> None:
        """Make the client of the action."""
        self.action = ActionClient(self.node, IdentifyAction, f"/{self.name}/identify_bags")
        self.observer.until(self.action.server_is_ready, "the action")
        self.observer.be_heard(f"/{self.name}")

    def close(self) -> None:
        self.action.destroy()
        self.observer.forget(self.name)

    def diagnosis(self, what: str) -> tuple[int, str]:
        """Level and sentence of a status."""
        return self.observer.diagnosis(self.name, what)

    def ask(self, *bags: str | Path, **request: object):
        """Call the service and return the future."""
        return self.service.call_async(Identify.Request(bags=[str(bag) for bag in bags], **request))

    def identify(self, *bags: str | Path, **request: object) -> Identify.Response:
        return self.wait(self.ask(*bags, **request))

    def goal(self, *bags: str | Path, feedback: list | None = None, **request: object):
        """Send a goal and return its handle."""
        goal = IdentifyAction.Goal(bags=[str(bag) for bag in bags], **request)
        heard = [] if feedback is None else feedback
        return self.wait(
            self.action.send_goal_async(goal, lambda message: heard.append(message.feedback))
        )

    def latched(self, topic: str = "result", kind: type = IdentificationResult):
        """What a subscriber that starts now is told."""
        return self.observer.latched(kind, f"/{self.name}/{topic}")

    def call(self, name: str, kind: type, **fields: object):
        """Call another of its services."""
        return self.observer.request(kind, f"/{self.name}/{name}", **fields)

    def failure(self) -> str:
        """Wait until the diagnostics tell that the last job failed, and why."""
        self.observer.until(lambda: self.diagnosis("identification")[0] == 2, "a failure")
        return self.diagnosis("identification")[1]

    @contextmanager
    def parameters(self, **values: object) -> Iterator[None]:
        """Set parameters for a while."""
        before = {name: parameter_value_to_python(self.parameter(name)) for name in values}
        assert self.set(**values).successful
        try:
            yield
        finally:
            assert self.set(**before).successful

    @contextmanager
    def closed_gate(self, stage: str = "") -> Iterator[None]:
        """Jobs wait for a while, after a stage or before they begin; then they go on."""
        closed = self.process.errors.parent / "closed"
        closed.with_name("job").unlink(missing_ok=True)
        closed.write_text(stage)
        try:
            yield
        finally:
            closed.unlink()

    def job(self) -> int:
        """Process id of the job that waits at the closed gate."""
        file = self.process.errors.parent / "job"
        self.observer.until(file.exists, "a job")
        number = int(file.read_text())
        file.unlink()
        return number

    @staticmethod
    def process_exists(number: int) -> bool:
        """Whether a process is there and no corpse."""
        status = Path(f"/proc/{number}/status")
        return status.exists() and "State:\tZ" not in status.read_text()

    def parameter(self, name: str) -> ParameterValue:
        """Value of a parameter."""
        (value,) = self.call("get_parameters", GetParameters, names=[name]).values
        return value

    def set(self, **values: object):
        """Set parameters and return the result of the first."""
        return self.observer.set_on(self.name, **values)[0]


def require_truth(estimates: ParameterEstimates, truth: dict[str, float]) -> None:
    """All parameters within 3 σ, but for as many as chance explains at a level of 0.001."""
    off = {p.name: (p.value - truth[p.name]) / p.std for p in estimates.estimates}
    assert set(off) == set(truth)
    outside = {name: deviation for name, deviation in off.items() if abs(deviation) > 3.0}
    assert len(outside) <= binom.isf(_LEVEL, len(truth), _OUTSIDE), outside
