"""A bag is an MCAP or .db3 file, or a folder with any number of them."""

import os
import shutil
import tempfile
from collections import Counter, deque
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import zstandard
from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError

from idim_iv_ros.errors import DataError, UsageError
from idim_iv_ros.files import NO_FILE, FilePaths, as_paths, is_file, is_there
from idim_iv_ros.interruption import undone_if_interrupted
from idim_iv_ros.recording.bags.bag_file import BagFile, ByteSource, LocalFile, MessageBatch, opened
from idim_iv_ros.recording.bags.joint_message_type import SchemaText, note_type
from idim_iv_ros.recording.bags.mcap import McapFile
from idim_iv_ros.recording.bags.sqlite import SqliteFile
from idim_iv_ros.recording.recording import Note

SUFFIXES = (".mcap", ".db3", ".mcap.zstd", ".db3.zstd")  # in small letters

_LONGEST_METADATA = 1 << 24  # bytes


@dataclass
class Bag:
    """One recording on disk or in a remote store; can be given wherever a path of a bag can."""

    path: Path  # by the user; for a remote bag its name, for messages
    # Files of a remote bag by name, in the order of recording.
    sources: Mapping[Path, ByteSource] = field(default_factory=dict)
    topics: dict[str, str] = field(default_factory=dict)  # type of each; all once the bag was read
    definitions: dict[str, SchemaText] = field(default_factory=dict)  # of types, if the bag has it
    damages: list[str] = field(default_factory=list)  # what is wrong with which file
    seen: Counter[str] = field(default_factory=Counter)  # messages read of each wanted topic
    missing: Counter[str] = field(default_factory=Counter)  # those that are known to be lost
    counted: bool = True  # whether `missing` is complete

    def __fspath__(self) -> str:
        return str(self.path)

    def unread(self) -> "Bag":
        """Return a copy of this bag that was not read yet."""
        return Bag(self.path, self.sources)

    def batches(self, wanted: set[str]) -> Iterator[tuple[str, MessageBatch]]:
        """Yield topic and raw messages of the wanted topics, file by file.

        Raises UsageError: no such file or folder. DataError: not a bag.
        """
        with ExitStack() as stack:
            for path in list(self.sources) or bag_files(self.path):
                file = self._file(path, stack)
                for topic, batch in file.batches(wanted):
                    self._add_types(file)
                    self.seen[topic] += len(batch)
                    yield topic, batch
                self._add_types(file)
                self.missing.update(file.missing)
                self.counted &= file.counted
                name = "the file" if path == self.path else path.name
                if file.truncated:
                    self.damages.append(f"{name} ends in the middle")
                if file.damaged:
                    places = "1 place" if file.damaged == 1 else f"{file.damaged} places"
                    self.damages.append(f"{name} is damaged in {places}")
        counts = {} if self.counted else _counts(self.path)
        if all(counts.get(topic, 0) >= seen for topic, seen in self.seen.items()):
            missing = {t: count - self.seen[t] for t, count in counts.items() if t in wanted}
            if missing:
                self.missing, self.counted = Counter(missing), True

    def topic_types(self) -> dict[str, str]:
        """Return the type of each topic; an MCAP file without a summary is read to its end.

        Raises UsageError: no such file or folder. DataError: not a bag.
        """
        bag = self.unread()
        deque(bag.batches(set()), maxlen=0)
        return bag.topics

    def _add_types(self, file: BagFile) -> None:
        for topic, kind in file.topics.items():
            note_type(self.topics, topic, kind)
        self.definitions.update(file.definitions)

    def _file(self, path: Path, stack: ExitStack) -> BagFile:
        source = self.sources.get(path)
        if source is not None and path.suffix.lower() != ".mcap":
            # A database, or compressed as a whole: it cannot be read in parts.
            path = _temporary(stack) / path.name
            with opened(source) as content, path.open("wb") as target:
                shutil.copyfileobj(content, target)
            source = None
        whole = _decompress(path, stack) if path.suffix.lower() == ".zstd" else path
        if whole.suffix.lower() == ".mcap":
            return McapFile(whole, source=source or LocalFile(whole))
        return SqliteFile(whole)


def bags_of(bags: FilePaths) -> tuple[Bag, ...]:
    """Return one or many paths or bags as bags.

    Raises UsageError: there is none.
    """
    given = [bags] if isinstance(bags, (str, os.PathLike)) else list(bags)
    pairs = zip(given, as_paths(given), strict=True)
    return tuple(bag if isinstance(bag, Bag) else Bag(path) for bag, path in pairs)


def bag_files(path: Path) -> list[Path]:
    """Return the files of a bag in the order of recording.

    Raises UsageError: no such file or folder, or it cannot be read. DataError: not a bag.
    """
    if not is_there(path):
        raise UsageError(f"{path}: no such file or folder")
    if not path.is_dir():
        if not path.is_file():
            raise DataError(f"{path} is {NO_FILE}; write it to a file first")
        if path.suffix.lower() == ".bag":
            raise DataError(
                f"{path}: a bag of ROS 1; `rosbags-convert --src {path} --dst {path.stem}` makes a "
                "folder of ROS 2 of it, with the same messages"
            )
        if not is_bag_file(path.name):
            raise DataError(
                f"{path}: not a bag (an .mcap or .db3 file, or a rosbag2 folder); tables "
                "come in through idim-iv import"
            )
        return [path]
    present = sorted(file for file in path.iterdir() if is_bag_file(file.name) and file.is_file())
    files = _listed_files(path) or present
    if not files:
        raise DataError(f"{path}: no .mcap or .db3 file in this folder")
    return files


def is_bag_file(name: str) -> bool:
    """Return whether a file of this name may be a bag, or a part of one."""
    return name.lower().endswith(SUFFIXES)


def _listed_files(folder: Path) -> list[Path]:
    information = _information(folder)
    if str(information.get("compression_mode", "")).lower() == "message":
        raise DataError(
            f"{folder}: every message is compressed by itself; convert it with ros2 bag convert "
            "(compression_mode: file or none)"
        )
    names = information.get("relative_file_paths")
    if not isinstance(names, list):
        return []
    files = [folder / Path(name).name for name in names if isinstance(name, str)]
    return [file for file in files if is_file(file)]


def _counts(folder: Path) -> dict[str, int]:
    """Return the number of messages of each topic, as far as metadata.yaml has it."""
    counts: dict[str, int] = {}
    topics = _information(folder).get("topics_with_message_count")
    for topic in topics if isinstance(topics, list) else []:
        with suppress(KeyError, TypeError):
            name, count = topic["topic_metadata"]["name"], topic["message_count"]
            if isinstance(name, str) and isinstance(count, int):
                counts[name] = count
    return counts


def _information(folder: Path) -> dict[str, Any]:
    """Return the content of metadata.yaml; empty if it is missing or unreadable."""
    metadata = folder / "metadata.yaml"
    try:
        if not metadata.is_file() or metadata.stat().st_size > _LONGEST_METADATA:
            return {}
        document = YAML(typ="safe", pure=True).load(metadata.read_text(encoding="utf-8"))
        information = document["rosbag2_bagfile_information"]
    except (OSError, ValueError, YAMLError, KeyError, TypeError, RecursionError):
        return {}
    return information if isinstance(information, dict) else {}


def _temporary(stack: ExitStack) -> Path:
    folder = tempfile.TemporaryDirectory(prefix="idim_iv_")
    stack.enter_context(folder)
    stack.enter_context(undone_if_interrupted(folder.cleanup))
    return Path(folder.name)


def _decompress(path: Path, stack: ExitStack) -> Path:
    out = _temporary(stack) / path.with_suffix("").name
    try:
        with path.open("rb") as source, out.open("wb") as target:
            zstandard.ZstdDecompressor().copy_stream(source, target)
    except (zstandard.ZstdError, OSError) as error:
        raise DataError(f"{path}: cannot be decompressed ({error})") from error
    return out


def loss_notes(bag: Bag, topics: Sequence[str]) -> list[Note]:
    """Return a note on messages saved and lost of some topics; none for an intact bag.

    It has `limits` if a message of the topics is lost.
    """
    if not bag.damages:
        return []
    parts = []
    for topic in topics:
        lost = f"{bag.missing[topic]} are lost" if bag.counted else "how many are lost is not known"
        parts.append(f"{bag.seen[topic]} messages on {topic} were saved, {lost}")
    limits = not bag.counted or any(bag.missing[topic] for topic in topics)
    return [Note("", f"{' and '.join(bag.damages)}: {'; '.join(parts)}", 1, limits)]
