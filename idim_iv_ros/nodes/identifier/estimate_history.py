"""Estimates of one bag after the other: what is kept over a restart and compared."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, Literal

from idim_iv_ros.documents import Document, Number
from idim_iv_ros.errors import DataError, UsageError
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
    """

    stamp: int
    robot: str
    estimator: str
    effort_unit: str
    bags: tuple[str, ...]
    folder: str
    values: dict[str, tuple[Number, Number]]


@dataclass(frozen=True, kw_only=True)
class _Saved(Document):
    what: ClassVar[str] = "a history"
    written_by: ClassVar[str] = "serve"
    format: Literal["idim_iv_ros/history/1"] = "idim_iv_ros/history/1"
    identifications: tuple[PastEstimates, ...]


class EstimateHistory:
    """Identifications in the order of time, in a file.

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
            Identifications that are kept at most.

        Raises
        ------
        UsageError
            The file cannot be written.
        """
        kept = [each for each in self.entries if not _same_data(each, entry)]
        self.entries = [*kept, entry][-length:]
        _Saved(identifications=tuple(self.entries)).write(self._path)

    def drifts(self, significance: float) -> list[Drift]:
        """Compare the last identification with the first that is comparable.

        Comparable: the same robot, estimator, unit of effort and parameters, and no bag in
        common, for estimates from the same data are not independent.

        Returns
        -------
        list of Drift
            One for each parameter; empty without a comparable identification.
        """
        if not self.entries:
            return []
        last = self.entries[-1]
        first = next((each for each in self.entries if _comparable(each, last)), None)
        if first is None:
            return []
        return drifts_of(first.values, last.values, significance, first.bags)


def _same_data(one: PastEstimates, other: PastEstimates) -> bool:
    return _kind(one) == _kind(other) and set(one.bags) == set(other.bags)


def _comparable(first: PastEstimates, last: PastEstimates) -> bool:
    return (
        _kind(first) == _kind(last)
        and set(first.values) == set(last.values)
        and not set(first.bags) & set(last.bags)
    )


def _kind(entry: PastEstimates) -> Sequence[str]:
    return entry.robot, entry.estimator, entry.effort_unit
