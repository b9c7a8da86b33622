"""Bags that are torn, flipped, or hold what no driver should send."""

import os
import shutil
import struct
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from mcap.writer import CompressionType

from tests.fuzz import messages, texts
from tests.fuzz.case import CONFIG, JOINTS, Case, Good, command, write_configuration
from tests.fuzz.messages import REFERENCE, STATE_TYPE, STATES, Raw, State

_COMMANDS = ("check", "check", "init", "check", "check", "check", "identify", "check")


def cases(seed: int) -> Iterator[Case]:
    """Damaged bytes first, then damaged contents."""
    for number in range(12):
        storage = ("mcap", "db3")[number % 4 == 3]
        yield Case(f"torn-{storage}-{number}", partial(_torn, storage))
    yield Case("torn-and-three-gigabytes-of-nothing", _sparse)
    for storage in ("mcap", "lz4", "db3"):
        for part in ("head", "tail", "anywhere", *(["lengths"] if storage != "db3" else [])):
            for number in range(3):
                yield Case(f"flipped-{storage}-{part}-{number}", partial(_flipped, storage, part))
    yield from _databases()
    for number, (name, change) in enumerate({**_CONTENTS, **_STAMPS, **_VALUES}.items()):
        what = _COMMANDS[number % len(_COMMANDS)]
        yield Case(f"content-{name}", partial(_with_content, change, what))
        if name in ("huge-efforts", "tiny-efforts", "one-spike"):
            yield Case(f"diagnose-{name}", partial(_with_content, change, "diagnose"))
    yield from _schemas()
    yield from _folders()


def _torn(storage: str, folder: Path, good: Good, random: np.random.Generator) -> list[str]:
    content = _content(folder, good, storage)
    share = random.choice([random.uniform(), random.uniform(0.9, 1.0), 1e-3])
    path = folder / f"torn.{storage}"
    path.write_bytes(content[: int(share * len(content))])
    return command(_COMMANDS[int(random.integers(8))], folder, [path])


def _sparse(folder: Path, good: Good, _: object) -> list[str]:
    path = folder / "sparse.mcap"
    path.write_bytes(good.bag.read_bytes()[: good.bag.stat().st_size // 2])
    os.truncate(path, 3 << 30)
    return command("check", folder, [path])


def _flipped(
    storage: str, part: str, folder: Path, good: Good, random: np.random.Generator
) -> list[str]:
    """Bits of one part of the file; ``lengths`` are those of the records of MCAP."""
    content = bytearray(_content(folder, good, storage))
    head, tail = range(4096), range(len(content) - 4096, len(content))
    places = {"head": head, "tail": tail, "anywhere": range(len(content))}.get(part)
    for place in random.choice(places or _lengths(content), 8):
        content[place] ^= 1 << int(random.integers(8))
    path = folder / f"flipped.{storage.replace('lz4', 'mcap')}"
    path.write_bytes(content)
    return command(_COMMANDS[int(random.integers(8))], folder, [path])


def _lengths(content: bytes) -> list[int]:
    places, place, mark = [], 8, 8
    while place + 9 <= len(content) - mark:
        places += range(place + 1, place + 9)
        place += 9 + struct.unpack_from("<Q", content, place + 1)[0]
    return places


def _written(folder: Path, raw: Sequence[Raw], **options: Any) -> Path:
    return messages.write_mcap(folder / "bag.mcap", raw, **options)


def _content(folder: Path, good: Good, storage: str) -> bytes:
    if storage == "mcap":
        return good.bag.read_bytes()
    raw = messages.raw(messages.states(good))
    if storage == "lz4":
        path = _written(folder, raw, compression=CompressionType.LZ4)
    else:
        path = messages.write_db3(folder / "whole.db3", raw)
    content = path.read_bytes()
    path.unlink()
    return content


_CELLS = ("NULL", "'text'", "9223372036854775807", "x'00'", "zeroblob(2000000)")
_SQL = {
    "recursive-view": (
        "DROP TABLE messages",
        "CREATE VIEW messages AS WITH RECURSIVE n(x) AS (SELECT 1 UNION ALL SELECT x + 1 FROM n) "
        "SELECT x AS id, 1 AS topic_id, x AS timestamp, zeroblob(100) AS data FROM n",
    ),
    "generated-column": (
        "ALTER TABLE messages RENAME TO old",
        "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, "
        "raw BLOB, data BLOB AS (zeroblob(100000000)))",
        "INSERT INTO messages(topic_id, timestamp, raw) SELECT topic_id, timestamp, data FROM old",
    ),
    "no-topics": ("DROP TABLE topics",),
    "no-rows": ("DELETE FROM messages",),
    "no-column": ("ALTER TABLE messages RENAME COLUMN data TO payload",),
    "unknown-topic": ("UPDATE messages SET topic_id = 77",),
    "same-topic-twice": ("INSERT INTO topics SELECT id + 10, name, type, 'cdr', '' FROM topics",),
}  # fmt: skip


def _databases() -> Iterator[Case]:
    for column in ("timestamp", "data", "topic_id"):
        for number, cell in enumerate(_CELLS):
            where = ("", "WHERE id % 50 = 7", "WHERE id < 20")[2 if "zero" in cell else number % 2]
            statement = f"UPDATE messages SET {column} = {cell} {where}"
            name = f"db3-{column}-{cell.strip(chr(39))[:8]}"
            yield Case(name, partial(_database, (statement,)))
    for name, statements in _SQL.items():
        yield Case(f"db3-{name}", partial(_database, statements))


def _database(statements: tuple[str, ...], folder: Path, good: Good, _: object) -> list[str]:
    raw = messages.raw(messages.states(good))
    return command("check", folder, [messages.write_db3(folder / "b.db3", raw, *statements)])


Change = Callable[[list[State], np.random.Generator], list[State]]


def _with_content(
    change: Change, what: str, folder: Path, good: Good, random: np.random.Generator
) -> list[str]:
    changed = change(messages.states(good), random)
    return command(what, folder, [_written(folder, messages.raw(changed))])


def _every_state(change: Callable[[State, int, np.random.Generator], object]) -> Change:
    """Change every message in its place; the function gets its number."""

    def apply(all_states: list[State], random: np.random.Generator) -> list[State]:
        for number, state in enumerate(all_states):
            change(state, number, random)
        return all_states

    return apply


def _set(**values: object) -> Change:
    return _every_state(lambda state, _, __: [setattr(state, k, v) for k, v in values.items()])


def _sometimes(change: Callable[[State, np.random.Generator], object]) -> Change:
    return _every_state(lambda s, _, random: change(s, random) if random.uniform() < 0.1 else None)


def _swap(state: State, random: np.random.Generator) -> None:
    state.names = state.names[::-1]
    state.position = state.position[::-1]
    state.effort = state.effort[::-1]


_CONTENTS: dict[str, Change] = {
    "permuted": _sometimes(_swap),
    "doubled-name": _set(names=("joint_1", "joint_1")),
    "third-joint": _every_state(
        lambda s, _, __: [setattr(s, "names", (*JOINTS, "joint_1")),
                          setattr(s, "position", np.append(s.position, 1.0)),
                          setattr(s, "effort", np.append(s.effort, 1.0)) if len(s.effort) else 0]
    ),
    "no-names": _set(names=()),
    "markup-names": _set(names=("[bold]joint_1", "[/]")),
    "many-names": _set(names=tuple(f"joint_{k}" for k in range(300))),
    "short-effort": _sometimes(lambda s, _: setattr(s, "effort", s.effort[:1])),
    "empty-messages": _set(names=(), position=np.zeros(0), effort=np.zeros(0)),
    "no-reference": lambda states, _: [s for s in states if s.topic == STATES],
    "reference-alone": lambda states, _: [s for s in states if s.topic == REFERENCE],
    "one-message": lambda states, _: states[:2],
    "no-messages": lambda states, _: [],
}  # fmt: skip


def _stamps(function: Callable[[float, int], float]) -> Change:
    return _every_state(lambda s, number, _: setattr(s, "stamp", function(s.stamp, number)))


_STAMPS: dict[str, Change] = {
    "same-stamp-everywhere": _every_state(lambda s, _, __: [setattr(s, "stamp", 7.0),
                                                      setattr(s, "arrival", 7.0)]),
    "backward": _stamps(lambda t, k: 10.0 - t),
    "one-far-ahead": _stamps(lambda t, k: 2e9 if k == 300 else t),
    "simulated-then-epoch": _stamps(lambda t, k: t + 1.7e9 * (k > 800)),
    "hole-of-a-day": _stamps(lambda t, k: t + 86_400.0 * (k > 800)),
    "negative": _stamps(lambda t, k: t - 100.0),
    "a-day-apart": _stamps(lambda t, k: 86_400.0 * (k // 2)),
    "reference-a-year-ago": _every_state(
        lambda s, _, __: setattr(s, "stamp", s.stamp - 3e7 * (s.topic == REFERENCE) + 4e7)
    ),
    "arrival-huge": _every_state(lambda s, k, __: setattr(s, "arrival", 9.2e9)),
    "shuffled": lambda states, random: [states[k] for k in random.permutation(len(states))],
    "every-message-twice": lambda states, _: [s for s in states for _ in range(2)],
}  # fmt: skip


def _values(position: Callable | None = None, effort: Callable | None = None) -> Change:
    def change(state: State, number: int, random: np.random.Generator) -> None:
        if position is not None:
            state.position = np.asarray(position(state.position, number), dtype=float)
        if effort is not None and len(state.effort):
            state.effort = np.asarray(effort(state.effort, number), dtype=float)

    return _every_state(change)


_VALUES: dict[str, Change] = {
    "huge-efforts": _values(effort=lambda v, k: v * 1e300),
    "tiny-efforts": _values(effort=lambda v, k: v * 1e-300),
    "huge-positions": _values(lambda v, k: v * 1e300),
    "infinite-positions": _values(lambda v, k: v * np.inf),
    "one-spike": _values(lambda v, k: v + 1e9 * (k == 500)),
    "nan-now-and-then": _values(lambda v, k: v * (np.nan if k % 7 == 0 else 1.0)),
    "mostly-nan": _values(effort=lambda v, k: v * (1.0 if k % 200 == 0 else np.nan)),
    "constant": _values(lambda v, k: 0.0 * v + 0.3),
    "wrap": _values(lambda v, k: (3.0 * v + np.pi) % (2 * np.pi) - np.pi),
    "same-joints": _values(lambda v, k: v[[0, 0]], lambda v, k: v[[0, 0]]),
}  # fmt: skip

_SCHEMAS = {
    "other-type": ("std_msgs/msg/String", "ros2msg", b"string data"),
    "other-definition": (STATE_TYPE, "ros2msg", b"float32 a\nint8[] b"),
    "no-definition": (STATE_TYPE, "ros2msg", b""),
    "idl": (STATE_TYPE, "ros2idl", b"module a { };"),
    "ros1-type": ("sensor_msgs/JointState", "ros1msg", b""),
    "unknown-type": ("[red]x/msg/Y", "ros2msg", b"int8 a"),
    "no-schema": ("", "", b""),
}


def _schemas() -> Iterator[Case]:
    for name, schema in _SCHEMAS.items():
        yield Case(f"schema-{name}", partial(_declared, {"schema": schema}))
    yield Case("encoding-json", partial(_declared, {"encoding": "json"}))
    for name, change in _PAYLOADS.items():
        yield Case(f"payload-{name}", partial(_with_payloads, change))
    whole = (CONFIG / "arm2.urdf").read_text()
    descriptions = {"bomb": texts.bomb("abcdefghi"), "empty": "", "half": whole[:900]}
    for name, text in descriptions.items():
        yield Case(f"description-{name}", partial(_described, text), refused=name == "half")


def _declared(options: dict[str, Any], folder: Path, good: Good, _: object) -> list[str]:
    """Good messages in a bag that says another thing of them."""
    raw = messages.raw(messages.states(good))
    return command("check", folder, [_written(folder, raw, **options)])


def _with_payloads(
    change: Callable[[bytes, int], bytes], folder: Path, good: Good, _: object
) -> list[str]:
    raw = [
        replace(message, payload=change(message.payload, number))
        for number, message in enumerate(messages.raw(messages.states(good)))
    ]
    return command("check", folder, [_written(folder, raw)])


_PAYLOADS: dict[str, Callable[[bytes, int], bytes]] = {
    "empty": lambda data, k: b"",
    "big-endian": lambda data, k: b"\x00\x00\x00\x00" + data[4:],
    "claims-4e9-names": lambda data, k: data[:20] + b"\xff\xff\xff\xff" + data[24:],
    "now-and-then-half": lambda data, k: data[: len(data) // (1 + (k % 9 == 0))],
    "noise": lambda data, k: np.random.default_rng(k).bytes(len(data)),
    "names-not-text": lambda data, k: data.replace(b"joint_1", b"\xff\xfe\x00\xc3\x28\xf0\x9f"),
    "with-a-tail": lambda data, k: data + bytes(1000 * (k % 3)),
}


def _described(text: str, folder: Path, good: Good, _: object) -> list[str]:
    """A bag whose /robot_description is the only URDF there is."""
    raw = [messages.text_message(text), *messages.raw(messages.states(good))]
    return command("check", folder, [_written(folder, raw)], write_configuration(folder, urdf=None))


_METADATA = {
    "empty": "",
    "not-yaml": "rosbag2_bagfile_information: [",
    "nested": "[" * 5000,
    "paths-as-number": "rosbag2_bagfile_information: {relative_file_paths: 3, files: [4]}",
    "path-outside": "rosbag2_bagfile_information: {relative_file_paths: [../../../etc/passwd]}",
    "missing-file": "rosbag2_bagfile_information: {relative_file_paths: [none.mcap]}",
    "compressed": (
        "rosbag2_bagfile_information: {compression_format: zstd, compression_mode: file, "
        "relative_file_paths: [b.mcap.zstd]}"
    ),
    "dates": "2020-01-01: 2020-01-02\nrosbag2_bagfile_information: 2020-01-01",
}


def _folders() -> Iterator[Case]:
    for name, text in _METADATA.items():
        yield Case(f"metadata-{name}", partial(_with_metadata, text))
    yield Case("folder-empty", partial(_folder, ()), refused=True)
    yield Case("folder-of-both-kinds", partial(_folder, ("b.mcap", "b.db3")))
    yield Case("folder-of-pieces", partial(_folder, tuple(f"b_{k}.mcap" for k in range(40))))
    yield Case("same-bag-twice", lambda folder, good, _: command("identify", folder,
               [good.bag, good.bag]), refused=True)  # fmt: skip


def _with_metadata(text: str, folder: Path, good: Good, _: object) -> list[str]:
    bag = folder / "bag"
    (bag / "sub").mkdir(parents=True)
    shutil.copy(good.bag, bag / "b.mcap")
    (bag / "metadata.yaml").write_bytes(text.encode("utf-8", "surrogateescape"))
    return command("check", folder, [bag])


def _folder(names: Sequence[str], folder: Path, good: Good, _: object) -> list[str]:
    """A folder of these files; what is numbered is a piece of the bag."""
    bag = folder / "bag"
    bag.mkdir()
    for number, name in enumerate(names):
        if name.endswith(".db3"):
            messages.write_db3(bag / name, messages.raw(messages.states(good)))
        else:
            content = good.bag.read_bytes()
            (bag / name).write_bytes(content[: 500 * number] if "_" in name else content)
    return command("check", folder, [bag])
