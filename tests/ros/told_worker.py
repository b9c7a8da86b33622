"""In the place of the identifier's process: a worker that does what the test says."""

import signal
from collections.abc import Callable


class ToldWorker:
    """Begins a job, and the test says how it goes on."""

    def __init__(self, heard: Callable[["ToldWorker", dict], None]) -> None:
        self._heard = heard
        self.requests: list[dict] = []
        self.process_id: int | None = None
        self.ready, self.killed = True, False

    def begin(self, request: dict) -> None:
        self.requests.append(request)
        self.process_id = 99

    def say(self, **event: object) -> None:
        self._heard(self, event)

    def end(self, **answer: object) -> None:
        """Answer, and end the process of the job."""
        self.say(**answer)
        self.process_id = None
        self.say(ended=0)

    def kill(self) -> None:
        self.process_id = None
        self.say(ended=-signal.SIGKILL)

    def close(self) -> None:
        """Nothing is left to be ended."""


class EndsAtOnce(ToldWorker):
    """A worker whose jobs have failed when they have begun."""

    def begin(self, request: dict) -> None:
        super().begin(request)
        self.end(error="nothing moves")
