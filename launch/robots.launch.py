"""Recorder and identifier of several robots, each in a namespace of its own.

ros2 launch idim_iv_ros robots.launch.py robots:=left,right configuration:=my_arm.yaml
ros2 launch idim_iv_ros robots.launch.py robots:=left=ur5.yaml,right=ur10.yaml

Bags and results of a robot go to folders that are named after it, in those that the arguments or
the sections of `params_file` for several robots name. It takes the other arguments of
robot.launch.py as well, for all robots; simulate:=true tries it without any robot.
"""

from pathlib import Path, PurePosixPath

from launch import LaunchContext, LaunchDescription
from launch.actions import (
    DeclareLaunchArgument,
    GroupAction,
    IncludeLaunchDescription,
    OpaqueFunction,
)
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration

ROBOT = str(Path(__file__).with_name("robot.launch.py"))


def generate_launch_description() -> LaunchDescription:
    """Return the arguments and what includes a launch file for each robot."""
    arguments = {
        "robots": "namespaces separated by commas, each with =FILE where it has its own YAML file",
        "configuration": "the YAML file of robots that have none of their own",
        "bags": "folder of the robots' folders of bags",
        "results": "folder of the robots' folders of results",
    }
    defaults = {"configuration": "", "bags": "", "results": ""}
    return LaunchDescription(
        [
            *(
                DeclareLaunchArgument(
                    name,
                    description=about,
                    **({"default_value": defaults[name]} if name in defaults else {}),
                )
                for name, about in arguments.items()
            ),
            OpaqueFunction(function=_robots),
        ]
    )


def _robots(context: LaunchContext) -> list:
    robots, common, bags, results = (
        LaunchConfiguration(name).perform(context)
        for name in ("robots", "configuration", "bags", "results")
    )
    groups, met = [], set()
    for entry in robots.split(","):
        namespace, _, own = entry.strip().partition("=")
        namespace, configuration = namespace.strip("/"), own or common
        if not namespace or namespace in met:
            raise RuntimeError(f"argument robots: {robots!r} has no name, or one twice")
        if not configuration:
            raise RuntimeError(f"argument robots: {namespace} has no YAML file: {namespace}=FILE")
        met.add(namespace)
        arguments = {
            "namespace": namespace,
            "configuration": configuration,
            "bags": str(PurePosixPath(bags, namespace)) if bags else "",
            "results": str(PurePosixPath(results, namespace)) if results else "",
            "several": "true",
        }
        included = IncludeLaunchDescription(
            PythonLaunchDescriptionSource(ROBOT), launch_arguments=[*arguments.items()]
        )
        groups.append(GroupAction([included]))  # what one robot is given is not the next one's
    return groups
