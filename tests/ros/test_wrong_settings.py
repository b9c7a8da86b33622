"""What nodes say of a configuration that is none: one line that names the parameter."""

from collections.abc import Iterator
from pathlib import Path

import pytest
import rclpy
from rclpy.node import Node
from rclpy.parameter import Parameter

from idim_iv_ros.errors import UsageError
from idim_iv_ros.nodes.collector.controller import Controller
from idim_iv_ros.nodes.collector.settings import CollectorSettings
from idim_iv_ros.nodes.parameters import Settings, changed, declare, read_configuration
from idim_iv_ros.nodes.predictor.node import PredictorSettings
from idim_iv_ros.nodes.recorder.settings import RecorderSettings
from idim_iv_ros.nodes.recorder.topic_set import TopicSet
from tests.ros.conftest import ARM2


@pytest.fixture
def node() -> Iterator[Node]:
    context = rclpy.Context()
    rclpy.init(args=["--ros-args", "-p", "configuration:=/no/such.yaml"], context=context)
    node = Node("wrong", context=context)
    yield node
    node.destroy_node()
    context.try_shutdown()


@pytest.fixture
def no_topic(tmp_path: Path) -> Path:
    """A configuration whose joint states are no topic."""
    file = tmp_path / "arm.yaml"
    text = Path(ARM2).read_text().replace("states: joint_states", "states: joint states")
    file.write_text(text.replace("arm2.urdf", str(Path(ARM2).with_name("arm2.urdf"))))
    return file


@pytest.mark.parametrize("kind", [CollectorSettings, PredictorSettings, RecorderSettings])
def test_a_file_that_is_not_there_is_named_with_its_parameter(
    node: Node, kind: type[Settings]
) -> None:
    words = "^parameter configuration: /no/such.yaml: cannot read the configuration"
    with pytest.raises(UsageError, match=words):
        declare(node, kind)


@pytest.mark.parametrize("kind", [CollectorSettings, PredictorSettings, RecorderSettings])
def test_a_file_that_is_gone_by_now_refuses_only_what_reads_it(kind: type[Settings]) -> None:
    settings = kind(**{"configuration": "/no/such.yaml"})
    clock = Parameter("use_sim_time", Parameter.Type.BOOL, True)
    assert changed(settings, [clock]) is settings
    file = Parameter("configuration", Parameter.Type.STRING, "/no/other.yaml")
    with pytest.raises(UsageError, match=r"^configuration: /no/other\.yaml: "):
        changed(settings, [clock, file])


def test_what_is_no_topic_is_named_with_its_file(node: Node, no_topic: Path) -> None:
    words = f"^configuration: {no_topic}: signals: 'joint states' is no topic of ROS"
    with pytest.raises(UsageError, match=words):
        read_configuration(node, str(no_topic))
    with pytest.raises(UsageError, match=words):
        TopicSet(node, RecorderSettings(configuration=str(no_topic)), print)


def test_a_controller_without_a_name_of_ros_is_refused(node: Node) -> None:
    for name in ("my controller", "/arm/", "1arm"):
        with pytest.raises(UsageError, match=r"^parameter controller: "):
            Controller(node, name, "topic")
