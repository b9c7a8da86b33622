"""A simulated robot, the recorder and the identifier, on this machine only.

ros2 launch idim_iv_ros demo.launch.py
ros2 service call /recorder/start std_srvs/srv/Trigger
ros2 service call /robot_simulator/move std_srvs/srv/Trigger
ros2 service call /recorder/stop std_srvs/srv/Trigger       # when ~/moving is false again
ros2 topic echo /identifier/result --qos-durability transient_local
"""

from launch import LaunchDescription
from launch.actions import (
    DeclareLaunchArgument,
    SetEnvironmentVariable,
    UnsetEnvironmentVariable,
)
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare


def generate_launch_description() -> LaunchDescription:
    """Return the three nodes."""
    configuration = ParameterValue(LaunchConfiguration("configuration"), value_type=str)
    bags = ParameterValue(LaunchConfiguration("bags"), value_type=str)
    results = ParameterValue(LaunchConfiguration("results"), value_type=str)
    arm = PathJoinSubstitution([FindPackageShare("idim_iv_ros"), "config", "arm2.yaml"])
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                "configuration", default_value=arm, description="the robot's YAML file"
            ),
            DeclareLaunchArgument("bags", default_value="bags", description="folder of the bags"),
            DeclareLaunchArgument(
                "results", default_value="results", description="folder of the results"
            ),
            UnsetEnvironmentVariable("ROS_LOCALHOST_ONLY"),  # it would win over the next
            SetEnvironmentVariable("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST"),
            Node(
                package="idim_iv_ros",
                executable="robot_simulator",
                parameters=[{"configuration": configuration}],
                output="screen",
            ),
            Node(
                package="idim_iv_ros",
                executable="recorder",
                parameters=[{"configuration": configuration, "bag_directory": bags}],
                output="screen",
            ),
            Node(
                package="idim_iv_ros",
                executable="identifier",
                parameters=[
                    {
                        "configuration": configuration,
                        "bag_directory": bags,
                        "output_directory": results,
                        "auto": True,
                    }
                ],
                output="screen",
            ),
        ]
    )
