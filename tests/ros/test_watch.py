"""The live view as its users have it: a table, a page, one line at the end."""

import http.client
import io
import json
import math
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from rich.console import Console

from idim_iv_interfaces.msg import Prediction, RecorderStatus
from idim_iv_ros.nodes.watch.node import JointView, LivePage, LiveView, live_table
from idim_iv_ros.prediction.identified_model import LIMIT, SHARE
from tests.browser import CHROMIUM, Browser
from tests.ros.processes import HANG, Observer, Process

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


def states(url: str, after: int = 0) -> list[dict]:
    """States of a page behind a number."""
    connection = http.client.HTTPConnection(url.split("/")[2], timeout=HANG)
    connection.request("GET", f"/states?after={after}")
    return list(json.load(connection.getresponse())["states"])


@pytest.fixture
def page() -> Iterator[LivePage]:
    page = LivePage(0)
    yield page
    page.close()


def get(page: LivePage, path: str, host: str | None = None) -> http.client.HTTPResponse:
    port = int(page.url.rstrip("/").rpartition(":")[2])
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=HANG)
    headers = {} if host is None else {"Host": host}
    connection.request("GET", path, headers=headers)
    return connection.getresponse()


def test_the_page_and_all_it_needs_come_from_here(page: LivePage) -> None:
    text = get(page, "/").read().decode()
    for part in ("live.css", "live.js", "plotly.js"):
        assert part in text
        assert get(page, f"/{part}").status == 200
    assert "http" not in text.replace("http-equiv", "")
    assert get(page, "/../../etc/passwd").status == 404
    assert get(page, "/", host="evil.example:80").status == 403


def test_a_page_gets_the_last_states_and_then_those_that_are_new(page: LivePage) -> None:
    page.publish(view().to_json())
    (first,) = states(page.url)
    assert first["joints"][0]["measured"] == -123.456
    assert first["joints"][1]["predicted"] is None
    page.publish(LiveView("arm", 13.0, NAN, "no position for 2 s", ()).to_json())
    (second,) = states(page.url, after=1)
    assert (second["stamp"], second["delay"]) == (13.0, None)
    assert states(page.url, after=2) == []
    assert states(page.url, after=9) == [first, second]  # a page of an earlier server


def test_a_port_that_is_taken_is_refused_in_one_line(page: LivePage) -> None:
    from idim_iv_ros.errors import UsageError

    port = int(page.url.rstrip("/").rpartition(":")[2])
    with pytest.raises(UsageError, match=f"--web {port}:"):
        LivePage(port)


@pytest.fixture
def watch(tmp_path: Path, observer: Observer) -> Iterator[tuple[Process, str]]:
    """`idim-iv watch --web` in a namespace of its own, and its page."""
    call = "from idim_iv_ros.cli.main import main; main()"
    options = ["watch", "--web", "0", "--namespace", "watched"]
    process = Process([sys.executable, "-c", call, *options], tmp_path, "watch")
    yield process, process.hear().split()[0]
    process.end()


def test_watch_shows_what_nodes_say_and_ends_with_one_line(
    watch: tuple[Process, str], observer: Observer, tmp_path: Path
) -> None:
    process, url = watch
    node = observer.node
    predictions = node.create_publisher(Prediction, "/watched/predictor/prediction", 10)
    recorder = node.create_publisher(RecorderStatus, "/watched/recorder/status", 10)
    observer.until(lambda: predictions.get_subscription_count(), "watch")
    recorder.publish(RecorderStatus(state=RecorderStatus.RECORDING, bag="bags/run", duration=3.0))
    seconds = 0

    def publish() -> bool:
        nonlocal seconds
        seconds += 1
        message = Prediction(robot="arm7", valid=True, name=list(JOINTS), delay=0.16)
        message.header.stamp.sec = seconds
        message.measured, message.predicted = [1.5] * 7, [1.25] * 7
        message.residual, message.noise_share = [0.25] * 7, [0.9] * 6 + [NAN]
        message.noise_floor = [0.3] * 7
        predictions.publish(message)
        observer.executor.spin_once(timeout_sec=0.02)
        return seconds > 20

    observer.until(publish, "some predictions")
    seen: list[dict] = []

    def arrived() -> bool:  # on a busy machine it said first that nothing is heard
        publish()
        seen.extend(state for state in states(url) if state["joints"])
        return bool(seen)

    observer.until(arrived, "a prediction on the page")
    event = seen[-1]
    assert [item["name"] for item in event["joints"]] == list(JOINTS)
    assert event["joints"][0]["predicted"] == 1.25
    if CHROMIUM is not None:
        browser = Browser(tmp_path / "chromium")
        try:
            browser.open(url)
            browser.until(
                "document.querySelectorAll('.joint .plot .scatterlayer path').length >= 7"
            )
            assert browser.evaluate("document.querySelectorAll('.joint').length") == 7
            assert browser.evaluate("document.getElementById('robot').textContent") == "arm7"
            words = browser.evaluate("document.getElementById('nodes').innerText")
            assert "recording bags/run, 3 s" in words.replace("\n", " ")
        finally:
            browser.close()
    second = node.create_publisher(Prediction, "/watched/predictor/prediction", 10)

    def refused() -> bool:
        publish()
        words = "2 predictors publish /watched/predictor/prediction"
        return any(words in state["reason"] for state in states(url))

    observer.until(refused, "word of the second predictor")
    for publisher in (predictions, recorder, second):
        node.destroy_publisher(publisher)
    assert process.finish() == 0
    assert process.hear() == "watch: ended"
    assert process.errors.read_text() == ""
