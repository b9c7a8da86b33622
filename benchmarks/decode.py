"""Decoding a million JointState messages against deserialising each one with rosbags."""

import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from benchmarks.measurement import measure, report_case, write_page

MESSAGES = 1_000_000
BAG = Path(tempfile.gettempdir()) / f"idim_iv_decode_{MESSAGES}.mcap"
JOINTS = [f"joint_{k}" for k in range(1, 7)]


def make_bag() -> None:
    from idim_iv_ros.recording.writing.write import JointTopic, write_bag

    random = np.random.default_rng(0)
    values = random.normal(size=(MESSAGES, 6)).cumsum(axis=0) * 1e-3
    stamps = np.arange(MESSAGES) / 1000.0
    write_bag(BAG, [JointTopic("/joint_states", JOINTS, stamps, values, values, values)])


def peer() -> None:
    from rosbags.highlevel import AnyReader

    started = time.perf_counter()
    total = 0.0
    with AnyReader([BAG]) as reader:
        for connection, _, raw in reader.messages():
            message = reader.deserialize(raw, connection.msgtype)
            total += message.position[0]
    report_case(time.perf_counter() - started, total=total)


def ours() -> None:
    from idim_iv_ros.recording.read import read_recordings

    started = time.perf_counter()
    (recording,) = read_recordings([BAG], joints=JOINTS)
    seconds = time.perf_counter() - started
    report_case(seconds, total=float(recording.position.values[:, 0].sum()))


def main() -> None:
    if not BAG.exists():
        make_bag()
    mine, theirs = measure("benchmarks.decode", "ours", 3), measure("benchmarks.decode", "peer", 1)
    if abs(mine.detail["total"] - theirs.detail["total"]) > 1e-6 * abs(theirs.detail["total"]):
        raise SystemExit("the two readers disagree")
    write_page(
        "decode",
        f"Reading {MESSAGES:,} JointState messages of 6 joints (zstd MCAP, "
        f"{BAG.stat().st_size / 1e6:.0f} MB)",
        [
            "| | seconds | peak memory |",
            "|---|---|---|",
            f"| rosbags, each message deserialised | {theirs.seconds:.2f} | "
            f"{theirs.peak / 1e6:.0f} MB |",
            f"| read_recordings, uniform grid included | {mine.seconds:.2f} | "
            f"{mine.peak / 1e6:.0f} MB |",
            "",
            f"Ratio: {theirs.seconds / mine.seconds:.1f} times faster (target: 8).",
        ],
    )


if __name__ == "__main__":
    {"ours": ours, "peer": peer}.get(sys.argv[1] if len(sys.argv) > 1 else "", main)()
