"""What the identifier refuses, and what it does with what others announce."""

import os
from pathlib import Path
from types import SimpleNamespace

import pytest

from idim_iv_interfaces.msg import BagClosed
from idim_iv_ros.errors import UsageError
from idim_iv_ros.nodes.identifier.job import confined, confined_bag
from idim_iv_ros.nodes.identifier.node import ACTIVE, Identifier
from idim_iv_ros.nodes.settings import IdentifierSettings
from tests.ros.conftest import ARM2


@pytest.fixture
def outside(tmp_path: Path, simulated_bags: Path) -> Path:
    """A bag that lies beside the folder of the bags."""
    path = tmp_path / "outside.mcap"
    path.write_bytes((simulated_bags / "bag-1.mcap").read_bytes())
    return path


@pytest.fixture
def inside(tmp_path: Path) -> Path:
    folder = tmp_path / "bags"
    folder.mkdir()
    return folder


def test_names_inside_are_found(inside: Path) -> None:
    bag = inside / "day" / "bag"
    bag.mkdir(parents=True)
    (bag / "one.mcap").write_bytes(bytes(100))
    (bag / "metadata.yaml").write_bytes(bytes(10))
    (inside / "latest").symlink_to("day/bag")
    for name in ("day/bag", str(bag), "latest"):
        assert confined_bag(inside, name) == (bag.resolve(), 110)


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("", "names no file"),
        ("bag\0", "names no file"),
        ("../outside.mcap", "'..' is not allowed"),
        ("day/../../outside.mcap", "'..' is not allowed"),
        ("/etc/passwd", "leads out of"),
        ("link.mcap", "leads out of"),
        ("folder", "its file one.mcap leads out of"),
        ("pipes", "is no regular file"),
        ("loop", "no such"),
        ("missing.mcap", "no such bag"),
        ("x" * 5000, "5000 characters is too long"),
    ],
)
def test_names_that_lead_out_are_refused(
    inside: Path, outside: Path, name: str, words: str
) -> None:
    (inside / "day").mkdir()
    (inside / "link.mcap").symlink_to(outside)
    (inside / "folder").mkdir()
    (inside / "folder" / "one.mcap").symlink_to(outside)
    (inside / "pipes").mkdir()
    os.mkfifo(inside / "pipes" / "one.mcap")
    (inside / "loop").symlink_to("loop")
    with pytest.raises(UsageError, match=words) as refused:
        confined_bag(inside, name)
    assert "\n" not in str(refused.value)


def test_folder_beside_with_the_same_beginning_is_outside(inside: Path) -> None:
    sibling = inside.with_name("bags2")
    sibling.mkdir()
    with pytest.raises(UsageError, match="leads out of"):
        confined(inside, str(sibling), "bag_directory")


@pytest.mark.parametrize(
    ("request_", "words"),
    [
        ({"bags": []}, "at least one bag"),
        ({"bags": ["../bag-1.mcap"]}, "'..' is not allowed"),
        ({"bags": ["/etc/passwd"]}, "leads out of bag_directory"),
        ({"configuration": "../config/arm2.yaml"}, "'..' is not allowed"),
        ({"configuration": "/etc/hostname"}, "leads out of the folder of the configuration"),
        ({"configuration": "arm2.urdf"}, "arm2.urdf"),
        ({"estimator": "best"}, "neither idim-iv nor idim-ls"),
        ({"timeout": -1.0}, "is no time"),
        ({"timeout": float("nan")}, "is no time"),
        ({"bags": ["broken.mcap"]}, "broken.mcap"),
        ({"bags": ["bag.truth.json"]}, "not a bag"),
    ],
)
def test_bad_request_is_one_line(served, simulated_bags: Path, request_, words: str) -> None:
    (simulated_bags / "broken.mcap").write_bytes(b"\x89MCAP0\r\n" + bytes(1000))
    request = {"bags": ["bag-1.mcap"], **request_}
    answer = served.identify(*request.pop("bags"), **request)
    assert not answer.success
    assert words in answer.message
    assert "\n" not in answer.message
    assert "Traceback" not in served.process.errors.read_text()


def test_refused_goal_is_aborted_with_the_reason(served) -> None:
    goal = served.goal("../bag-1.mcap")
    answer = served.wait(goal.get_result_async())
    assert answer.status == 6  # aborted
    assert not answer.result.success
    assert "'..' is not allowed" in answer.result.message


def test_announced_bag_is_identified(served, simulated_bags: Path) -> None:
    served.identify("bag-1.mcap")
    bag = "bag-2.mcap" if list(served.latched().parameters.bags) == ["bag-1.mcap"] else "bag-1.mcap"
    publisher = served.node.create_publisher(BagClosed, "/announced", 10)
    served.observer.until(lambda: publisher.get_subscription_count() == 1, "the identifier")
    with served.parameters(auto=True):
        publisher.publish(BagClosed(bag="/etc/passwd", complete=True))
        served.observer.until(lambda: "/etc/passwd" in served.failure(), "the refusal")
        publisher.publish(BagClosed(bag=str(simulated_bags / bag), complete=True))
        served.observer.until(lambda: list(served.latched().parameters.bags) == [bag], "the result")
    served.node.destroy_publisher(publisher)


def test_announced_bag_is_left_alone_without_auto_and_if_it_is_not_whole() -> None:
    node, asked = SimpleNamespace(_managed=SimpleNamespace(state=ACTIVE)), []
    node._submit = lambda _, request, listener: asked.extend(request.bags)
    node.node = SimpleNamespace(get_logger=lambda: SimpleNamespace(warning=print))
    for auto, complete in ((False, True), (True, False), (True, True)):
        node._settings = IdentifierSettings(auto=auto)
        Identifier._bag_closed(node, BagClosed(bag=f"{auto} {complete}", complete=complete))
    assert asked == ["True True"]


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("when_busy", "perhaps", "neither wait nor refuse"),
        ("job_timeout", 0.0, "range"),
        ("queue_limit", 0, "range"),
        ("drift_significance", 2.0, "range"),
        ("output_directory", "/tmp", "read-only"),
        ("configuration", "/nonexistent.yaml", "cannot read the configuration"),
    ],
)
def test_wrong_values_are_refused(served, name: str, value: object, words: str) -> None:
    answer = served.set(**{name: value})
    assert not answer.successful
    assert words in answer.reason


def test_configuration_is_read_anew_when_it_is_set(served, tmp_path: Path) -> None:
    path = tmp_path / "arm.yaml"
    urdf = ARM2.with_name("arm2.urdf")
    text = ARM2.read_text().replace("urdf: arm2.urdf", f"urdf: {urdf}")
    path.write_text(text)
    with served.parameters(configuration=str(path)):
        path.write_text(text + "nonsense: 1\n")
        refused = served.set(configuration=str(path))
        assert not refused.successful
        assert refused.reason == f"configuration: {path}: unknown key nonsense"
        path.write_text(text.replace("joint_states: joint_states", "joint_states: joint states"))
        assert "'joint states' is no topic of ROS" in served.set(configuration=str(path)).reason
        path.write_text(text + "identification:\n  friction: [viscous, coulomb]\n")
        assert served.set(configuration=str(path)).successful
        result = served.identify("bag-1.mcap", estimator="idim-ls").result
        names = [parameter.name for parameter in result.parameters.estimates]
    assert "Fc1" in names
    assert "off1" not in names


def test_an_integer_is_taken_for_a_number(served) -> None:
    with served.parameters(job_timeout=5):
        assert served.parameter("job_timeout").double_value == 5.0


def test_it_says_that_it_is_ready(served, simulated_bags: Path) -> None:
    ready = f"ready: {ARM2}; identifies on request, from bags in {simulated_bags}"
    assert ready in served.process.errors.read_text()
