"""The live view as its users have it: a table, one line at the end."""

import io
import math
import sys
import threading
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from rich.console import Console

from idim_iv_interfaces.msg import Prediction, RecorderStatus
from idim_iv_ros.nodes.watch.node import JointView, LiveView, live_table
from idim_iv_ros.prediction.rows import LIMIT, SHARE
from tests.ros.processes import Observer, Process

NAN = math.nan
JOINTS = tuple(f"joint_{k}" for k in range(1, 8))


def view(warns: bool = False) -> LiveView:
    values = {"unit": "N m", SHARE: "3.1" if warns else "1.1", LIMIT: "1.4"}
    first = JointView.diagnosed("joint_1", values, warns, "residual 0.1 N m")
    numbers = {"measured": -123.456, "predicted": -123.0, "residual": -0.456, "share": 1.2}
    still = {"unit": "N", SHARE: "nan", LIMIT: "unknown"}
    second = JointView.diagnosed("joint_2", still, False, "no motion to judge by")
    joints = (replace(first, **numbers), replace(second, measured=1.0))
    return LiveView("arm", 12.0, 0.15, "", joints, {"recorder": "idle"})


def shown(what: LiveView) -> str:
    written = io.StringIO()
    Console(width=80, file=written).print(live_table(what))
    return written.getvalue()


def test_the_table_fits_eighty_columns_and_holds_every_number() -> None:
    text = shown(view())
    assert "…" not in text
    assert max(map(len, text.splitlines())) <= 80
    for words in ("joint_1 (N m)", "-123.456", "-123.000", "-0.456", "1.10", "1.40", "1.20", "(N)"):
        assert words in text
    assert "0.15 s behind the robot" in text
    assert "recorder: idle" in text


def test_what_is_beyond_its_limit_is_said_in_words() -> None:
    assert "residual 0.1 N m" not in shown(view())
    assert "joint_1: residual 0.1 N m" in shown(view(warns=True))


def test_why_nothing_is_predicted_is_said() -> None:
    text = shown(LiveView("", 0.0, NAN, "nobody publishes /joint_states", ()))
    assert "nobody publishes /joint_states" in text


@pytest.fixture
def watch(tmp_path: Path, observer: Observer) -> Iterator[Process]:
    """`idim-iv watch` in a namespace of its own; where no terminal is, it prints now and then."""
    call = "from idim_iv_ros.cli.main import main; main()"
    options = ["watch", "--namespace", "watched"]
    process = Process([sys.executable, "-c", call, *options], tmp_path, "watch")
    yield process
    process.end()


def test_watch_shows_what_nodes_say_and_ends_with_one_line(
    watch: Process, observer: Observer
) -> None:
    node = observer.node
    predictions = node.create_publisher(Prediction, "/watched/predictor/prediction", 10)
    recorder = node.create_publisher(RecorderStatus, "/watched/recorder/status", 10)
    observer.until(lambda: predictions.get_subscription_count(), "watch")
    recorder.publish(RecorderStatus(state=RecorderStatus.RECORDING, bag="bags/run", duration=3.0))
    printed: list[str] = []
    lines = (line.strip() for line in watch.process.stdout)
    threading.Thread(target=lambda: printed.extend(lines), daemon=True).start()

    def publish() -> None:
        message = Prediction(robot="arm7", valid=True, name=list(JOINTS), delay=0.16)
        message.header.stamp.sec = 1
        message.measured, message.predicted = [1.5] * 7, [1.25] * 7
        message.residual, message.noise_share = [0.25] * 7, [0.9] * 6 + [NAN]
        message.noise_floor = [0.3] * 7
        predictions.publish(message)

    def shows(*words: str) -> bool:
        publish()
        return all(any(word in line for line in printed) for word in words)

    parts = ("arm7: efforts", *JOINTS, "+1.250", "recorder: recording bags/run, 3 s")
    observer.until(lambda: shows(*parts), "a prediction in the table")
    second = node.create_publisher(Prediction, "/watched/predictor/prediction", 10)
    words = "2 predictors publish"
    observer.until(lambda: shows(words), "word of the second predictor")
    for publisher in (predictions, recorder, second):
        node.destroy_publisher(publisher)
    assert watch.finish() == 0
    observer.until(lambda: "watch: ended" in printed, "the last line")
    assert watch.errors.read_text() == ""
