"""The history of estimates: kept in a file, compared for drift, and reported."""

import fcntl
import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar, Literal

from diagnostic_msgs.msg import DiagnosticStatus

from idim_iv_interfaces.msg import DriftComparison, DriftReport, PastIdentification
from idim_iv_ros.documents import Document, Number
from idim_iv_ros.errors import DataError, UsageError
from idim_iv_ros.files import require_folder_place
from idim_iv_ros.nodes.messages import diagnostic_status, message_of
from idim_iv_ros.statistics.hypothesis import Drift, drifts_of

FILE = "history.json"


@dataclass(frozen=True)
class PastEstimates:
    """One identification, with the fields of the message `PastIdentification`."""

    stamp: int  # when it ended, ns since 1970
    robot: str
    estimator: str
    effort_unit: str
    bags: tuple[str, ...]
    folder: str
    values: dict[str, tuple[Number, Number]]  # value and standard deviation of each parameter
    configuration: str = ""
    baseline: bool = False  # whether later ones of its kind are compared with it

    @property
    def kind(self) -> tuple[str, str, str, str]:
        """Return the properties that estimates must share to be compared."""
        return self.robot, self.configuration, self.estimator, self.effort_unit

    def independent_of(self, other: "PastEstimates") -> bool:
        """Return whether both have the same parameters, and no bag in common."""
        return set(self.values) == set(other.values) and not set(self.bags) & set(other.bags)

    def to_message(self) -> PastIdentification:
        """Return the entry of the list that `~/get_history` answers with."""
        values, stds = zip(*self.values.values(), strict=True) if self.values else ((), ())
        return message_of(PastIdentification, self, names=self.values, values=values, stds=stds)


@dataclass(frozen=True)
class Comparison:
    """The newest identification of one kind compared with its baseline."""

    newest: PastEstimates
    baseline: PastEstimates | None = None
    drifts: tuple[Drift, ...] = ()  # one for each parameter, none without a baseline
    since: int | None = None  # stamp of the first one after which every one drifts, ns since 1970

    @property
    def drifting(self) -> tuple[Drift, ...]:
        """Return the parameters whose change is significant."""
        return tuple(drift for drift in self.drifts if drift.drifts)

    @property
    def compared_with(self) -> str:
        """Return the names of the baseline's bags, separated by commas."""
        return "" if self.baseline is None else ", ".join(self.baseline.bags)

    def to_message(self) -> DriftComparison:
        """Return the comparison as an entry of the message on `~/drift`."""
        baseline = self.baseline
        return message_of(
            DriftComparison,
            self.newest,
            drifting=self.drifting,
            since=self.since if self.drifting else 0,
            baseline_bags=baseline and baseline.bags,
            baseline_stamp=baseline and baseline.stamp,
            limit=self.drifts[0].limit if self.drifts else 0.0,
            parameters=self.drifts,
        )


@dataclass(frozen=True, kw_only=True)
class _HistoryFile(Document):
    what: ClassVar[str] = "a history"
    written_by: ClassVar[str] = "serve"
    format: Literal["idim_iv_ros/history/1"] = "idim_iv_ros/history/1"
    identifications: tuple[PastEstimates, ...]


class EstimateHistory:
    """Past identifications in the order of time, saved in a file.

    Only those of one kind (robot, configuration, estimator, unit of the effort) are compared.
    Raises DataError: the file is there but is no history; it is left as it is.
    """

    def __init__(self, directory: Path) -> None:
        self._path = directory / FILE
        self.entries: list[PastEstimates] = []
        if self._path.exists():
            try:
                self.entries = list(_HistoryFile.read(self._path).identifications)
            except UsageError as error:
                raise DataError(f"{error}; or move it away") from error

    def add(self, entry: PastEstimates, length: int) -> None:
        """Save an identification in place of an earlier one of the same kind and bags.

        At most `length` of its kind are kept, the newest and a baseline that the user set.
        """
        earlier = [
            other
            for other in self.entries
            if other.kind == entry.kind and set(other.bags) == set(entry.bags)
        ]
        entry = replace(entry, baseline=any(other.baseline for other in earlier))
        others = [other for other in self.entries if other not in earlier]
        of_kind = [other for other in others if other.kind == entry.kind]
        removable = [other for other in of_kind if not other.baseline]
        surplus = removable[: max(len(of_kind) + 1 - length, 0)]
        self._save([*(other for other in others if other not in surplus), entry])

    def set_baseline(self, folder: str) -> PastEstimates:
        """Make the identification in `folder` the baseline of its kind, and return it."""
        chosen = next((entry for entry in self.entries if entry.folder == folder), None)
        if chosen is None:
            what = f"no identification in {folder}" if folder else "no identification"
            raise UsageError(f"{what} is kept; get_history lists those that are")
        self._save(
            [
                replace(entry, baseline=entry is chosen) if entry.kind == chosen.kind else entry
                for entry in self.entries
            ]
        )
        return chosen

    def comparisons(self, significance: float) -> list[Comparison]:
        """Compare the newest identification of each kind with its baseline.

        That is the one that was set, else the first with the same parameters and no bag in common.
        """
        by_kind: dict[tuple[str, ...], list[PastEstimates]] = {}
        for entry in self.entries:
            by_kind[entry.kind] = [*by_kind.pop(entry.kind, []), entry]  # the newest kind last
        compared = []
        for of_kind in by_kind.values():
            newest = of_kind[-1]
            comparable = [entry for entry in of_kind if entry.independent_of(newest)]
            if newest.baseline or not comparable:
                compared.append(Comparison(newest))
                continue
            chosen = [entry for entry in comparable if entry.baseline]
            baseline, since = (chosen or comparable)[0], None
            for entry in reversed(of_kind[of_kind.index(baseline) + 1 :]):
                if baseline.independent_of(entry):
                    drifts = drifts_of(baseline.values, entry.values, significance)
                    if not any(drift.drifts for drift in drifts):
                        break
                    since = entry.stamp
            drifts = drifts_of(baseline.values, newest.values, significance)
            compared.append(Comparison(newest, baseline, drifts, since))
        return compared

    def _save(self, entries: Sequence[PastEstimates]) -> None:
        _HistoryFile(identifications=tuple(entries)).write(self._path)
        self.entries = list(entries)


def drift_report(comparisons: Sequence[Comparison]) -> DriftReport:
    """Return the message for `~/drift`."""
    return message_of(
        DriftReport,
        None,
        header=comparisons[-1].newest.stamp if comparisons else 0,
        drifting=any(comparison.drifting for comparison in comparisons),
        message=_sentence(comparisons),
        comparisons=[comparison.to_message() for comparison in comparisons],
    )


def drift_diagnosis(name: str, comparisons: Sequence[Comparison]) -> DiagnosticStatus:
    """Return a diagnostic status with the drift of every parameter; WARN if any is significant."""
    # The kind that was identified last, unless another is the reason of the alarm.
    compared = [comparison for comparison in comparisons if comparison.drifts]
    alarms = [comparison for comparison in compared if comparison.drifting]
    values: dict[str, object] = {}
    if compared:
        shown = (alarms or compared)[-1]
        values["bags"] = ", ".join(shown.newest.bags)
        values["limit (σ)"] = f"{shown.drifts[0].limit:.3f}"
        for drift in shown.drifts:
            values[f"{drift.name} (σ)"] = f"{drift.statistic:+.2f}"
    level = DiagnosticStatus.WARN if alarms else DiagnosticStatus.OK
    return diagnostic_status(level, f"{name}: drift", name, _sentence(comparisons), values)


def _sentence(comparisons: Sequence[Comparison]) -> str:
    parts, unchanged = [], "no earlier identification to compare with"
    for comparison in comparisons:
        newest, bags = comparison.newest, comparison.compared_with
        kind = ", ".join(filter(None, (newest.configuration, newest.estimator)))
        which = f"{kind}: " if len(comparisons) > 1 else ""
        changed = "; ".join(
            f"{drift.name} {drift.before:.4g} → {drift.now:.4g} ({drift.statistic:+.1f} σ)"
            for drift in comparison.drifting
        )
        if changed:
            parts.append(f"{which}{changed}: changed since {bags}")
        elif comparison.drifts:
            limit = comparison.drifts[0].limit
            unchanged = f"no parameter differs from {bags} by more than {limit:.2f} σ"
    return "; ".join(parts) or unchanged


class FolderLock:
    """Locks a folder, made if needed, until the process ends; some network disks know no locks."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._open: int | None = None

    def take(self) -> None:
        """Create and lock the folder; a UsageError where it cannot be, or another one has it."""
        if self._open is not None:
            return
        try:
            require_folder_place(self._folder)
            self._folder.mkdir(parents=True, exist_ok=True)
            self._open = os.open(self._folder, os.O_RDONLY)
            fcntl.flock(self._open, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            self.release()
            raise UsageError(
                f"parameter output_directory: another identifier writes into {self._folder}; give "
                "each one a folder of its own"
            ) from error
        except (OSError, UsageError) as error:
            if self._open is None:  # else it is a disk that knows no locks
                raise UsageError(f"parameter output_directory: {error}") from error

    def release(self) -> None:
        """Release the lock."""
        if self._open is not None:
            os.close(self._open)
            self._open = None
