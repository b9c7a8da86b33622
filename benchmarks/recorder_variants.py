"""What snapshots, extra topics and storage presets cost the recorder at 10 kHz."""

import itertools
import os
import tempfile
from pathlib import Path

os.environ["ROS_DOMAIN_ID"] = str(20 + os.getpid() % 80)
os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"

import rclpy

from benchmarks.measurement import write_page
from benchmarks.recorder_rate import JOINTS, TOPIC, wait_settled
from idim_iv_ros.recording.bags.folder import Bag
from tests.ros.processes import Observer, Robot, start_recorder

SECONDS, RATE, TRIES = 5.0, 10_000, 6
EXTRA = {"name": "/joint_extra", "joints": JOINTS, "depth": 20_000}
VARIANTS: dict[str, tuple[dict[str, object], bool, bool]] = {
    # Parameters, whether an extra topic of the same rate is recorded, whether a snapshot is taken.
    "as before": ({}, False, False),
    "30 s in memory": ({"snapshot_duration": 30.0, "snapshot_memory": 1_000_000_000}, False, False),
    "30 s in memory, written meanwhile": (
        {"snapshot_duration": 30.0, "snapshot_memory": 1_000_000_000},
        False,
        True,
    ),
    "half of them on an extra topic": ({"extra_topics": "['/joint_extra']"}, True, False),
    "storage_preset none": ({"storage_preset": "none"}, False, False),
    "storage_preset fast": ({"storage_preset": "fast"}, False, False),
    "storage_preset small": ({"storage_preset": "small"}, False, False),
}


def offered_run(name: str, robot: Robot, folder: Path, observer: Observer) -> str:
    """One run as a row of the table; another try where the publisher did not keep the rate."""
    for number in itertools.count():
        kept, row = run(name, robot, folder / f"{len(list(folder.iterdir()))}", observer)
        if kept or number == TRIES - 1:
            break
    return row


def run(name: str, robot: Robot, folder: Path, observer: Observer) -> tuple[bool, str]:
    """One run: whether the publisher kept the rate, and its row."""
    folder.mkdir()
    parameters, extra, snapshot = VARIANTS[name]
    bags = folder / "bags"
    process = start_recorder(folder, bag_directory=str(bags), record=True, **parameters)
    observer.follow(process)
    topics = [TOPIC, EXTRA] if extra else [TOPIC]
    rate = RATE / len(topics)
    count = int(SECONDS * rate)
    total = len(topics) * count
    robot.begin(count=count, rate=rate, topics=topics)
    before = process.cpu()
    robot.say("go")
    if snapshot:
        observer.until(lambda: observer.topic("/joint_states").received > count // 2, "half")
        assert observer.call("snapshot").success
    robot.sent()
    share = (process.cpu() - before) / robot.seconds
    wait_settled(lambda: sum(t.recorded for t in observer.next_status().topics), total)
    robot.end()
    process.finish()
    files = [file for file in bags.rglob("*.mcap") if "snapshot" not in file.name]
    names = {str(topic["name"]) for topic in topics}
    written = sum(len(batch) for file in files for _, batch in Bag(file).batches(names))
    size = sum(file.stat().st_size for file in files) / written
    offered = count / robot.seconds
    row = f"| {name} | {offered:.0f} | {total - written} | {100 * share:.0f} % | {size:.0f} |"
    return offered > 0.95 * rate, row


def main() -> None:
    rclpy.init()
    lines = [
        f"JointState of 7 joints at {RATE} Hz for {SECONDS:.0f} s. The rate is that of each topic; "
        "a run in which the publisher does not keep it is repeated. One position changes from "
        "message to message, so that all compress better than those of a robot.",
        "",
        "| recorder | offered (Hz) | lost | processor | bytes a message on disk |",
        "|---|---|---|---|---|",
    ]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        robot, observer = Robot(folder, "robot"), Observer()
        for variant in VARIANTS:
            lines.append(offered_run(variant, robot, folder, observer))
            print(lines[-1], flush=True)
        robot.kill()
    rclpy.try_shutdown()
    lines += ["", f"Load average at the end: {os.getloadavg()[0]:.1f}."]
    write_page("recorder_variants", "What the recorder's options cost", lines)


if __name__ == "__main__":
    main()
