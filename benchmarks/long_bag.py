"""Four hours at 1 kHz of seven joints as a bag of a fleet: time and memory, by segments."""

import os
import struct
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import zstandard

from benchmarks.measurement import measure, report_case, write_page

CONFIG = Path(__file__).parent.parent / "config" / "arm7.yaml"
HOURS = 4
PIECE = 600  # s, recorded once and repeated with later stamps
BAG = Path(os.environ.get("IDIM_IV_LONG_BAG", f"{tempfile.gettempdir()}/idim_iv_four_hours.mcap"))


def make_bag() -> None:
    """Ten minutes of the seven-joint arm with its reference, again and again, without a summary."""
    from bags import simulated_arms
    from idim_iv_ros.recording import JointTopic, write_bag
    from idim_iv_ros.recording.bags.mcap_records import (
        CHUNK,
        DATA_END,
        FOOTER,
        HEAD,
        INDEX,
        MAGIC,
        records,
    )

    arm = simulated_arms.arm7(seconds=60.0)
    topics = simulated_arms.joint_topics(arm, simulated_arms.record(arm, 1))
    minutes = PIECE // 60
    stamps = np.arange(len(topics[0].time) * minutes) / arm.rate
    longer = [
        JointTopic(
            topic.name,
            topic.joints,
            stamps,
            *(
                None if values is None else np.tile(values, (minutes, 1))
                for values in (topic.position, topic.velocity, topic.effort)
            ),
        )
        for topic in topics
    ]
    piece = BAG.with_suffix(".piece.mcap")
    write_bag(piece, longer, force=True)
    content = piece.read_bytes()
    piece.unlink()
    with BAG.open("wb") as file:
        for turn in range(HOURS * 3600 // PIECE):
            for record in records(content, len(MAGIC)):
                if record.opcode == DATA_END:
                    break
                body = content[record.start : record.end]
                if record.opcode == INDEX:
                    continue
                if record.opcode == CHUNK:
                    body = later(body, turn * PIECE)
                elif turn:
                    continue
                else:
                    file.write(MAGIC if file.tell() == 0 else b"")
                file.write(struct.pack("<BQ", record.opcode, len(body)) + body)
        file.write(struct.pack("<BQI", DATA_END, 4, 0))
        file.write(struct.pack("<BQQQI", FOOTER, 20, 0, 0, 0) + MAGIC)
    assert struct.calcsize("<BQ") == HEAD


def later(chunk: bytes, seconds: int) -> bytes:
    """Return a chunk whose messages were recorded later."""
    start, end, size, _ = struct.unpack_from("<QQQI", chunk)
    place = 28 + 4 + len(b"zstd") + 8
    messages = bytearray(zstandard.ZstdDecompressor().decompress(chunk[place:], size))
    shift = seconds * 10**9
    at = 0
    while at < len(messages):
        opcode, length = struct.unpack_from("<BQ", messages, at)
        if opcode == 5:
            arrival, published = struct.unpack_from("<QQ", messages, at + 15)
            struct.pack_into("<QQ", messages, at + 15, arrival + shift, published + shift)
            (stamp,) = struct.unpack_from("<i", messages, at + 35)
            struct.pack_into("<i", messages, at + 35, stamp + seconds)
        at += 9 + length
    packed = zstandard.ZstdCompressor(level=1).compress(bytes(messages))
    head = struct.pack("<QQQI", start + shift, end + shift, size, 0)
    return head + struct.pack("<I", 4) + b"zstd" + struct.pack("<Q", len(packed)) + packed


def identified() -> None:
    from idim_iv_ros import load_configuration
    from idim_iv_ros.fleet.commands import identify_task
    from idim_iv_ros.fleet.robots import Robot

    robot = Robot.of(load_configuration(CONFIG))
    started = time.perf_counter()
    result = identify_task(str(BAG), "", "", robot)
    if result.status != "ok":
        raise SystemExit(result.reason)
    report_case(
        time.perf_counter() - started,
        rows=result.rows,
        hours=result.duration / 3600.0,
        bytes=len(result.to_json()),
        iv=float(result.estimator == "idim-iv"),
    )


def main() -> None:
    if not BAG.exists():
        make_bag()
    case = measure("benchmarks.long_bag", "identify", 1)
    size = BAG.stat().st_size
    write_page(
        "long_bag",
        "Four hours at 1 kHz, 7 joints, with reference: one bag of a fleet, IDIM-IV by segments",
        [
            f"- bag: {size / 1e6:.0f} MB, {case.detail['hours']:.4g} hours",
            f"- rows: {case.detail['rows']:.0f}",
            f"- estimate: {'IDIM-IV' if case.detail['iv'] else 'IDIM-LS'}",
            f"- result: {case.detail['bytes'] / 1e3:.0f} kB",
            f"- time: {case.seconds:.1f} s",
            f"- peak memory: {case.peak / 1e9:.2f} GB (target: 1.5 GB)",
        ],
    )


if __name__ == "__main__":
    {"identify": identified, "make": make_bag}.get(sys.argv[1] if len(sys.argv) > 1 else "", main)()
