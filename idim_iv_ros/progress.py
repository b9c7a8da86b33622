"""Seconds by stage of a long computation, and a word to whoever waits for it."""

import time
from collections.abc import Callable

Progress = Callable[[str, float], None]


def part_of(progress: Progress | None, begin: float, end: float) -> Progress | None:
    """Return what a stage reports its own share to, 0 to 1, as `begin` to `end` of the whole."""
    if progress is None:
        return None
    whole = progress
    return lambda stage, share: whole(stage, begin + (end - begin) * share)


class Stopwatch:
    """Context manager that adds the seconds of each stage to `timing`.

    - `progress`: called at the start of each stage with its name and the share that is done, 0 to 1
    """

    def __init__(self, progress: Progress | None):
        self.progress = progress
        self.timing: dict[str, float] = {}
        self._stage: str | None = None
        self._since = 0.0

    def stage(self, name: str, share: float) -> None:
        """End the running stage and start another."""
        self._end()
        self._stage, self._since = name, time.perf_counter()
        if self.progress is not None:
            self.progress(name, share)

    def __enter__(self) -> "Stopwatch":
        return self

    def __exit__(self, *error: object) -> None:
        self._end()

    def _end(self) -> None:
        if self._stage is not None:
            spent = time.perf_counter() - self._since
            self.timing[self._stage] = self.timing.get(self._stage, 0.0) + spent
        self._stage = None
