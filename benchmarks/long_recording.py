"""One hour at 1 kHz of seven joints: time and memory of IDIM-LS from the bag to the result."""

import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from benchmarks.measurement import measure, report_case, write_page

CONFIG = Path(__file__).parent.parent / "config"
SAMPLES = 3_600_000
RATE = 1000.0
BAG = Path(tempfile.gettempdir()) / "idim_iv_one_hour.mcap"


def make_bag() -> None:
    """A minute of the seven-joint arm, repeated."""
    from bags import simulated_arms
    from idim_iv_ros.recording.writing.write import JointTopic, write_bag

    arm = simulated_arms.arm7(seconds=60.0)
    record = simulated_arms.record(arm, 1)
    repeats = SAMPLES // len(record.time)

    position = np.tile(record.position, (repeats, 1))
    effort = np.tile(record.effort, (repeats, 1))
    stamps = np.arange(len(position)) / RATE
    joints = arm.configuration.robot.joints
    write_bag(BAG, [JointTopic("/joint_states", joints, stamps, position, None, effort)])


def least_squares() -> None:
    from idim_iv_ros import identify, load_configuration

    started = time.perf_counter()
    configuration = load_configuration(CONFIG / "arm7.yaml")
    configuration = configuration.changed("signals", reference=None)
    result = identify([BAG], configuration, estimator="idim-ls")
    report_case(
        time.perf_counter() - started, rows=result.fit.samples, rate=result.processing.row_rate
    )


def main() -> None:
    if not BAG.exists():
        make_bag()
    case = measure("benchmarks.long_recording", "ls", 1)
    write_page(
        "long_recording",
        "One hour at 1 kHz, 7 joints, IDIM-LS from the bag to the result with its tests",
        [
            f"- bag: {BAG.stat().st_size / 1e6:.0f} MB, {SAMPLES:,} messages",
            f"- rows: {case.detail['rows']:.0f} at {case.detail['rate']:.3g} per second and joint",
            f"- time: {case.seconds:.1f} s",
            f"- peak memory: {case.peak / 1e9:.2f} GB (target: 1.5 GB)",
        ],
    )


if __name__ == "__main__":
    {"ls": least_squares}.get(sys.argv[1] if len(sys.argv) > 1 else "", main)()
