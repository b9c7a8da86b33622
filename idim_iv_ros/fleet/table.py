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
==============  ====================================================================================
"""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from idim_iv_ros.files import complete_files, refused_if_unwritable
from idim_iv_ros.fleet.result import BagResult
from idim_iv_ros.fleet.source import time_of

FILE = "fleet.parquet"
_COLUMNS = (
    *("uri", "robot", "type", "time", "status", "reason", "duration", "rows", "estimator"),
    *("verdict", "parameter", "unit", "value", "std", "given", "content"),
)


def write_table(results: Sequence[BagResult], path: Path) -> None:
    """Write fleet.parquet atomically.

    Raises UsageError: it cannot be written, and why.
    """
    import pyarrow
    from pyarrow import parquet

    kinds = dict.fromkeys(("duration", "value", "std", "given"), pyarrow.float64())
    kinds |= {"time": pyarrow.timestamp("us", tz="UTC"), "rows": pyarrow.int64()}
    schema = pyarrow.schema(
        [pyarrow.field(name, kinds.get(name, pyarrow.string())) for name in _COLUMNS],
        metadata={"idim_iv_ros": "idim_iv_ros/fleet-table/1"},
    )
    rows = [row for result in results for row in _rows(result)]
    table = pyarrow.Table.from_pylist(rows, schema=schema)
    with refused_if_unwritable(path), complete_files([path]) as temporary:
        parquet.write_table(table, temporary[path])


def _rows(result: BagResult) -> list[dict[str, Any]]:
    """Return the rows of one bag, one a parameter; missing values are null."""
    common: dict[str, Any] = {
        name: getattr(result, name)
        for name in ("uri", "robot", "type", "status", "duration", "verdict")
    }
    common |= {name: getattr(result, name) or None for name in ("reason", "content")}
    common |= {"time": time_of(result.time) if result.time is not None else None}
    rows = [common]
    if result.status == "ok":
        common |= {"rows": result.rows, "estimator": result.estimator}
        given = result.given or (None,) * len(result.names)
        columns = zip(result.names, result.units, result.values, result.std, given, strict=True)
        names = ("parameter", "unit", "value", "std", "given")
        rows = [common | dict(zip(names, column, strict=True)) for column in columns]
    return [
        {
            name: None if isinstance(value, float) and not math.isfinite(value) else value
            for name, value in row.items()
        }
        for row in rows
    ]
