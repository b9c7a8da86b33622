"""A simulated robot with recorder, identifier, predictor and collector, on this machine only.

ros2 launch idim_iv_ros demo.launch.py
ros2 launch idim_iv_ros demo.launch.py namespace:=left

It takes the arguments of robot.launch.py, and says what to do next.
"""

from pathlib import Path

from launch import LaunchDescription
from launch.actions import (
    DeclareLaunchArgument,
    IncludeLaunchDescription,
    SetEnvironmentVariable,
    UnsetEnvironmentVariable,
)
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.substitutions import FindPackageShare

SWITCHES = {
    "simulate": "true: a simulated robot too",
    "predict": "true: the predictor too, which idim-iv watch shows",
    "collect": "true: the collector too; it moves nothing before allow_motion is set",
    "auto": "true: identify every bag that is closed",
}


def generate_launch_description() -> LaunchDescription:
    """Return what robot.launch.py starts for a simulated robot."""
    arm = PathJoinSubstitution([FindPackageShare("idim_iv_ros"), "config", "arm2.yaml"])
    defaults = {"configuration": arm, **dict.fromkeys(SWITCHES, "true")}
    about = {"configuration": "the robot's YAML file", **SWITCHES}
    return LaunchDescription(
        [
            *(
                DeclareLaunchArgument(name, default_value=value, description=about[name])
                for name, value in defaults.items()
            ),
            UnsetEnvironmentVariable("ROS_LOCALHOST_ONLY"),  # it would win over the next
            SetEnvironmentVariable("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST"),
            IncludeLaunchDescription(
                PythonLaunchDescriptionSource(str(Path(__file__).with_name("robot.launch.py"))),
                launch_arguments=[(name, LaunchConfiguration(name)) for name in defaults],
            ),
        ]
    )
