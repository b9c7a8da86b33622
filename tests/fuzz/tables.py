"""Tables for `import` that are no tables, or of no use."""

import struct
import zipfile
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import numpy as np
from scipy.io import savemat

from tests.fuzz.case import Case, Good, flipped

_ROWS = 400
_COMPLETE = {"position": "good.npy", "effort": "good.npy", "joints": "a,b", "rate": "100"}


def cases(seed: int) -> Iterator[Case]:
    """Each table once as positions, efforts or references; then stamps, rates and names."""
    for number, (name, write) in enumerate({**_ARRAYS, **_FILES, **_CSV}.items()):
        place = ("position", "effort", "reference")[(number + seed) % 3]
        yield Case(f"table-{name}", partial(_with_table, write, place), name in _USELESS)
    for name, write in _STAMPS.items():
        yield Case(f"time-{name}", partial(_with_table, write, "time"), name in _USELESS_STAMPS)
    for number in range(6):
        yield Case(f"table-flipped-{number}", partial(_flipped, number))
    for name, (options, refused) in _OPTIONS.items():
        build = partial(lambda options, folder, *_: _import(folder, **options), options)
        yield Case(f"import-{name}", build, refused)


def _import(folder: Path, **options: str | None) -> list[str]:
    random = np.random.default_rng(0)
    np.save(folder / "good.npy", random.normal(size=(_ROWS, 2)).cumsum(axis=0))
    arguments = ["import", str(folder / "o.mcap")]
    for name, value in {**_COMPLETE, **options}.items():
        if value is not None:
            value = value if name in ("rate", "joints") else str(folder / value)
            arguments += [f"--{name.replace('_', '-')}", value]
    return arguments


def _with_table(
    write: Callable[[Path], str], place: str, folder: Path, good: Good, _: object
) -> list[str]:
    (folder / "t").mkdir()
    spec = f"t/{write(folder / 't')}"
    return _import(folder, **{place: spec}, **({"rate": None} if place == "time" else {}))


def _flipped(number: int, folder: Path, good: Good, random: np.random.Generator) -> list[str]:
    values = {"q": random.normal(size=(_ROWS, 2))}
    suffix = ("npz", "mat", "npy")[number % 3]
    path = folder / f"t.{suffix}"
    if suffix == "npz":
        np.savez_compressed(path, **values)
    elif suffix == "mat":
        savemat(path, values, do_compression=number > 2)
    else:
        np.save(path, values["q"])
    content = path.read_bytes()
    path.write_bytes(flipped(content, random, 4, end=min(len(content), 300)))
    return _import(folder, position=path.name)


def _npy(values: object) -> Callable[[Path], str]:
    def write(folder: Path) -> str:
        np.save(folder / "t.npy", values, allow_pickle=True)
        return "t.npy"

    return write


def _mat(values: object) -> Callable[[Path], str]:
    def write(folder: Path) -> str:
        savemat(folder / "t.mat", {"q": values})
        return "t.mat:q"

    return write


def _npz(**variables: object) -> Callable[[Path], str]:
    def write(folder: Path) -> str:
        np.savez(folder / "t.npz", **variables)
        return "t.npz"

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


def _zip_bomb(folder: Path) -> str:
    with (
        zipfile.ZipFile(folder / "t.npz", "w", zipfile.ZIP_DEFLATED) as archive,
        archive.open("q.npy", "w") as file,
    ):
        file.write(_claimed(10**8)[:128])
        for _ in range(20):
            file.write(bytes(1 << 22))
    return "t.npz"


_RANDOM = np.random.default_rng(3)
_VALUES = _RANDOM.normal(size=(_ROWS, 2)).cumsum(axis=0)
_RAGGED = np.array([np.zeros(2), np.zeros(3)] * 200, dtype=object)
_STRUCTURED = np.zeros(_ROWS, dtype=[("q1", "f8"), ("q2", "f8")])

_ARRAYS = {
    "text": _npy(np.full((_ROWS, 2), "a")),
    "numbers-as-text": _npy(_VALUES.astype("U32")),
    "bytes": _npy(np.full((_ROWS, 2), b"x")),
    "objects": _npy(np.full((_ROWS, 2), None, dtype=object)),
    "ragged": _npy(_RAGGED),
    "complex": _npy(_VALUES + 1j),
    "complex-of-reals": _npy(_VALUES.astype(complex)),
    "structured": _npy(_STRUCTURED),
    "booleans": _npy(_VALUES > 0),
    "integers": _npy(np.arange(2 * _ROWS).reshape(-1, 2)),
    "unsigned": _npy(np.full((_ROWS, 2), 2**64 - 1, dtype=np.uint64)),
    "dates": _npy(np.zeros((_ROWS, 2), dtype="M8[s]")),
    "half-floats": _npy(_VALUES.astype(np.float16)),
    "long-doubles": _npy(_VALUES.astype(np.longdouble) * np.longdouble("1e4000")),
    "big-endian": _npy(_VALUES.astype(">f8")),
    "empty": _npy(np.zeros((0, 2))),
    "no-columns": _npy(np.zeros((_ROWS, 0))),
    "scalar": _npy(np.float64(3.0)),
    "one-row": _npy(np.ones((1, 2))),
    "two-rows": _npy(np.ones((2, 2))),
    "one-column": _npy(_VALUES[:, 0]),
    "three-columns": _npy(np.ones((_ROWS, 3))),
    "three-dimensions": _npy(np.ones((_ROWS, 2, 2))),
    "many-dimensions": _npy(np.ones((1,) * 30 + (2,))),
    "other-length": _npy(np.ones((_ROWS - 3, 2))),
    "nan": _npy(np.where(np.arange(_ROWS)[:, None] == 7, np.nan, _VALUES)),
    "infinite": _npy(np.where(np.arange(_ROWS)[:, None] == 7, np.inf, _VALUES)),
    "all-nan": _npy(np.full((_ROWS, 2), np.nan)),
    "huge": _npy(_VALUES * 1e300),
    "degrees-in-millions": _npy(_VALUES * 1e7),
    "masked": _npz(q=_VALUES, mask=np.ones((_ROWS, 2))),
    "mat-text": _mat("text"),
    "mat-complex": _mat(_VALUES + 1j),
    "mat-struct": _mat({"a": {"b": _VALUES}}),
    "mat-cell": _mat(_RAGGED),
    "mat-sparse": _mat(np.eye(3)),
    "mat-empty": _mat(np.zeros((0, 0))),
}
_HDF = b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM" + b"\x00" * 384
_FILES = {
    "nothing.npy": _bytes("t.npy", b""),
    "nothing.npz": _bytes("t.npz", b""),
    "nothing.mat": _bytes("t.mat", b""),
    "nothing.csv": _bytes("t.csv", b""),
    "junk.npy": _bytes("t.npy", b"junk" * 99),
    "junk.npz": _bytes("t.npz", b"junk" * 99),
    "junk.mat": _bytes("t.mat", b"junk" * 99),
    "zip-start.npz": _bytes("t.npz", b"PK\x03\x04" + b"junk" * 99),
    "zip-of-text.npz": lambda folder: _zip(folder, "a.txt", b"text"),
    "zip-of-junk.npz": lambda folder: _zip(folder, "q.npy", b"junk"),
    "zip-bomb.npz": _zip_bomb,
    "claims-1e12.npz": lambda folder: _zip(folder, "q.npy", _claimed(10**12)),
    "pickle.npy": _bytes("t.npy", b"\x80\x04cos\nsystem\n(S'true'\ntR."),
    "claims-1e12.npy": _bytes("t.npy", _claimed(10**12)),
    "claims-1e18.npy": _bytes("t.npy", _claimed(10**18)),
    "claims-more.npy": _bytes("t.npy", _claimed(10**4)),
    "claims-negative.npy": _bytes("t.npy", _claimed(-5)),
    "claims-other-type.npy": _bytes("t.npy", _claimed(200, "<q9")),
    "claims-text.npy": _bytes("t.npy", _claimed(4, "<U100000000")),
    "header-without-end.npy": _bytes("t.npy", b"\x93NUMPY\x02\x00\xff\xff\xff\x7f{"),
    "header-code.npy": _bytes("t.npy", b"\x93NUMPY\x01\x00\x10\x00" + b"__import__('os')"),
    "header-nested.npy": _bytes("t.npy", b"\x93NUMPY\x01\x00\xff\xff" + b"(" * 65535),
    "v73.mat": _bytes("t.mat:q", _HDF + b"\x89HDF\r\n\x1a\n" + bytes(500)),
    "v4-junk.mat": _bytes("t.mat:q", struct.pack("<5i", 0, 2**30, 2**30, 0, 2) + b"q\0"),
    "missing-variable.npz": lambda folder: _npz(a=_VALUES, b=_VALUES)(folder) + ":c",
    "no-variable.npz": _npz(a=_VALUES, b=_VALUES),
    "other-suffix": _bytes("t.txt", b"1,2\n" * 9),
    "no-suffix": _bytes("t", b"1,2\n" * 9),
}
_GOOD_CSV = "".join(f"{a},{b}\n" for a, b in _VALUES)
_CSV = {
    "csv-text": _bytes("t.csv", b"a,b\n" + b"x,y\n" * _ROWS),
    "csv-ragged": _bytes("t.csv", b"a,b\n" + b"1,2\n1,2,3\n1\n" * 130),
    "csv-nan": _bytes("t.csv", b"a,b\n" + b"1,nan\n" * _ROWS),
    "csv-infinite": _bytes("t.csv", b"a,b\n" + b"1,inf\n" * _ROWS),
    "csv-overflow": _bytes("t.csv", b"a,b\n" + b"1,1e999\n" * _ROWS),
    "csv-empty-cells": _bytes("t.csv", b"a,b\n" + b"1,\n" * _ROWS),
    "csv-header-alone": _bytes("t.csv", b"a,b\n"),
    "csv-same-header": _bytes("t.csv:a,a", b"a,a\n" + b"1,2\n" * _ROWS),
    "csv-comma-decimals": _bytes("t.csv", b"a;b\n" + b"1,5;2,5\n" * _ROWS),
    "csv-tabs": _bytes("t.csv", b"1\t2\n" * _ROWS),
    "csv-spaces": _bytes("t.csv", b"1 2\n" * _ROWS),
    "csv-quotes": _bytes("t.csv", b'"a","b"\n' + b'"1","2"\n' * _ROWS),
    "csv-open-quote": _bytes("t.csv", b'"a,b\n' + b"1,2\n" * _ROWS),
    "csv-comment": _bytes("t.csv", b"# note\n" + _GOOD_CSV.encode()),
    "csv-complex": _bytes("t.csv", b"1+2j,3\n" * _ROWS),
    "csv-hexadecimal": _bytes("t.csv", b"0x1,0x2\n" * _ROWS),
    "csv-dates": _bytes("t.csv", b"2020-01-01,1\n" * _ROWS),
    "csv-zeros": _bytes("t.csv", bytes(2000)),
    "csv-utf-16": _bytes("t.csv", _GOOD_CSV.encode("utf-16")),
    "csv-latin": _bytes("t.csv", b"q\xe9,b\n" + _GOOD_CSV.encode()),
    "csv-old-line-ends": _bytes("t.csv", _GOOD_CSV.replace("\n", "\r").encode()),
    "csv-one-long-line": _bytes("t.csv", b"1," * 200_000),
    "csv-blank-lines": _bytes("t.csv", b"\n" * 5000),
    "csv-column-minus-one": _bytes("t.csv:-1,0", _GOOD_CSV.encode()),
    "csv-column-superscript": _bytes("t.csv:²,0", _GOOD_CSV.encode()),
    "csv-column-huge": _bytes("t.csv:99999999999999999999,0", _GOOD_CSV.encode()),
    "csv-no-key": _bytes("t.csv:", _GOOD_CSV.encode()),
    "npy-text-key": lambda folder: _npy(_VALUES)(folder) + ":q",
    "npy-key-out-of-range": lambda folder: _npy(_VALUES)(folder) + ":0,7",
    "npy-key-of-vector": lambda folder: _npy(_VALUES[:, 0])(folder) + ":0,1",
}
_USELESS = {
    "text", "bytes", "objects", "ragged", "complex", "nan", "infinite", "all-nan", "empty",
    "one-row", "scalar", "three-columns", "three-dimensions", "other-length", "mat-text",
    "mat-complex", "mat-struct", "mat-empty", "csv-text", "csv-ragged", "csv-nan", "csv-infinite",
    "csv-overflow", "csv-empty-cells", "csv-header-alone", "csv-complex", "csv-dates",
    "claims-1e12.npy", "claims-1e12.npz", "claims-1e18.npy", "dates", "long-doubles", "booleans",
    "huge", "csv-same-header",
    *(name for name in _FILES if name.startswith(("nothing", "junk", "zip", "pickle", "header"))),
}  # fmt: skip


def _zip(folder: Path, name: str, content: bytes) -> str:
    with zipfile.ZipFile(folder / "t.npz", "w") as archive:
        archive.writestr(name, content)
    return "t.npz"


_STEADY = np.arange(_ROWS) / 100.0
_STAMPS = {
    "backward": _npy(_STEADY[::-1]),
    "constant": _npy(np.full(_ROWS, 3.0)),
    "nan": _npy(np.where(_STEADY == 1.0, np.nan, _STEADY)),
    "infinite": _npy(np.where(_STEADY[-1] == _STEADY, np.inf, _STEADY)),
    "negative": _npy(_STEADY - 100.0),
    "huge": _npy(_STEADY * 1e300),
    "beyond-ros": _npy(_STEADY + 1e10),
    "milliseconds-since-1970": _npy(_STEADY * 1e3 + 1.7e12),
    "nanoseconds-since-1970": _npy(_STEADY * 1e9 + 1.7e18),
    "tiny": _npy(_STEADY * 1e-300),
    "below-a-nanosecond": _npy(_STEADY * 1e-9),
    "two-columns": _npy(np.column_stack([_STEADY, _STEADY])),
    "short": _npy(_STEADY[:-5]),
    "complex": _npy(_STEADY + 1j),
    "text": _npy(_STEADY.astype("U20")),
    "jump": _npy(_STEADY + 1.7e9 * (_STEADY > 2.0)),
}
_USELESS_STAMPS = {
    "backward", "constant", "nan", "infinite", "negative", "huge", "beyond-ros", "tiny",
    "two-columns", "short", "complex", "below-a-nanosecond", "milliseconds-since-1970",
    "nanoseconds-since-1970",
}  # fmt: skip

_OPTIONS: dict[str, tuple[dict[str, str | None], bool]] = {
    **{
        f"rate-{rate}": ({"rate": rate}, True)
        for rate in ("0", "-1", "nan", "inf", "1e-300", "1e300", "1e-9", "1e12", "text", "")
    },
    "no-rate": ({"rate": None}, True),
    "same-joints": ({"joints": "a,a"}, True),
    "one-joint": ({"joints": "a"}, True),
    "no-joints": ({"joints": ""}, True),
    "empty-joint": ({"joints": "a,"}, True),
    "markup-joints": ({"joints": "[bold]a,[/]"}, False),
    "line-break-in-joint": ({"joints": "a\nb,c"}, False),
    "long-joint": ({"joints": "a" * 100_000 + ",b"}, False),
    "surrogate-joint": ({"joints": "\udcff,b"}, False),
    "no-file": ({"position": "none.npy"}, True),
    "folder": ({"position": "."}, True),
    "velocity-missing": ({"velocity": "none.npy"}, True),
    "reference-time-alone": ({"reference_time": "good.npy"}, True),
    "urdf-missing": ({"urdf": "none.urdf"}, True),
    "urdf-a-folder": ({"urdf": "."}, True),
    "urdf-not-text": ({"urdf": "good.npy"}, True),
}
