"""Estimates of one bag after the other: what is kept over a restart, and what drifts."""

import dataclasses
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import NormalDist
from typing import Any

from idim_iv_ros.errors import DataError
from idim_iv_ros.nodes.identifier.documents import write_document

FORMAT = "idim_iv_ros/history/1"
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
    values : mapping
        Value and standard deviation of each parameter.
    """

    stamp: int
    robot: str
    estimator: str
    effort_unit: str
    bags: tuple[str, ...]
    folder: str
    values: Mapping[str, tuple[float, float]]


@dataclass(frozen=True)
class Drift:
    """A parameter of the last identification beside its first estimate.

    Attributes
    ----------
    statistic : float
        Difference over the root of the sum of both variances: standard normal if the parameter
        has not changed.
    limit : float
        What its magnitude exceeds by chance with the probability that was asked for, shared
        among all parameters (Bonferroni).
    since : tuple of str
        Bags of the first estimate.
    """

    parameter: str
    value: float
    first: float
    statistic: float
    limit: float
    since: tuple[str, ...]

    @property
    def drifts(self) -> bool:
        """Whether the difference is more than chance."""
        return abs(self.statistic) > self.limit


class EstimateHistory:
    """Identifications in the order of time, in a file.

    Raises
    ------
    DataError
        The file is there but is no history; it is left as it is.
    """

    def __init__(self, directory: Path) -> None:
        self._path = directory / FILE
        self.entries: list[PastEstimates] = _read(self._path)

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
        document = {
            "format": FORMAT,
            "identifications": [dataclasses.asdict(each) for each in self.entries],
        }
        write_document(self._path, document)

    def drifts(self, significance: float) -> list[Drift]:
        """Compare the last identification with the first that is comparable.

        Comparable: the same robot, estimator, unit of effort and parameters, and no bag in
        common, for estimates from the same data are not independent.

        Parameters
        ----------
        significance
            Probability that any of the parameters is flagged although none has changed.

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
        limit = -NormalDist().inv_cdf(significance / (2.0 * len(last.values)))
        drifts = []
        for name, (value, std) in last.values.items():
            value_then, std_then = first.values[name]
            spread = math.hypot(std, std_then)
            statistic = (value - value_then) / spread if spread > 0.0 else 0.0
            drifts.append(Drift(name, value, value_then, statistic, limit, first.bags))
        return drifts


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


def _read(path: Path) -> list[PastEstimates]:
    try:
        document: Any = json.loads(path.read_text(encoding="utf-8"))
        if document["format"] != FORMAT:
            raise DataError(f"{path}: its format is not {FORMAT}; move it away")
        return [
            PastEstimates(
                stamp=int(each["stamp"]),
                robot=str(each["robot"]),
                estimator=str(each["estimator"]),
                effort_unit=str(each["effort_unit"]),
                bags=tuple(map(str, each["bags"])),
                folder=str(each["folder"]),
                values={
                    name: (float(value), float(std))
                    for name, (value, std) in each["values"].items()
                },
            )
            for each in document["identifications"]
        ]
    except FileNotFoundError:
        return []
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise DataError(f"{path}: cannot be read as a history; move it away") from error
