"""The highest rate that the recorder node takes without loss, against a callback per message."""

import os
import sys
import tempfile
import time
from pathlib import Path

os.environ["ROS_DOMAIN_ID"] = str(20 + os.getpid() % 80)
os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"

import rclpy

from benchmarks.measurement import write_page
from tests.ros.processes import Observer, Process, Robot, start_recorder

SECONDS = 5.0
RUNS = 2
TRIES = 4
JOINTS = [f"joint_{k}" for k in range(1, 8)]
TOPIC = {"name": "/joint_states", "joints": JOINTS, "depth": 20_000}
RATES = {
    "recorder": [5_000, 10_000, 15_000, 20_000, 25_000, 30_000, 40_000],
    "plain": [2_000, 4_000, 5_000, 6_000, 8_000, 10_000, 15_000],
}
LAG = 20.0  # s for what is still in queues when the publisher has ended


class Outcome:
    """One run: messages lost, processor share, and the rate that was really offered (Hz)."""

    def __init__(self, lost: int, share: float, offered: float) -> None:
        self.lost, self.share, self.offered = lost, share, offered


def run_recorder(robot: Robot, rate: int, folder: Path) -> Outcome:
    observer = Observer()
    process = start_recorder(folder, bag_directory=str(folder), record=True)
    observer.follow(process)
    count = int(SECONDS * rate)
    robot.begin(count=count, rate=float(rate), topics=[TOPIC])
    before = process.cpu()
    robot.run()
    share = (process.cpu() - before) / robot.seconds
    settled = wait_settled(lambda: observer.next_status().topics[0].recorded, count)
    robot.end()
    process.finish()
    observer.node.destroy_node()
    return Outcome(count - settled, share, count / robot.seconds)


def run_plain(robot: Robot, rate: int, folder: Path) -> Outcome:
    script = str(Path(__file__).with_name("plain_recorder.py"))
    process = Process([sys.executable, script, str(folder / f"{rate}.mcap")], folder, "plain")
    count = int(SECONDS * rate)
    robot.begin(count=count, rate=float(rate), topics=[TOPIC])
    before = process.cpu()
    robot.run()
    share = (process.cpu() - before) / robot.seconds
    deadline, used = time.monotonic() + LAG, -1.0
    while process.cpu() - used > 0.1 and time.monotonic() < deadline:
        used = process.cpu()
        time.sleep(1.0)
    robot.end()
    process.process.send_signal(2)
    written = int(process.hear())
    process.process.wait()
    return Outcome(count - written, share, count / robot.seconds)


def offered_run(kind: str, robot: Robot, rate: int, folder: Path) -> Outcome:
    """Run until the publisher keeps the rate: on a shared machine it may need another try."""
    for _ in range(TRIES):
        outcome = {"recorder": run_recorder, "plain": run_plain}[kind](robot, rate, folder)
        if outcome.offered >= 0.95 * rate:
            break
    return outcome


def wait_settled(count, expected: int) -> int:
    """Wait until everything is there or nothing more comes."""
    deadline, before = time.monotonic() + LAG, -1
    while time.monotonic() < deadline:
        now = count()
        if now >= expected or now == before:
            return now
        before = now
    return before


def highest(
    kind: str, robot: Robot, folder: Path, lines: list[str], shares: dict[str, dict[int, float]]
) -> int:
    """Climb until a run loses a message or the publisher cannot keep up."""
    best = 0
    for rate in RATES[kind]:
        runs = [offered_run(kind, robot, rate, folder) for _ in range(RUNS)]
        offered = min(run.offered for run in runs)
        lost = " / ".join(str(run.lost) for run in runs)
        share = " / ".join(f"{100 * run.share:.0f} %" for run in runs)
        lines.append(f"| {kind} | {rate} | {offered:.0f} | {lost} | {share} |")
        print(lines[-1], flush=True)
        if offered < 0.95 * rate:
            lines.append(f"| {kind} | | the publisher cannot offer {rate} | | |")
            break
        if any(run.lost for run in runs):
            break
        best = rate
        shares[kind][rate] = max(run.share for run in runs)
    return best


def main() -> None:
    rclpy.init()
    lines = [
        f"JointState of 7 joints, {SECONDS:.0f} s at each rate, {RUNS} runs; zstd MCAP; a "
        "publisher process and a recorder process on two cores.",
        "",
        "| recorder | rate (Hz) | offered (Hz) | lost | processor |",
        "|---|---|---|---|---|",
    ]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        robot = Robot(folder, "robot")
        shares: dict[str, dict[int, float]] = {"plain": {}, "recorder": {}}
        plain = highest("plain", robot, folder, lines, shares)
        ours = highest("recorder", robot, folder, lines, shares)
        robot.kill()
    rclpy.try_shutdown()
    ratio = f"{ours / plain:.1f}" if plain else "no"
    lines += [
        "",
        f"Highest rate without loss: {ours} Hz against {plain} Hz with a callback for each "
        f"message, {ratio} times (target: 4). Load average at the end: {os.getloadavg()[0]:.1f}.",
    ]
    common = max(set(shares["plain"]) & set(shares["recorder"]), default=None)
    if common is not None:
        saving = shares["plain"][common] / shares["recorder"][common]
        lines.append(f"At {common} Hz the recorder takes {saving:.1f} times less processor time.")
    write_page("recorder_rate", "The highest rate recorded without loss", lines)


if __name__ == "__main__":
    main()
