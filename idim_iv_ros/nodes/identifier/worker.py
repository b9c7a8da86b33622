"""A worker process and what is heard from it."""

import contextlib
import json
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

Event = dict[str, Any]

_START = "from idim_iv_ros.nodes.identifier.identification_worker import main; main()"


class Worker:
    """The process of one job.

    Parameters
    ----------
    request : mapping
        See `identification_worker`.
    folder : Path
        Its working directory and place for temporary files.
    heard : callable
        Takes each event in a thread of its own; the last is ``{"ended": exit status}``.
    """

    def __init__(
        self, request: Mapping[str, object], folder: Path, heard: Callable[[Event], None]
    ) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-c", _START],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            cwd=folder,
            env={**os.environ, "TMPDIR": str(folder)},
            start_new_session=True,
        )
        self._heard = heard
        self._thread = threading.Thread(target=self._listen, name="worker", daemon=True)
        self._thread.start()
        self._say(request)

    @property
    def process_id(self) -> int:
        """Of the process."""
        return self._process.pid

    def kill(self) -> None:
        """End the process and what it started, now."""
        if self._process.poll() is None:
            try:
                os.killpg(self._process.pid, signal.SIGKILL)
            except ProcessLookupError:
                return

    def join(self) -> None:
        """Wait until the process has ended and all of its events were heard."""
        self._thread.join()

    def _say(self, request: Mapping[str, object]) -> None:
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(json.dumps(request) + "\n")
            self._process.stdin.flush()
        except OSError:
            return  # it has ended already, which the other thread hears

    def _listen(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            try:
                self._heard(json.loads(line))
            except ValueError:
                continue  # cut off by a kill
        status = self._process.wait()
        if self._process.stdin is not None:
            with contextlib.suppress(OSError):
                self._process.stdin.close()
        self._process.stdout.close()
        self._heard({"ended": status})
