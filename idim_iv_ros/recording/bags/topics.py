"""Which topics a bag holds, without its messages where that can be had."""

import mmap
from contextlib import ExitStack
from pathlib import Path

from idim_iv_ros.recording.bags.folder import bag_files, decompressed
from idim_iv_ros.recording.bags.mcap import McapFile
from idim_iv_ros.recording.bags.mcap_records import read_summary
from idim_iv_ros.recording.bags.sqlite import SqliteFile


def bag_topics(path: Path) -> dict[str, str]:
    """Return the type of each topic of a bag.

    From the summary of an MCAP file; one without is read as far as it goes.

    Raises
    ------
    UsageError
        No such file or folder.
    DataError
        Not a bag.
    """
    topics: dict[str, str] = {}
    with ExitStack() as stack:
        for each in bag_files(path):
            whole = decompressed(each, stack) if each.suffix == ".zstd" else each
            topics.update(_summarised(whole) or _met(whole))
    return topics


def _summarised(file: Path) -> dict[str, str]:
    if file.suffix != ".mcap" or file.stat().st_size == 0:
        return {}
    with (
        file.open("rb") as stream,
        mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as content,
    ):
        summary = read_summary(content)
    return {} if summary is None else dict(summary.topics)


def _met(path: Path) -> dict[str, str]:
    file = McapFile(path) if path.suffix == ".mcap" else SqliteFile(path)
    for _ in file.batches(set()):
        pass
    return file.topics
