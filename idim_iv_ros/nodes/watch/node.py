"""`idim-iv watch`: the state of predictor, recorder and identifier, until Ctrl-C."""

import math
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib import resources
from urllib.parse import parse_qs, urlsplit

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from pydantic import TypeAdapter
from rclpy.node import Node
from rich import box
from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.table import Table
from rich.text import Text

from idim_iv_interfaces.msg import DriftReport, Prediction, RecorderStatus
from idim_iv_ros.errors import UsageError
from idim_iv_ros.nodes.entry import LATCHED, Closable, run_node, steady_timer
from idim_iv_ros.nodes.parameters import refuse_unknown_parameters
from idim_iv_ros.prediction.identified_model import LIMIT, SHARE

ADDRESS = "127.0.0.1"
_HISTORY = 600  # states that a page gets when it is opened
_FILES = {
    "/": ("live.html", "text/html"),
    "/live.css": ("live.css", "text/css"),
    "/live.js": ("live.js", "text/javascript"),
}
_POLICY = "default-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:"
GOOD, BEYOND, UNKNOWN = "good", "beyond", "unknown"
_STYLES = {GOOD: "green", BEYOND: "bold red"}
_TOPIC = "predictor/prediction"
_DRAWN = 0.25  # s between two tables on a terminal
_PRINTED = 5.0  # s between two tables elsewhere
_SILENT = 2.0  # s without a prediction
_STATES = ("idle", "recording", "paused", "stopped by a fault", "waiting for /clock")

ABOUT = """watch: measured and predicted efforts of a running robot, with what the nodes do."""


class LivePage(ThreadingHTTPServer):
    """Server of the live page on the loopback; a UsageError where the port (0: any) is taken."""

    daemon_threads = True

    def __init__(self, port: int) -> None:
        try:
            super().__init__((ADDRESS, port), _Handler)
        except (OSError, OverflowError) as error:
            reason = getattr(error, "strerror", None) or "no such port"
            raise UsageError(f"--web {port}: {reason}; name another port") from error
        self.url = f"http://{ADDRESS}:{self.server_port}/"
        self._lock = threading.Lock()
        self._count = 0
        self._states: deque[bytes] = deque(maxlen=_HISTORY)
        threading.Thread(target=self.serve_forever, name="page", daemon=True).start()

    def publish(self, state: bytes) -> None:
        """Send a state, JSON, to all open pages."""
        with self._lock:
            self._count += 1
            self._states.append(state)

    def later(self, number: int) -> bytes:
        """Return the states after `number`, from 1, as JSON; all if it is of an earlier server."""
        with self._lock:
            new = self._count - number if number <= self._count else _HISTORY
            later = list(self._states)[max(len(self._states) - new, 0) :]
            return b'{"newest": %d, "states": [%s]}' % (self._count, b",".join(later))

    def handle_error(self, request: object, client_address: object) -> None:
        """Do nothing: a page that is closed while it loads is no error."""

    def close(self) -> None:
        """End the server."""
        self.shutdown()
        self.server_close()


class _Handler(BaseHTTPRequestHandler):
    server: LivePage
    server_version, sys_version = "idim-iv", ""

    def do_GET(self) -> None:
        """Answer with a file, or with the states after the number in the query."""
        port = self.server.server_port
        # Another name that leads here is a page of somebody else that reads this one.
        if self.headers.get("Host") not in (f"{ADDRESS}:{port}", f"localhost:{port}"):
            self.send_error(HTTPStatus.FORBIDDEN)
            return
        address = urlsplit(self.path)
        after = parse_qs(address.query).get("after", ["0"])[0]
        if address.path == "/states" and after.isdecimal():
            content, kind = self.server.later(int(after)), "application/json"
        elif address.path == "/plotly.js":
            from plotly.offline import get_plotlyjs

            content, kind = get_plotlyjs().encode(), "text/javascript"
        elif address.path in _FILES:
            name, kind = _FILES[address.path]
            content = (resources.files("idim_iv_ros.nodes.watch") / "assets" / name).read_bytes()
        else:
            self.send_error(HTTPStatus.NOT_FOUND)
            return
        self.send_response(HTTPStatus.OK)
        self.send_header("Content-Type", f"{kind}; charset=utf-8")
        self.send_header("Content-Length", str(len(content)))
        self.send_header("Content-Security-Policy", _POLICY)
        self.send_header("Cache-Control", "no-store")
        self.end_headers()
        self.wfile.write(content)

    def log_message(self, format: str, *args: object) -> None:
        """Log nothing: the terminal shows the table."""


@dataclass(frozen=True)
class JointView:
    """State of one joint: its diagnostics, and its newest prediction; unknown numbers are NaN."""

    name: str
    unit: str = ""  # of the efforts
    measured: float = math.nan
    predicted: float = math.nan
    residual: float = math.nan
    share: float = math.nan  # RMS of the residual over noise floor, last second of motion
    level_share: float = math.nan  # over ten seconds
    limit: float = math.nan  # of that, by scatter and parameter uncertainty
    level: str = UNKNOWN
    sentence: str = ""

    @classmethod
    def diagnosed(
        cls, name: str, values: Mapping[str, str], warns: bool, sentence: str
    ) -> "JointView":
        """Return the state of a joint from its diagnostics, without a prediction."""
        share, limit = (_parsed(values.get(key, "")) for key in (SHARE, LIMIT))
        level = BEYOND if warns else GOOD if math.isfinite(limit) else UNKNOWN
        unit = values.get("unit", "")
        return cls(name, unit, level_share=share, limit=limit, level=level, sentence=sentence)


def _parsed(text: str) -> float:
    try:
        return float(text)
    except ValueError:  # "unknown", or nothing
        return math.nan


@dataclass(frozen=True)
class LiveView:
    """State of all joints, and of the nodes in words."""

    robot: str
    stamp: float  # of the sample, s
    delay: float  # until its prediction, s
    reason: str  # why nothing is predicted
    joints: tuple[JointView, ...]
    nodes: dict[str, str] = field(default_factory=dict)

    def to_json(self) -> bytes:
        """Return the state as JSON; NaN is null."""
        return TypeAdapter(LiveView).dump_json(self)


def live_table(view: LiveView) -> RenderableType:
    """Return a table of all joints, a line for each joint beyond its limit, and for each node.

    Columns: efforts; RMS of the residual over noise floor during ten seconds of motion, its limit,
    and during one second. It fits a terminal of 80 columns.
    """
    lines: list[RenderableType] = [Text(f"{view.robot or 'robot'}: efforts", style="bold")]
    if view.joints:
        table = Table(box=box.SIMPLE_HEAD, pad_edge=False, expand=False)
        table.add_column("joint")
        for heading in ("measured", "predicted", "residual", "÷ floor, 10 s", "limit", "1 s"):
            table.add_column(heading, justify="right", no_wrap=True)
        for joint in view.joints:
            table.add_row(
                f"{joint.name} ({joint.unit})" if joint.unit else joint.name,
                *(_text(n, "+.3f") for n in (joint.measured, joint.predicted, joint.residual)),
                Text(_text(joint.level_share), style=_STYLES.get(joint.level, "cyan")),
                _text(joint.limit),
                _text(joint.share),
            )
        lines.append(table)
    if view.reason:
        lines.append(Text(f"nothing is predicted: {view.reason}", style="yellow"))
    elif math.isfinite(view.delay):
        lines.append(Text(f"{view.delay:.2f} s behind the robot", style="dim"))
    for joint in view.joints:
        if joint.level == BEYOND:
            lines.append(Text(f"{joint.name}: {joint.sentence}", style="red"))
    lines += [Text(f"{node}: {what}", style="dim") for node, what in view.nodes.items()]
    return Group(*lines)


def _text(number: float, form: str = ".2f") -> str:
    return f"{number:{form}}" if math.isfinite(number) else "–"


class Watcher:
    """Node that shows the state of the robot's other nodes, in its namespace.

    `web` is the port of a page (None: a table); `predictor` makes one to run in this process.
    """

    def __init__(
        self,
        arguments: Sequence[str],
        web: int | None = None,
        predictor: Callable[[Sequence[str]], Closable] | None = None,
    ) -> None:
        self._page = None if web is None else LivePage(web)
        self._predictor = None if predictor is None else predictor(arguments)
        self.node = node = Node("watch")
        if self._predictor is None:  # what is given is else the predictor's
            refuse_unknown_parameters(node, (), arguments)
        self._prediction: Prediction | None = None
        self._heard_at = self._shown_at = time.monotonic()
        self._joints: dict[str, JointView] = {}
        self._nodes: dict[str, str] = {}
        self._topic = node.resolve_topic_name(_TOPIC)
        node.create_subscription(Prediction, _TOPIC, self._take_prediction, 50)
        node.create_subscription(DiagnosticArray, "/diagnostics", self._take_diagnostics, 50)
        node.create_subscription(RecorderStatus, "recorder/status", self._take_status, 10)
        node.create_subscription(DriftReport, "identifier/drift", self._take_drift, LATCHED)
        steady_timer(node, _DRAWN, self._draw)
        self._console = Console()
        self._live: Live | None = None
        if self._page is not None:
            self._console.print(f"{self._page.url}  (this machine only; Ctrl-C ends)")
        elif self._console.is_terminal:
            self._live = Live(console=self._console, auto_refresh=False, screen=True)
            self._live.start()

    def close(self) -> None:
        """Restore the terminal, and end server and nodes."""
        if self._live is not None:
            self._live.stop()
        for part in (self._page, self._predictor):
            if part is not None:
                part.close()
        self.node.destroy_node()
        self._console.print("watch: ended")

    def _take_prediction(self, message: Prediction) -> None:
        self._prediction, self._heard_at = message, time.monotonic()
        if self._page is not None:
            self._page.publish(self._view().to_json())

    def _take_diagnostics(self, message: DiagnosticArray) -> None:
        namespace = self.node.get_namespace().rstrip("/")
        for status in message.status:
            source, _, what = status.name.partition(": ")
            node = source if source.startswith("/") else f"/{source}"
            if node == f"{namespace}/predictor" and what != "prediction":
                values = {pair.key: pair.value for pair in status.values}
                warns = status.level != DiagnosticStatus.OK
                self._joints[what] = JointView.diagnosed(what, values, warns, status.message)
            elif node == f"{namespace}/identifier" and what == "identification":
                self._nodes["identifier"] = status.message

    def _take_drift(self, message: DriftReport) -> None:
        self._nodes["drift of parameters"] = message.message

    def _take_status(self, message: RecorderStatus) -> None:
        words = _STATES[message.state] if message.state < len(_STATES) else "unknown"
        if message.bag and message.state:
            words = f"{words} {message.bag}, {message.duration:.0f} s"
        self._nodes["recorder"] = f"{words}: {message.fault}" if message.fault else words

    def _view(self) -> LiveView:
        message, nodes = self._prediction, dict(self._nodes)
        if message is None:
            silent = f"nothing on {self._topic}: start `idim-iv predict`, or name --config here"
            return LiveView("", 0.0, math.nan, silent, (), nodes)
        joints = tuple(
            replace(
                self._joints.get(name, JointView(name)),
                measured=message.measured[place],
                predicted=message.predicted[place],
                residual=message.residual[place],
                share=message.noise_share[place],
            )
            for place, name in enumerate(message.name)
        )
        silent_for = time.monotonic() - self._heard_at
        predictors = self.node.count_publishers(self._topic)
        reason = message.reason
        if predictors > 1:
            reason = (
                f"{predictors} predictors publish {self._topic}: end all but one, or give "
                "each robot a namespace"
            )
        elif silent_for > _SILENT:
            reason = f"the predictor has been silent for {silent_for:.0f} s"
        stamp = message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec
        return LiveView(message.robot, stamp, message.delay, reason, joints, nodes)

    def _draw(self) -> None:
        executor = self.node.executor
        if self._predictor is not None and executor is not None:
            executor.add_node(self._predictor.node)  # does nothing for one that is there
        now = time.monotonic()
        since_shown, silent_for = now - self._shown_at, now - self._heard_at
        if self._live is not None:
            self._live.update(live_table(self._view()), refresh=True)
        elif self._page is None and since_shown > _PRINTED:
            self._shown_at = now
            self._console.print(live_table(self._view()))
        elif self._page is not None and silent_for > _SILENT and since_shown > 1.0:
            self._shown_at = now
            self._page.publish(self._view().to_json())


def run(
    arguments: Sequence[str],
    web: int | None = None,
    predictor: Callable[[Sequence[str]], Closable] | None = None,
) -> int:
    """Run a `Watcher` until a signal, return the exit status; `arguments[0]` is the program."""
    return run_node("watch", lambda given: Watcher(given, web, predictor), ABOUT, arguments)
