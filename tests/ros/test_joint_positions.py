"""Where a robot is that publishes no JointState: what its controller or its driver says."""

from contextlib import ExitStack

from rclpy.duration import Duration
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectoryPoint

from idim_iv_ros.nodes.joint_topic import JointPositions
from tests.ros.processes import HANG, LATCHED, Observer

JOINTS = ["a", "b"]
ALL = Duration(seconds=HANG)


def test_positions_are_read_from_a_named_field_of_any_type(
    observer: Observer, stack: ExitStack
) -> None:
    node = observer.node
    publisher = node.create_publisher(JointTrajectoryPoint, "/arm/point", 1)
    stack.callback(node.destroy_publisher, publisher)
    places = JointPositions(node, "/arm/point#positions", JOINTS)
    stack.callback(places.close)
    assert places.topic == "/arm/point"
    assert places.age() == float("inf")

    def heard() -> bool:
        publisher.publish(JointTrajectoryPoint(positions=[1.0, 2.0], effort=[5.0, 6.0]))
        return places.last is not None

    observer.until(heard, "positions")
    assert places.last is not None
    assert places.last.position.tolist() == [1.0, 2.0]
    assert places.age() < float("inf")
    assert places.problem == ""


def test_old_news_is_no_news(observer: Observer, stack: ExitStack) -> None:
    """Neither a message from before anybody listened, nor one that is repeated."""
    node = observer.node
    publisher = node.create_publisher(JointState, "/arm/latched", LATCHED)
    stack.callback(node.destroy_publisher, publisher)
    message = JointState(name=["b", "a"], position=[2.0, 1.0])
    message.header.stamp = node.get_clock().now().to_msg()
    publisher.publish(message)
    places = JointPositions(node, "/arm/latched", JOINTS)
    stack.callback(places.close)
    observer.until(lambda: publisher.get_subscription_count() > 0, "a subscription")
    places._look()
    assert places.last is None
    publisher.publish(message)
    observer.until(lambda: places.last is not None, "positions")
    first = places.last
    assert first is not None
    assert first.position.tolist() == [1.0, 2.0]
    publisher.publish(message)
    publisher.wait_for_all_acked(ALL)
    places._look()
    assert places.last is first


def test_reason_is_named(observer: Observer, stack: ExitStack) -> None:
    places = JointPositions(observer.node, "/arm/nothing", JOINTS)
    stack.callback(places.close)
    assert places.problem == "nobody publishes /arm/nothing"
    publisher = observer.node.create_publisher(JointState, "/arm/nothing", 1)
    stack.callback(observer.node.destroy_publisher, publisher)

    def other() -> bool:
        publisher.publish(JointState(name=["a"], position=[1.0]))
        return places.problem == "/arm/nothing: no position of b"

    observer.until(other, "a reason")
    assert places.last is None
