"""fleet.parquet: one row for each bag and base parameter, for programs.

==============  ====================================================================================
column          content
==============  ====================================================================================
uri             of the bag, as in the source
robot, type     whose it is
time            start of the recording, UTC; null where nothing says it
status          ``ok``, ``missing``, ``corrupt`` or ``unusable``
reason          in words where it is not ok: the bag then has one row, without a parameter
duration        s
rows            whitened rows of the regression, all joints
estimator       ``idim-iv`` or ``idim-ls``
verdict         of the identification: valid, autocorrelated, misspecified, inconclusive
parameter       name of the base parameter
unit            of the next three
value, std      estimate of this bag alone and its standard deviation
given           of the nominal model; null where there is none
content         digest of the bag: equal contents are one recording
label_NAME      other columns of the manifest
==============  ====================================================================================
"""

import math
from collections.abc import Sequence
from datetime import datetime
from pathlib import Path
from typing import Any

from idim_iv_ros.errors import UsageError
from idim_iv_ros.files import complete_files
from idim_iv_ros.fleet.bag_result import BagResult

FILE = "fleet.parquet"
_TEXTS = ("uri", "robot", "type", "status", "reason", "estimator", "verdict", "parameter", "unit")
_NUMBERS = ("duration", "value", "std", "given")


def write_table(results: Sequence[BagResult], path: Path) -> None:
    """Write fleet.parquet, complete or not at all.

    Raises
    ------
    UsageError
        It cannot be written, and why.
    """
    import pyarrow
    from pyarrow import parquet

    labels = sorted({name for result in results for name in result.labels})
    kinds = dict.fromkeys(_TEXTS, pyarrow.string()) | dict.fromkeys(_NUMBERS, pyarrow.float64())
    kinds |= {"time": pyarrow.timestamp("us", tz="UTC"), "rows": pyarrow.int64()}
    kinds |= {"content": pyarrow.string()}
    kinds |= {f"label_{name}": pyarrow.string() for name in labels}
    order = (
        *("uri", "robot", "type", "time", "status", "reason", "duration", "rows", "estimator"),
        *("verdict", "parameter", "unit", "value", "std", "given", "content"),
        *(f"label_{name}" for name in labels),
    )
    rows = [row for result in results for row in _rows(result, labels)]
    schema = pyarrow.schema(
        [pyarrow.field(name, kinds[name]) for name in order],
        metadata={"idim_iv_ros": "idim_iv_ros/fleet-table/1"},
    )
    table = pyarrow.Table.from_pylist(rows, schema=schema)
    try:
        with complete_files([path]) as temporary:
            parquet.write_table(table, temporary[path])
    except OSError as error:
        raise UsageError(f"{path}: cannot be written: {error.strerror or error}") from error


def _rows(result: BagResult, labels: Sequence[str]) -> list[dict[str, Any]]:
    usable = result.status == "ok"
    common: dict[str, Any] = {
        "uri": result.uri,
        "robot": result.robot,
        "type": result.type,
        "time": _time(result.time),
        "status": result.status,
        "reason": result.reason or None,
        "duration": _number(result.duration),
        "rows": result.rows if usable else None,
        "estimator": result.estimator if usable else None,
        "verdict": result.verdict,
        "content": result.content or None,
    }
    common |= {f"label_{name}": result.labels.get(name) for name in labels}
    if not usable:
        return [common]
    given = result.given or (None,) * len(result.names)
    columns = zip(result.names, result.units, result.values, result.std, given, strict=True)
    return [
        common
        | {
            "parameter": name,
            "unit": unit,
            "value": _number(value),
            "std": _number(std),
            "given": _number(nominal),
        }
        for name, unit, value, std, nominal in columns
    ]


def _time(text: str | None) -> datetime | None:
    return None if text is None else datetime.fromisoformat(text.replace("Z", "+00:00"))


def _number(value: float | None) -> float | None:
    return value if value is not None and math.isfinite(value) else None
