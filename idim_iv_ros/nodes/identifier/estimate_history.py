"""Estimates of one bag after the other: what is kept over a restart and compared."""

import fcntl
import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar, Literal

from idim_iv_ros.documents import Document, Number
from idim_iv_ros.errors import DataError, UsageError
from idim_iv_ros.files import require_folder_place
from idim_iv_ros.statistics.drift import Drift, drifts_of

FILE = "history.json"


@dataclass(frozen=True)
class PastEstimates:
    """One identification.

    Attributes
    ----------
    stamp : int
        When it ended, ns since 1970.
    robot, estimator : str
    effort_unit : str
        Estimates in different units are not compared.
    bags : tuple of str
        Relative to the bag directory.
    folder : str
        Of its files, relative to the output directory.
    values : dict
        Value and standard deviation of each parameter.
    configuration : str
        As the request named it; empty for the node's own.
    baseline : bool
        Whether later ones of its kind are compared with it.
    """

    stamp: int
    robot: str
    estimator: str
    effort_unit: str
    bags: tuple[str, ...]
    folder: str
    values: dict[str, tuple[Number, Number]]
    configuration: str = ""
    baseline: bool = False

    @property
    def kind(self) -> tuple[str, str, str, str]:
        """What estimates must share to be compared."""
        return self.robot, self.configuration, self.estimator, self.effort_unit


@dataclass(frozen=True)
class Comparison:
    """The newest identification of one kind beside its baseline.

    Attributes
    ----------
    newest : PastEstimates
    baseline : PastEstimates or None
        None where there is nothing to compare with.
    drifts : tuple of Drift
        One for each parameter; empty without a baseline.
    since : int or None
        Stamp of the first identification from which on all drift, ns since 1970.
    """

    newest: PastEstimates
    baseline: PastEstimates | None = None
    drifts: tuple[Drift, ...] = ()
    since: int | None = None

    @property
    def drifting(self) -> tuple[Drift, ...]:
        """Parameters that differ by more than chance."""
        return tuple(drift for drift in self.drifts if drift.drifts)


@dataclass(frozen=True, kw_only=True)
class _Saved(Document):
    what: ClassVar[str] = "a history"
    written_by: ClassVar[str] = "serve"
    format: Literal["idim_iv_ros/history/1"] = "idim_iv_ros/history/1"
    identifications: tuple[PastEstimates, ...]


class EstimateHistory:
    """Identifications in the order of time, in a file.

    Each kind (robot, configuration, estimator, unit of the effort) is compared for itself: what an
    operator asks for with another estimator does not end an alarm.

    Raises
    ------
    DataError
        The file is there but is no history; it is left as it is.
    """

    def __init__(self, directory: Path) -> None:
        self._path = directory / FILE
        self.entries: list[PastEstimates] = []
        if self._path.exists():
            try:
                self.entries = list(_Saved.read(self._path).identifications)
            except UsageError as error:
                raise DataError(f"{error}; or move it away") from error

    def add(self, entry: PastEstimates, length: int) -> None:
        """Keep an identification; an earlier one of the same bags gives way to it.

        Parameters
        ----------
        entry
        length
            Identifications of each kind that are kept at most; a baseline that was set stays.

        Raises
        ------
        UsageError
            The file cannot be written.
        """
        replaced = [each for each in self.entries if _same_data(each, entry)]
        if any(entry.baseline for entry in replaced):
            entry = replace(entry, baseline=True)
        kept = [each for each in self.entries if not _same_data(each, entry)]
        same = [each for each in kept if each.kind == entry.kind]
        free = [each for each in same if not each.baseline]
        room = max(length - 1 - (len(same) - len(free)), 0)
        old = free[: max(len(free) - room, 0)]
        self._keep([*(each for each in kept if not any(each is one for one in old)), entry])

    def set_baseline(self, folder: str) -> PastEstimates:
        """Compare later identifications with one that is kept, and return it.

        Parameters
        ----------
        folder
            Of its files.

        Raises
        ------
        UsageError
            There is none, or the file cannot be written.
        """
        chosen = next((entry for entry in self.entries if entry.folder == folder), None)
        if chosen is None:
            what = f"no identification in {folder}" if folder else "no identification"
            raise UsageError(f"{what} is kept; get_history lists those that are")
        self._keep(
            [
                replace(entry, baseline=entry is chosen) if entry.kind == chosen.kind else entry
                for entry in self.entries
            ]
        )
        return chosen

    def comparisons(self, significance: float) -> list[Comparison]:
        """Compare the newest identification of each kind with its baseline.

        That is the one that was set, else the first that is comparable: with the same parameters,
        and no bag in common, for estimates from the same data are not independent.

        Returns
        -------
        list of Comparison
            In the order of the newest identifications.
        """
        newest = {entry.kind: entry for entry in self.entries}
        ordered = sorted(newest.values(), key=self.entries.index)
        return [self._comparison(each, significance) for each in ordered]

    def _comparison(self, newest: PastEstimates, significance: float) -> Comparison:
        same = [entry for entry in self.entries if entry.kind == newest.kind]
        able = [each for each in same if _comparable(each, newest)]
        first = next(
            (candidate for candidate in able if candidate.baseline), able[0] if able else None
        )
        if newest.baseline or first is None:
            return Comparison(newest)
        drifts = drifts_of(first.values, newest.values, significance, first.bags)
        since = None
        for each in reversed(same[same.index(first) + 1 :]):
            if not _comparable(first, each):
                continue
            found = drifts_of(first.values, each.values, significance, first.bags)
            if not any(drift.drifts for drift in found):
                break
            since = each.stamp
        return Comparison(newest, first, tuple(drifts), since)

    def _keep(self, entries: Sequence[PastEstimates]) -> None:
        _Saved(identifications=tuple(entries)).write(self._path)
        self.entries = list(entries)


def _same_data(one: PastEstimates, other: PastEstimates) -> bool:
    return one.kind == other.kind and set(one.bags) == set(other.bags)


def _comparable(first: PastEstimates, last: PastEstimates) -> bool:
    return set(first.values) == set(last.values) and not set(first.bags) & set(last.bags)


class FolderLock:
    """A folder that one process has to itself, however it ends: the system releases the lock.

    Parameters
    ----------
    folder : Path
        Made if it is not there. Where it cannot be locked, as on some network disks, nothing is
        refused.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._open: int | None = None

    def take(self) -> None:
        """Have the folder from now on.

        Raises
        ------
        UsageError
            It cannot be written, or another identifier has it.
        """
        if self._open is not None:
            return
        try:
            require_folder_place(self._folder)
            self._folder.mkdir(parents=True, exist_ok=True)
            folder = os.open(self._folder, os.O_RDONLY)
        except (OSError, UsageError) as error:
            raise UsageError(f"parameter output_directory: {error}") from error
        try:
            fcntl.flock(folder, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            os.close(folder)
            raise UsageError(
                f"parameter output_directory: another identifier writes into {self._folder}; give "
                "each one a folder of its own"
            ) from error
        except OSError:
            os.close(folder)
            return
        self._open = folder

    def release(self) -> None:
        """Let others have it."""
        if self._open is not None:
            os.close(self._open)
            self._open = None
