"""The live view as a page that only this machine can open: files, and the newest states."""

import threading
from collections import deque
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib import resources
from urllib.parse import parse_qs, urlsplit

from idim_iv_ros.errors import UsageError

ADDRESS = "127.0.0.1"
_HISTORY = 600  # states that a page gets when it is opened
_FILES = {
    "/": ("live.html", "text/html"),
    "/live.css": ("live.css", "text/css"),
    "/live.js": ("live.js", "text/javascript"),
}
_POLICY = "default-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:"


class LivePage:
    """A server on the loopback interface, in threads of its own; port 0 is any that is free.

    Raises UsageError: the port is taken or not allowed.
    """

    def __init__(self, port: int) -> None:
        try:
            self._server = _Server((ADDRESS, port), _Handler)
        except (OSError, OverflowError) as error:
            reason = getattr(error, "strerror", None) or "no such port"
            raise UsageError(f"--web {port}: {reason}; name another port") from error
        self.url = f"http://{ADDRESS}:{self._server.server_port}/"
        threading.Thread(target=self._server.serve_forever, name="page", daemon=True).start()

    def publish(self, state: bytes) -> None:
        """Show a state, JSON, on all pages that are open."""
        with self._server.lock:
            self._server.count += 1
            self._server.states.append((self._server.count, state))

    def close(self) -> None:
        """End the server."""
        self._server.shutdown()
        self._server.server_close()


class _Server(ThreadingHTTPServer):
    """Keeps the newest states with their numbers, which count from 1."""

    daemon_threads = True

    def __init__(self, address: tuple[str, int], handler: type[BaseHTTPRequestHandler]) -> None:
        super().__init__(address, handler)
        self.lock = threading.Lock()
        self.count = 0
        self.states: deque[tuple[int, bytes]] = deque(maxlen=_HISTORY)

    def later(self, number: int) -> bytes:
        """States after a number as JSON; all where that is the number of an earlier server."""
        with self.lock:
            later = [state for place, state in self.states if not place <= number <= self.count]
            return b'{"newest": %d, "states": [%s]}' % (self.count, b",".join(later))

    def handle_error(self, request: object, client_address: object) -> None:
        """Nothing: a page that is closed while it is sent is no error."""


class _Handler(BaseHTTPRequestHandler):
    server: _Server
    server_version, sys_version = "idim-iv", ""

    def do_GET(self) -> None:
        """Answer with a file, or with the states after the one that the page has."""
        port = self.server.server_port
        # Another name that leads here is a page of somebody else that reads this one.
        if self.headers.get("Host") not in (f"{ADDRESS}:{port}", f"localhost:{port}"):
            self.send_error(HTTPStatus.FORBIDDEN)
            return
        address = urlsplit(self.path)
        after = parse_qs(address.query).get("after", ["0"])[0]
        if address.path == "/states" and after.isdecimal():
            self._send(self.server.later(int(after)), "application/json")
        elif address.path == "/plotly.js":
            from plotly.offline import get_plotlyjs

            self._send(get_plotlyjs().encode(), "text/javascript")
        elif address.path in _FILES:
            name, kind = _FILES[address.path]
            file = resources.files("idim_iv_ros.nodes.watch") / "assets" / name
            self._send(file.read_bytes(), kind)
        else:
            self.send_error(HTTPStatus.NOT_FOUND)

    def _send(self, content: bytes, kind: str) -> None:
        self.send_response(HTTPStatus.OK)
        self.send_header("Content-Type", f"{kind}; charset=utf-8")
        self.send_header("Content-Length", str(len(content)))
        self.send_header("Content-Security-Policy", _POLICY)
        self.send_header("Cache-Control", "no-store")
        self.end_headers()
        self.wfile.write(content)

    def log_message(self, format: str, *args: object) -> None:
        """Nothing: the terminal belongs to the user."""
