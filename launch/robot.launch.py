"""Recorder and identifier beside a real robot.

ros2 launch idim_iv_ros robot.launch.py configuration:=my_arm.yaml
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue


def generate_launch_description() -> LaunchDescription:
    """Return the two nodes."""
    configuration = ParameterValue(LaunchConfiguration("configuration"), value_type=str)
    bags = ParameterValue(LaunchConfiguration("bags"), value_type=str)
    return LaunchDescription(
        [
            DeclareLaunchArgument("configuration", description="the robot's YAML file"),
            DeclareLaunchArgument("bags", default_value="bags", description="folder of the bags"),
            DeclareLaunchArgument(
                "results", default_value="results", description="folder of the results"
            ),
            DeclareLaunchArgument(
                "auto", default_value="false", description="identify every bag that is closed"
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
                        "output_directory": ParameterValue(
                            LaunchConfiguration("results"), value_type=str
                        ),
                        "auto": ParameterValue(LaunchConfiguration("auto"), value_type=bool),
                    }
                ],
                output="screen",
            ),
        ]
    )
