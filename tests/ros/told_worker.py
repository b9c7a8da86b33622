"""In the place of the identifier's process: a worker that does what the test says."""

import signal
from collections.abc import Callable


class ToldWorker:
    """Begins a job, and the test says how it goes on."""

    def __init__(self, request: dict, heard: Callable[["ToldWorker", dict], None]) -> None:
        self.request, self._heard = request, heard

    def say(self, **event: object) -> None:
        self._heard(self, event)

    def end(self, **answer: object) -> None:
        """Answer, and end the process."""
        self.say(**answer)
        self.say(gone=0)

    def kill(self) -> None:
        self.say(gone=-signal.SIGKILL)

    def close(self) -> None:
        """Nothing is left to be ended."""
