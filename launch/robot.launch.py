"""Recorder and identifier beside a robot, in its namespace; on request predictor and collector.

ros2 launch idim_iv_ros robot.launch.py configuration:=my_arm.yaml
ros2 launch idim_iv_ros robot.launch.py configuration:=my_arm.yaml namespace:=left \
    params_file:=my_parameters.yaml log_level:=debug predict:=true

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

RECORDER, IDENTIFIER, PREDICTOR = "recorder", "identifier", "predictor"
COLLECTOR, SIMULATOR = "collector", "robot_simulator"
ALL = (RECORDER, IDENTIFIER, PREDICTOR, COLLECTOR, SIMULATOR)

# Argument: nodes, their parameter, its type, what it is.
PARAMETERS = {
    "configuration": (ALL, "configuration", str, "the robot's YAML file"),
    "bags": ((RECORDER, IDENTIFIER), "bag_directory", str, "folder of the bags"),
    "results": ((IDENTIFIER, PREDICTOR), "output_directory", str, "folder of the results"),
    "bag_prefix": ((RECORDER,), "bag_prefix", str, "how the names of the bags begin"),
    "record": ((RECORDER,), "autostart", bool, "true: begin to record at once"),
    "auto": ((IDENTIFIER,), "auto", bool, "true: identify every bag that is closed"),
    "autostart": (
        (IDENTIFIER,),
        "autostart",
        bool,
        "false: the identifier waits to be configured and activated (ros2 lifecycle set)",
    ),
    "controller": ((COLLECTOR,), "controller", str, "moves the robot for the collector"),
    "use_sim_time": (ALL, "use_sim_time", bool, "true: the time is that of /clock"),
}
OTHERS = {
    "namespace": ("", "of all nodes, and of the topics that the configuration names relatively"),
    "params_file": ("", "parameters of the nodes; params/nodes.yaml lists them all"),
    "log_level": ("info", "debug, info, warn, error or fatal"),
    "predict": ("false", "true: the predictor too, which idim-iv watch shows"),
    "collect": ("false", "true: the collector too; it moves nothing before allow_motion is set"),
    "simulate": ("false", "true: a simulated robot too"),
}
OPTIONAL = {"predict": PREDICTOR, "collect": COLLECTOR, "simulate": SIMULATOR}
# It simulates a motion before it begins it.
OF_THE_SIMULATOR = {"controller": SIMULATOR, "start_delay": 60.0}
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
    wanted = [node for name, node in OPTIONAL.items() if _truth(name, given[name])]
    executables = (RECORDER, IDENTIFIER, *wanted)
    simulated = SIMULATOR in executables and not given["controller"]
    nodes = [
        Node(
            package="idim_iv_ros",
            executable=executable,
            namespace=namespace,
            parameters=[
                *([OF_THE_SIMULATOR] if simulated and executable == COLLECTOR else []),
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
    steps = []
    if given["autostart"].lower() == "false":
        steps += [f"ros2 lifecycle set {of}identifier {step}" for step in ("configure", "activate")]
    auto = given["auto"].lower() == "true"
    if COLLECTOR in executables:
        steps += _by_collector(of, auto)
    else:
        steps += _by_hand(of, auto, SIMULATOR in executables)
    if auto:
        steps.append(f"ros2 topic echo {of}identifier/result --qos-durability transient_local")
    if PREDICTOR in executables:
        steps.append("idim-iv watch" + f" --namespace {namespace}" * bool(namespace))
    return [f"next: {steps[0]}", *steps[1:]]


def _by_collector(of: str, auto: bool) -> list:
    """Have the robot moved, recorded and identified; `auto` identifies every bag anyway."""
    goal = "{}" if auto else "{identify: true}"
    return [
        f"ros2 param set {of}collector allow_motion true    # nobody near, its way free",
        f"ros2 action send_goal --feedback {of}collector/collect "
        f'idim_iv_interfaces/action/Collect "{goal}"',
    ]


def _by_hand(of: str, auto: bool, simulated: bool) -> list:
    """Record and identify without the collector."""
    call = "ros2 service call"
    steps = [f"{call} {of}recorder/start std_srvs/srv/Trigger"]
    if simulated:
        steps.append(f"{call} {of}robot_simulator/move std_srvs/srv/Trigger")
        steps.append(f"ros2 topic echo --once {of}robot_simulator/moving    # until it is false")
    else:
        steps.append("move the robot (idim-iv excite writes a motion that shows its parameters)")
    steps.append(f"{call} {of}recorder/stop std_srvs/srv/Trigger")
    if not auto:
        steps.append(
            f"{call} {of}identifier/identify idim_iv_interfaces/srv/Identify "
            '"{bags: [BAG]}"    # the folder that stop named'
        )
    return steps
