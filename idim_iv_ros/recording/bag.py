"""A bag is an MCAP file, a lone .db3 or a rosbag2 folder with any number of either."""

import tempfile
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path

import zstandard
from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError

from idim_iv_ros.errors import DataError, UsageError
from idim_iv_ros.interruption import undone_if_interrupted
from idim_iv_ros.recording.mcap_file import McapFile
from idim_iv_ros.recording.message_batch import MessageBatch
from idim_iv_ros.recording.sqlite_file import SqliteFile


@dataclass
class Bag:
    """One recording on disk.

    Attributes
    ----------
    path : Path
        As the user named it.
    topics : dict
        Type of each topic; complete once the bag was read.
    losses : list of (str, str, int)
        File, what is missing from it, how many.
    """

    path: Path
    topics: dict[str, str] = field(default_factory=dict)
    losses: list[tuple[str, str, int]] = field(default_factory=list)

    def batches(self, wanted: set[str]) -> Iterator[tuple[str, MessageBatch]]:
        """Raw messages of the wanted topics, file by file.

        Raises
        ------
        UsageError
            No such file or folder.
        DataError
            Not a bag.
        """
        with ExitStack() as stack:
            for path in bag_files(self.path):
                if path.suffix == ".zstd":
                    path = _decompressed(path, stack)
                file = McapFile(path) if path.suffix == ".mcap" else SqliteFile(path)
                for topic, batch in file.batches(wanted):
                    self.topics[topic] = file.topics[topic]
                    yield topic, batch
                self.topics.update(file.topics)
                if file.truncated:
                    what = "the file ends in the middle: what is whole before that was read"
                    self.losses.append((path.name, what, 1))
                if file.damaged:
                    self.losses.append((path.name, "damaged chunks were left out", file.damaged))


def bag_files(path: Path) -> list[Path]:
    """Files of a bag in the order in which they were recorded.

    Raises
    ------
    UsageError
        No such file or folder, or one that cannot be read.
    DataError
        Not a bag.
    """
    if not path.exists():
        raise UsageError(f"{path}: no such file or folder")
    if path.is_file():
        if not path.name.endswith((".mcap", ".db3", ".mcap.zstd", ".db3.zstd")):
            raise DataError(
                f"{path}: not a bag (an .mcap or .db3 file, or a rosbag2 folder); tables come in "
                "through idim-iv import"
            )
        return [path]
    listed = _listed(path)
    files = listed or sorted(
        file
        for pattern in ("*.mcap", "*.db3", "*.mcap.zstd", "*.db3.zstd")
        for file in path.glob(pattern)
    )
    if not files:
        raise DataError(f"{path}: no .mcap or .db3 file in this folder")
    return files


def _listed(folder: Path) -> list[Path]:
    """Files that metadata.yaml lists and that exist, in its order."""
    metadata = folder / "metadata.yaml"
    if not metadata.is_file():
        return []
    try:
        document = YAML(typ="safe", pure=True).load(metadata.read_text(encoding="utf-8"))
        information = document["rosbag2_bagfile_information"]
        names = [str(name) for name in information["relative_file_paths"]]
        mode = str(information.get("compression_mode", "")).lower()
    except (OSError, UnicodeDecodeError, YAMLError, KeyError, TypeError, AttributeError):
        return []
    if mode == "message":
        raise DataError(
            f"{folder}: every message is compressed by itself; convert it with ros2 bag convert "
            "(compression_mode: file or none)"
        )
    return [file for file in (folder / Path(name).name for name in names) if file.is_file()]


def _decompressed(path: Path, stack: ExitStack) -> Path:
    folder = tempfile.TemporaryDirectory(prefix="idim_iv_")
    stack.enter_context(folder)
    stack.enter_context(undone_if_interrupted(folder.cleanup))
    out = Path(folder.name) / path.with_suffix("").name
    try:
        with path.open("rb") as source, out.open("wb") as target:
            zstandard.ZstdDecompressor().copy_stream(source, target)
    except zstandard.ZstdError as error:
        raise DataError(f"{path}: cannot be decompressed ({error})") from error
    return out
