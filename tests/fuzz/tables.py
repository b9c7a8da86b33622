"""Tables for `import` that are no tables, or of no use."""

import json
import struct
import zipfile
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from scipy.io import savemat

from tests.fuzz.case import Case, Good, flipped

_ROWS = 400
# What a map calls the columns of a file, where the case does not say it.
_COLUMNS = {".npy": "array[{}]", ".npz": "q[{}]", ".mat": "q[{}]"}
_RATE = {"rate": 100.0}


def cases(seed: int) -> Iterator[Case]:
    """Each table by a map; then stamps, and what a map may say wrong."""
    for name, write in {**_USELESS, **_ODD}.items():
        yield Case(f"table-{name}", partial(_with_table, write), name in _USELESS)
    for name, stamps in _STAMPS.items():
        build = partial(_with_stamps, stamps)
        yield Case(f"time-{name}", build, name not in ("text", "jump"))
    for number in range(6):
        yield Case(f"table-flipped-{number}", partial(_flipped, number))
    for name, options in _OPTIONS.items():
        build = partial(lambda options, folder, *_: table(folder, **options), options)
        yield Case(f"import-{name}", build, name not in ("long-joint", "surrogate-joint"))


def table(
    folder: Path,
    spec: str = "good.npy",
    *,
    time: dict[str, Any] = _RATE,
    joints: tuple[str, ...] = ("a", "b"),
    urdf: str | None = None,
) -> list[str]:
    """Arguments of `import` for a file ``FILE[:COLUMN,COLUMN]``, or ``FILE:ARRAY``, and its map."""
    random = np.random.default_rng(0)
    np.save(folder / "good.npy", random.normal(size=(_ROWS, 2)).cumsum(axis=0))
    file, _, key = spec.partition(":")
    usual = f"{key}[{{}}]" if key else _COLUMNS.get(Path(file).suffix, "{}")
    columns = key.split(",") if "," in key else [usual.format(k) for k in range(len(joints))]
    described = {joint: {"position": name} for joint, name in zip(joints, columns, strict=True)}
    text = json.dumps({"file": file, **time, "joints": described})
    (folder / "map.yaml").write_text(text, encoding="utf-8")
    arguments = ["import", str(folder / "o.mcap"), "--columns", str(folder / "map.yaml")]
    return arguments if urdf is None else [*arguments, "--urdf", str(folder / urdf)]


def _with_table(write: Callable[[Path], str], folder: Path, good: Good, _: object) -> list[str]:
    (folder / "t").mkdir()
    return table(folder, f"t/{write(folder / 't')}")


def _with_stamps(stamps: np.ndarray, folder: Path, good: Good, _: object) -> list[str]:
    np.savez(folder / "t.npz", q=_VALUES, t=stamps)
    return table(folder, "t.npz", time={"time": {"column": "t"}})


def _flipped(number: int, folder: Path, good: Good, random: np.random.Generator) -> list[str]:
    suffix, values = ("npz", "mat", "npy")[number % 3], random.normal(size=(_ROWS, 2))
    path = folder / _saved(suffix, {"q": values} if suffix == "npz" else values)(folder)
    content = path.read_bytes()
    path.write_bytes(flipped(content, random, 4, end=min(len(content), 300)))
    return table(folder, path.name)


def _saved(suffix: str, values: Any, key: str = "") -> Callable[[Path], str]:
    """Write an array, or of an .npz several, and name it for the command line."""

    def write(folder: Path) -> str:
        path = folder / f"t.{suffix}"
        if suffix == "npy":
            np.save(path, values, allow_pickle=True)
        elif suffix == "npz":
            np.savez_compressed(path, **values)
        else:
            savemat(path, {"q": values}, do_compression=True)
        return f"{path.name}{key}"

    return write


def _bytes(name: str, content: bytes) -> Callable[[Path], str]:
    def write(folder: Path) -> str:
        (folder / name.partition(":")[0]).write_bytes(content)
        return name

    return write


def _claimed(rows: int, kind: str = "<f8") -> bytes:
    """An .npy whose header promises more than there is."""
    header = f"{{'descr': '{kind}', 'fortran_order': False, 'shape': ({rows}, 2), }}"
    header = header.ljust(118) + "\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header.encode() + bytes(3200)


def _zip(*parts: bytes, name: str = "q.npy") -> Callable[[Path], str]:
    def write(folder: Path) -> str:
        with (
            zipfile.ZipFile(folder / "t.npz", "w", zipfile.ZIP_DEFLATED) as archive,
            archive.open(name, "w") as file,
        ):
            for part in parts:
                file.write(part)
        return "t.npz"

    return write


_VALUES = np.random.default_rng(3).normal(size=(_ROWS, 2)).cumsum(axis=0)
_RAGGED = np.array([np.zeros(2), np.zeros(3)] * 200, dtype=object)
_EIGHTH = np.arange(_ROWS)[:, None] == 7
GOOD_CSV = "q1,q2\n" + "".join(f"{a},{b}\n" for a, b in _VALUES)
_HDF = b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM" + b"\x00" * 384

_USELESS = {
    "text": _saved("npy", np.full((_ROWS, 2), "a")),
    "ragged": _saved("npy", _RAGGED),
    "complex": _saved("npy", _VALUES + 1j),
    "booleans": _saved("npy", _VALUES > 0),
    "dates": _saved("npy", np.zeros((_ROWS, 2), dtype="M8[s]")),
    "long-doubles": _saved("npy", _VALUES.astype(np.longdouble) * np.longdouble("1e4000")),
    "empty": _saved("npy", np.zeros((0, 2))),
    "one-row": _saved("npy", np.ones((1, 2))),
    "three-dimensions": _saved("npy", np.ones((_ROWS, 2, 2))),
    "other-length": _saved("npz", {"a": _VALUES[:-3, 0], "b": _VALUES[:, 0]}, ":a,b"),
    "nan": _saved("npy", np.where(_EIGHTH, np.nan, _VALUES)),
    "infinite": _saved("npy", np.where(_EIGHTH, np.inf, _VALUES)),
    "huge": _saved("npy", _VALUES * 1e300),
    "mat-text": _saved("mat", "text", ":q"),
    "mat-complex": _saved("mat", _VALUES + 1j, ":q"),
    "mat-struct": _saved("mat", {"a": {"b": _VALUES}}, ":q"),
    **{f"nothing.{suffix}": _bytes(f"t.{suffix}", b"") for suffix in ("npz", "mat", "csv")},
    **{f"junk.{suffix}": _bytes(f"t.{suffix}", b"junk" * 99) for suffix in ("npy", "npz", "mat")},
    "zip-of-text.npz": _zip(b"text", name="a.txt"),
    "zip-bomb.npz": _zip(_claimed(10**8)[:128], *[bytes(1 << 22)] * 20),
    "claims-1e12.npz": _zip(_claimed(10**12)),
    "claims-1e12.npy": _bytes("t.npy", _claimed(10**12)),
    "claims-1e18.npy": _bytes("t.npy", _claimed(10**18)),
    "pickle.npy": _bytes("t.npy", b"\x80\x04cos\nsystem\n(S'true'\ntR."),
    "header-without-end.npy": _bytes("t.npy", b"\x93NUMPY\x02\x00\xff\xff\xff\x7f{"),
    "header-nested.npy": _bytes("t.npy", b"\x93NUMPY\x01\x00\xff\xff" + b"(" * 65535),
    "csv-same-header": _bytes("t.csv:a,a", b"a,a\n" + b"1,2\n" * _ROWS),
    "csv-complex": _bytes("t.csv", b"1+2j,3\n" * _ROWS),
}
_ODD = {
    "structured": _saved("npy", np.zeros(_ROWS, dtype=[("q1", "f8"), ("q2", "f8")])),
    "many-dimensions": _saved("npy", np.ones((1,) * 30 + (2,))),
    "no-variable.npz": _saved("npz", {"a": _VALUES, "b": _VALUES}),
    "missing-variable.npz": _saved("npz", {"a": _VALUES, "b": _VALUES}, ":c"),
    "mat-cell": _saved("mat", _RAGGED, ":q"),
    "claims-text.npy": _bytes("t.npy", _claimed(4, "<U100000000")),
    "claims-negative.npy": _bytes("t.npy", _claimed(-5)),
    "v73.mat": _bytes("t.mat:q", _HDF + b"\x89HDF\r\n\x1a\n" + bytes(500)),
    "v4-junk.mat": _bytes("t.mat:q", struct.pack("<5i", 0, 2**30, 2**30, 0, 2) + b"q\0"),
    "no-suffix": _bytes("t", b"1,2\n" * 9),
    "csv-comma-decimals": _bytes("t.csv", b"a;b\n" + b"1,5;2,5\n" * _ROWS),
    "csv-utf-16": _bytes("t.csv", GOOD_CSV.encode("utf-16")),
    "csv-one-long-line": _bytes("t.csv", b"1," * 200_000),
    "csv-column-superscript": _bytes("t.csv:²,0", GOOD_CSV.encode()),
    "csv-column-huge": _bytes("t.csv:99999999999999999999,0", GOOD_CSV.encode()),
    "npy-key-out-of-range": _saved("npy", _VALUES, ":array[0],array[7]"),
}

_STEADY = np.arange(_ROWS) / 100.0
_STAMPS = {
    "backward": _STEADY[::-1],
    "constant": np.full(_ROWS, 3.0),
    "nan": np.where(_STEADY == 1.0, np.nan, _STEADY),
    "infinite": np.where(_STEADY[-1] == _STEADY, np.inf, _STEADY),
    "negative": _STEADY - 100.0,
    "huge": _STEADY * 1e300,
    "nanoseconds-since-1970": _STEADY * 1e9 + 1.7e18,
    "tiny": _STEADY * 1e-300,
    "below-a-nanosecond": _STEADY * 1e-9,
    "two-columns": np.column_stack([_STEADY, _STEADY]),
    "short": _STEADY[:-5],
    "complex": _STEADY + 1j,
    "text": _STEADY.astype("U20"),
    "jump": _STEADY + 1.7e9 * (_STEADY > 2.0),
}

_OPTIONS: dict[str, dict[str, Any]] = {
    **{
        f"rate-{rate}": {"time": {"rate": rate}}
        for rate in (0, -1, float("nan"), 1e-300, 1e300, "text")
    },
    "no-rate": {"time": {}},
    "empty-joint": {"joints": ("a", "")},
    "long-joint": {"joints": ("a" * 50_000, "b")},
    "surrogate-joint": {"joints": ("\udcff", "b")},
    "no-file": {"spec": "none.npy"},
    "urdf-missing": {"urdf": "none.urdf"},
    "urdf-not-text": {"urdf": "good.npy"},
}
