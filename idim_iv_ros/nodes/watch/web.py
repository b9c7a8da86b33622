"""The live view as a page that only this machine can open: files, and a stream of events."""

import json
import threading
from collections import deque
from contextlib import suppress
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib import resources
from queue import Empty, Full, Queue

from idim_iv_ros.errors import UsageError

ADDRESS = "127.0.0.1"
_HISTORY = 600  # events that a page gets when it is opened
_WAITING = 200  # events that a slow page may be behind
_ALIVE = 2.0  # s between two signs of life
_FILES = {
    "/": ("live.html", "text/html"),
    "/live.css": ("live.css", "text/css"),
    "/live.js": ("live.js", "text/javascript"),
}
_POLICY = "default-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:"


class LivePage:
    """A server on the loopback interface, in threads of its own.

    Parameters
    ----------
    port : int
        0: any that is free.

    Attributes
    ----------
    url : str

    Raises
    ------
    UsageError
        The port is taken or not allowed.
    """

    def __init__(self, port: int) -> None:
        try:
            self._server = _Server((ADDRESS, port), _Handler)
        except (OSError, OverflowError) as error:
            reason = getattr(error, "strerror", None) or "no such port"
            raise UsageError(f"--web {port}: {reason}; name another port") from error
        self.url = f"http://{ADDRESS}:{self._server.server_port}/"
        threading.Thread(target=self._server.serve_forever, name="page", daemon=True).start()

    def publish(self, document: dict[str, object]) -> None:
        """Send a state to all pages that are open."""
        event = f"data: {json.dumps(document, allow_nan=False)}\n\n".encode()
        self._server.publish(event)

    def close(self) -> None:
        """End all streams and the server."""
        self._server.ended.set()
        self._server.shutdown()
        self._server.server_close()


class _Server(ThreadingHTTPServer):
    daemon_threads = True

    def __init__(self, address: tuple[str, int], handler: type[BaseHTTPRequestHandler]) -> None:
        super().__init__(address, handler)
        self.ended = threading.Event()
        self._lock = threading.Lock()
        self._history: deque[bytes] = deque(maxlen=_HISTORY)
        self._pages: list[Queue[bytes]] = []

    def publish(self, event: bytes) -> None:
        with self._lock:
            self._history.append(event)
            for page in self._pages:
                try:
                    page.put_nowait(event)
                except Full:  # the page is slow: it misses the oldest
                    with suppress(Empty):
                        page.get_nowait()
                    page.put_nowait(event)

    def opened(self) -> tuple[bytes, "Queue[bytes]"]:
        """Return everything so far, and a queue of what comes."""
        page: Queue[bytes] = Queue(_WAITING)
        with self._lock:
            self._pages.append(page)
            return b"".join(self._history), page

    def closed(self, page: "Queue[bytes]") -> None:
        with self._lock:
            self._pages.remove(page)

    def handle_error(self, request: object, client_address: object) -> None:
        """Nothing: a page that is closed while it is sent is no error."""


class _Handler(BaseHTTPRequestHandler):
    server: _Server
    server_version, sys_version = "idim-iv", ""

    def do_GET(self) -> None:
        """Answer with a file, or with events until the page is closed."""
        port = self.server.server_port
        # Another name that leads here is a page of somebody else that reads this one.
        if self.headers.get("Host") not in (f"{ADDRESS}:{port}", f"localhost:{port}"):
            self.send_error(HTTPStatus.FORBIDDEN)
            return
        path = self.path.partition("?")[0]
        if path == "/events":
            self._stream()
        elif path == "/plotly.js":
            from plotly.offline import get_plotlyjs

            self._send(get_plotlyjs().encode(), "text/javascript")
        elif path in _FILES:
            name, kind = _FILES[path]
            file = resources.files("idim_iv_ros.nodes.watch") / "assets" / name
            self._send(file.read_bytes(), kind)
        else:
            self.send_error(HTTPStatus.NOT_FOUND)

    def _send(self, content: bytes, kind: str) -> None:
        self.send_response(HTTPStatus.OK)
        self.send_header("Content-Type", f"{kind}; charset=utf-8")
        self.send_header("Content-Length", str(len(content)))
        self.send_header("Content-Security-Policy", _POLICY)
        self.end_headers()
        self.wfile.write(content)

    def _stream(self) -> None:
        self.send_response(HTTPStatus.OK)
        self.send_header("Content-Type", "text/event-stream")
        self.send_header("Cache-Control", "no-store")
        self.end_headers()
        history, page = self.server.opened()
        try:
            self.wfile.write(history)
            while not self.server.ended.is_set():
                try:
                    self.wfile.write(page.get(timeout=_ALIVE))
                except Empty:
                    self.wfile.write(b": alive\n\n")
                self.wfile.flush()
        except OSError:
            return  # the page was closed
        finally:
            self.server.closed(page)

    def log_message(self, format: str, *args: object) -> None:
        """Nothing: the terminal belongs to the user."""
