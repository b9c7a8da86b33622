"""A node that reads what it is given and meets no other."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest
import rclpy
from rclpy.node import Node


@contextmanager
def node_alone(name: str, *arguments: str, **options: Any) -> Iterator[Node]:
    """Make a node without discovery, with arguments of ROS and options of rclpy's `Node`.

    Where participants come and go in one domain, Fast DDS 2.14 now and then never returns from the
    removal of one.
    """
    context = rclpy.Context()
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "OFF")
        rclpy.init(args=["node", "--ros-args", *arguments], context=context)
        try:
            node = Node(name, context=context, **options)
            yield node
            node.destroy_node()
        finally:
            context.try_shutdown()
