"""A kinematic robot behind the action of ros2_control, in a process that has control_msgs.

    trajectory_server.py BAG

The parameter `mode` says what becomes of goals: follow, refuse or abort.
"""

import sys
import time
from pathlib import Path

import rclpy
from control_msgs.action import FollowJointTrajectory
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.executors import MultiThreadedExecutor

from tests.ros.kinematic_robot import KinematicRobot


def main() -> None:
    rclpy.init()
    node = rclpy.create_node("controller")
    node.declare_parameter("mode", "follow")
    robot = KinematicRobot(node, "arm", Path(sys.argv[1]))

    def mode() -> str:
        return node.get_parameter("mode").value

    def execute(goal):
        robot.follow(goal.request.trajectory)
        result = FollowJointTrajectory.Result()
        while robot.moving:
            time.sleep(0.01)
            if goal.is_cancel_requested:
                robot.hold()
                goal.canceled()
                return result
            if mode() == "abort":
                robot.hold()
                goal.abort()
                result.error_code = FollowJointTrajectory.Result.PATH_TOLERANCE_VIOLATED
                result.error_string = "joint_2 is late"
                return result
        goal.succeed()
        return result

    ActionServer(
        node,
        FollowJointTrajectory,
        "/arm/follow_joint_trajectory",
        execute,
        goal_callback=lambda _: GoalResponse.REJECT if mode() == "refuse" else GoalResponse.ACCEPT,
        cancel_callback=lambda _: CancelResponse.ACCEPT,
        callback_group=ReentrantCallbackGroup(),
    )
    executor = MultiThreadedExecutor(4)
    executor.add_node(node)
    executor.spin()


main()
