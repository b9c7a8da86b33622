"""Recorder and identifier beside a robot, in its namespace.

ros2 launch idim_iv_ros robot.launch.py configuration:=my_arm.yaml
ros2 launch idim_iv_ros robot.launch.py configuration:=my_arm.yaml namespace:=left \
    params_file:=my_parameters.yaml log_level:=debug

An argument that is not given leaves its parameter to `params_file`, and else to the node. Bags and
results go to `bags` and `results` (of a robot in a namespace: to folders of its name in there)
where neither says otherwise.
"""

from pathlib import PurePosixPath

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, LogInfo, OpaqueFunction, TimerAction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

RECORDER, IDENTIFIER, SIMULATOR = "recorder", "identifier", "robot_simulator"
ALL = (RECORDER, IDENTIFIER, SIMULATOR)

# Argument: nodes, their parameter, its type, what it is.
PARAMETERS = {
    "configuration": (ALL, "configuration", str, "the robot's YAML file"),
    "bags": ((RECORDER, IDENTIFIER), "bag_directory", str, "folder of the bags"),
    "results": ((IDENTIFIER,), "output_directory", str, "folder of the results"),
    "bag_prefix": ((RECORDER,), "bag_prefix", str, "how the names of the bags begin"),
    "record": ((RECORDER,), "autostart", bool, "true: begin to record at once"),
    "auto": ((IDENTIFIER,), "auto", bool, "true: identify every bag that is closed"),
    "autostart": (
        (IDENTIFIER,),
        "autostart",
        bool,
        "false: the identifier waits to be configured and activated (ros2 lifecycle set)",
    ),
    "use_sim_time": (ALL, "use_sim_time", bool, "true: the time is that of /clock"),
}
OTHERS = {
    "namespace": ("", "of all nodes, and of the topics that the configuration names relatively"),
    "params_file": ("", "parameters of the nodes; params/nodes.yaml lists them all"),
    "log_level": ("info", "debug, info, warn, error or fatal"),
    "simulate": ("false", "true: a simulated robot too"),
}
AFTER_THE_NODES = 4.0  # s


def generate_launch_description() -> LaunchDescription:
    """Return the arguments and what makes the nodes of them."""
    optional = {name: ("", about) for name, (*_, about) in PARAMETERS.items()} | OTHERS
    _, about = optional.pop("configuration")
    arguments = [
        DeclareLaunchArgument("configuration", description=about),
        *(
            DeclareLaunchArgument(name, default_value=default, description=about)
            for name, (default, about) in optional.items()
        ),
    ]
    return LaunchDescription([*arguments, OpaqueFunction(function=_nodes)])


def _nodes(context: LaunchContext) -> list:
    given = {name: LaunchConfiguration(name).perform(context) for name in (*PARAMETERS, *OTHERS)}
    namespace = given["namespace"].strip("/")
    if not given["params_file"]:
        for name in ("bags", "results"):
            given[name] = given[name] or str(PurePosixPath(name, namespace))
    executables = ALL if _truth("simulate", given["simulate"]) else (RECORDER, IDENTIFIER)
    nodes = [
        Node(
            package="idim_iv_ros",
            executable=executable,
            namespace=namespace,
            parameters=[
                *([given["params_file"]] if given["params_file"] else []),
                _parameters(executable, given),
            ],
            ros_arguments=["--log-level", given["log_level"]],
            output="screen",
        )
        for executable in executables
    ]
    lines = [LogInfo(msg=line) for line in _next_steps(namespace, given, executables)]
    return [*nodes, TimerAction(period=AFTER_THE_NODES, actions=lines)]


def _parameters(executable: str, given: dict) -> dict:
    """Parameters of a node that arguments set."""
    return {
        # A path or prefix is text, also where it looks like a number.
        parameter: ParameterValue(given[name], value_type=str)
        if kind is str
        else _truth(name, given[name])
        for name, (executables, parameter, kind, _) in PARAMETERS.items()
        if executable in executables and given[name]
    }


def _truth(name: str, text: str) -> bool:
    if text.lower() not in ("true", "false"):
        raise RuntimeError(f"argument {name}: {text!r} is neither true nor false")
    return text.lower() == "true"


def _next_steps(namespace: str, given: dict, executables: tuple) -> list:
    """What to do next, one command a line."""
    of = f"/{namespace}/" if namespace else "/"
    call = "ros2 service call"
    steps = [f"next: {call} {of}recorder/start std_srvs/srv/Trigger"]
    if given["autostart"].lower() == "false":
        steps += [f"ros2 lifecycle set {of}identifier {step}" for step in ("configure", "activate")]
    if SIMULATOR in executables:
        steps.append(f"{call} {of}robot_simulator/move std_srvs/srv/Trigger")
        steps.append(f"ros2 topic echo --once {of}robot_simulator/moving    # until it is false")
    else:
        steps.append("move the robot (idim-iv excite writes a motion that shows its parameters)")
    steps.append(f"{call} {of}recorder/stop std_srvs/srv/Trigger")
    if given["auto"].lower() == "true":
        steps.append(f"ros2 topic echo {of}identifier/result --qos-durability transient_local")
    else:
        steps.append(
            f"{call} {of}identifier/identify idim_iv_interfaces/srv/Identify "
            '"{bags: [BAG]}"    # the folder that stop named'
        )
    return steps
