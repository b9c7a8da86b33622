"""All bags of a fleet identified, each by itself: what `idim-iv fleet` does before statistics."""

import time
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager
from dataclasses import replace
from pathlib import Path

from idim_iv_ros.fleet.bag_result import BagResult, Status
from idim_iv_ros.fleet.content import code_version, key_of
from idim_iv_ros.fleet.remote import require_stores
from idim_iv_ros.fleet.robots import robots_of
from idim_iv_ros.fleet.run import FleetRun
from idim_iv_ros.fleet.source import BagEntry, find_bags
from idim_iv_ros.fleet.store import Store
from idim_iv_ros.fleet.task import Robot, content_task, identify_task, without_estimate
from idim_iv_ros.interruption import said_if_interrupted
from idim_iv_ros.progress import Progress

BAGS = "bags"  # folder of the results of bags, below those of the fleet
IDENTIFY = "identify"  # kind of result that a key names
# Bags whose content is looked at at once: disks and stores answer several.
_THREADS = 8
# Share of the progress that the digests of the bags take.
_DIGESTS = 0.03


def identify_bags(run: FleetRun, progress: Progress | None = None) -> tuple[BagResult, ...]:
    """Identify every bag of a fleet that was not identified before.

    Parameters
    ----------
    run
    progress
        Called with a stage in words and the share that is done, 0 to 1.

    Returns
    -------
    tuple of BagResult
        One for each bag, in the order of the source; a bag that cannot be used says why.

    Raises
    ------
    UsageError
        Source, configuration, output or scheduler are wrong.
    """
    entries, robots = robots_of(find_bags(run.source), Path(run.config))
    require_stores(entry.uri for entry in entries)
    return _Bags(run, entries, robots, progress).results()


class _Bags:
    """All bags of one run."""

    def __init__(
        self,
        run: FleetRun,
        entries: Sequence[BagEntry],
        robots: dict[str, Robot],
        progress: Progress | None,
    ):
        self.run, self.entries, self.robots, self.progress = run, entries, robots, progress
        self.store = Store(Path(run.out) / BAGS, BagResult)
        self.found: dict[int, BagResult] = {}

    def results(self) -> tuple[BagResult, ...]:
        contents = self._contents()
        waiting = self._take_kept(contents)
        self._identify(contents, waiting)
        owned = (owned_by(self.found[place], entry) for place, entry in enumerate(self.entries))
        return without_repeats(owned)

    def _contents(self) -> list[str]:
        """Digest of each bag; this machine waits for disks and stores, and computes little."""
        contents = [""] * len(self.entries)
        count = Counted("looking at", len(self.entries), self.progress, 0.0, _DIGESTS)
        with ThreadPoolExecutor(_THREADS) as pool:
            answers = pool.map(content_task, [entry.uri for entry in self.entries])
            for place, (content, status, problem) in enumerate(answers):
                contents[place] = content
                if not content:
                    self._fail(place, "", status, problem)
                count.one_more()
        return contents

    def _take_kept(self, contents: Sequence[str]) -> list[int]:
        """Take what earlier runs left; return the places of the rest, equal contents once."""
        waiting = []
        for place, content in enumerate(contents):
            if place in self.found:
                continue
            kept = self.store.get(self._key(place, content))
            if kept is None:
                waiting.append(place)
            else:
                self.found[place] = kept
        return waiting

    def _identify(self, contents: Sequence[str], waiting: Sequence[int]) -> None:
        count = Counted("identifying", len(waiting), self.progress, _DIGESTS, 1.0)
        tasks = [
            (
                self.entries[place].uri,
                contents[place],
                self._key(place, contents[place]),
                self.robots[self.entries[place].robot],
            )
            for place in waiting
        ]

        def done(number: int, result: BagResult | None, why: str) -> None:
            place = waiting[number]
            if result is None:  # of the machines, not of the bag: another run tries again
                self._fail(place, contents[place], "unusable", why)
            else:
                self.found[place] = result
                self.store.put(result.key, result)
            count.one_more()

        with count.said():
            self.run.tasks(identify_task, tasks, done)

    def _key(self, place: int, content: str) -> str:
        robot = self.robots[self.entries[place].robot]
        return key_of(content, robot.digest, code_version(), IDENTIFY)

    def _fail(self, place: int, content: str, status: Status, reason: str) -> None:
        self.found[place] = without_estimate(self.entries[place].uri, content, "", status, reason)


class Counted:
    """Progress over bags: how many, how fast, and how long the rest takes.

    Parameters
    ----------
    what
        ``identifying``.
    total
        Bags.
    begin, end
        Shares of the whole.
    of
        What is counted.
    """

    def __init__(
        self,
        what: str,
        total: int,
        progress: Progress | None,
        begin: float,
        end: float,
        of: str = "bags",
    ):
        self.of = of
        self.what, self.total, self.progress = what, total, progress
        self.begin, self.end = begin, end
        self.done, self._since = 0, time.monotonic()
        self._say()

    def said(self) -> AbstractContextManager[None]:
        """Within the ``with`` an interruption says how much is done, and that it is kept."""
        return said_if_interrupted(
            lambda: (
                f"{self.done:,} of {self.total:,} {self.of} are done and kept; the same command "
                "goes on from there"
            )
        )

    def one_more(self) -> None:
        """Count one bag."""
        self.done += 1
        self._say()

    def _say(self) -> None:
        if self.progress is None or not self.total:
            return
        share = self.done / self.total
        self.progress(self._words(), self.begin + (self.end - self.begin) * share)

    def _words(self) -> str:
        words = f"{self.what} {self.done:,} of {self.total:,} {self.of}"
        spent = time.monotonic() - self._since
        if not self.done or spent <= 0.0:
            return words
        rate = self.done / spent
        left = _duration((self.total - self.done) / rate)
        return f"{words}, {60.0 * rate:.3g} a minute, {left} left"


def _duration(seconds: float) -> str:
    if seconds < 100.0:
        return f"{seconds:.0f} s"
    return f"{seconds / 60.0:.0f} min" if seconds < 6000.0 else f"{seconds / 3600.0:.1f} h"


def owned_by(result: BagResult, entry: BagEntry) -> BagResult:
    """Return a result with what the source says of the bag: a kept one may have another name."""
    return replace(
        result,
        uri=entry.uri,
        robot=entry.robot,
        type=entry.type,
        time=entry.time or result.time,
        labels=dict(entry.labels),
    )


def without_repeats(results: Iterable[BagResult]) -> tuple[BagResult, ...]:
    """Leave out a recording that is there twice: it would pass for a repeat without any noise."""
    first: dict[str, str] = {}
    kept = []
    for result in results:
        before = first.setdefault(result.content, result.uri) if result.status == "ok" else None
        if before is not None and before != result.uri:
            reason = f"the same recording as {before}"
            result = replace(
                without_estimate(result.uri, result.content, result.key, "unusable", reason),
                robot=result.robot,
                type=result.type,
                time=result.time,
                labels=result.labels,
            )
        kept.append(result)
    return tuple(kept)
