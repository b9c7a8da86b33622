"""Recorder and identifier beside a robot, in its namespace; on request predictor and collector.

ros2 launch idim_iv_ros robot.launch.py configuration:=my_arm.yaml
ros2 launch idim_iv_ros robot.launch.py configuration:=my_arm.yaml namespace:=left \
    params_file:=my_parameters.yaml log_level:=debug predict:=true

An argument that is not given leaves its parameter to `params_file`, and else to the node. Bags and
results go to `bags` and `results` (of a robot in a namespace: to folders of its name in there)
where neither says otherwise.
"""

import re
from pathlib import Path, PurePosixPath

import yaml
from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, LogInfo, OpaqueFunction, RegisterEventHandler
from launch.event_handlers import OnProcessIO
from launch.events.process import ProcessIO
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
    "record": ((RECORDER,), "record", bool, "true: begin to record at once"),
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
# It simulates a motion before it begins it, and has to share its processor.
OF_THE_SIMULATOR = {"controller": SIMULATOR, "start_delay": 60.0, "stale_after": 2.0}
FOLDERS = ("bags", "results")  # where nothing else is said
QUIET = ("warn", "error", "fatal")  # log levels at which no node says that it is ready
READY = re.compile(r"\b(ready( after [\d.]+ s)?|unconfigured): ")


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
    # Of robots.launch.py: what is said of all robots is the folder of their folders.
    several = bool(LaunchConfiguration("several", default="").perform(context))
    namespace = given["namespace"].strip("/")
    file = [given["params_file"]] if given["params_file"] else []
    sections = _sections(_read(*file)) if file else []
    wanted = [node for name, node in OPTIONAL.items() if _truth(name, given[name])]
    executables = (RECORDER, IDENTIFIER, *wanted)
    nodes = []
    for executable in executables:
        name = str(PurePosixPath("/", namespace, executable))
        in_file = {}
        for section, values in sections:
            if _matches(section, name):
                in_file |= {key: (value, "*" in section) for key, value in values.items()}
        parameters = _folders(executable, namespace, in_file, several)
        if executable == COLLECTOR and SIMULATOR in executables:
            parameters |= {k: value for k, value in OF_THE_SIMULATOR.items() if k not in in_file}
        nodes.append(
            Node(
                package="idim_iv_ros",
                executable=executable,
                # With the name in full, what follows wins over all sections that the file has.
                name=executable,
                namespace=namespace,
                parameters=[*file, parameters | _parameters(executable, given)],
                ros_arguments=["--log-level", given["log_level"]],
                output="screen",
            )
        )
    steps = _next_steps(namespace, given, executables)
    say = LogInfo(msg="\n".join(["next, in another terminal:", *steps]))
    if given["log_level"].lower() in QUIET:
        return [*nodes, say]
    waiting = dict.fromkeys(nodes, "")
    return [*(_when_ready(node, waiting, say) for node in nodes), *nodes]


def _when_ready(node: Node, waiting: dict, say: LogInfo) -> RegisterEventHandler:
    """Have the last node of those that wait followed by what there is to say."""

    def hear(event: ProcessIO) -> list | None:
        if node not in waiting:
            return None
        waiting[node] += event.text.decode(errors="replace")
        if READY.search(waiting[node]):
            del waiting[node]
            return None if waiting else [say]
        return None

    return RegisterEventHandler(OnProcessIO(target_action=node, on_stdout=hear, on_stderr=hear))


def _read(file: str) -> object:
    try:
        return yaml.safe_load(Path(file).read_text(encoding="utf-8"))
    except (OSError, ValueError, yaml.YAMLError) as error:
        why = " ".join(str(error).split())
        raise RuntimeError(f"argument params_file: cannot read {file}: {why}") from error


def _sections(document: object, name: str = "") -> list:
    """Names of the sections of a file of parameters, which may be nested, and what they hold."""
    found = []
    for key, below in document.items() if isinstance(document, dict) else ():
        if key == "ros__parameters":
            found.append((name, below if isinstance(below, dict) else {}))
        else:
            found += _sections(below, f"{name}/{str(key).strip('/')}")
    return found


def _matches(section: str, node: str) -> bool:
    """Whether a section is for a node: `*` is any one name, `**` any number of them."""
    pattern = re.escape(section).replace(r"/\*\*", "(/[^/]+)*").replace(r"/\*", "/[^/]+")
    return re.fullmatch(pattern, node) is not None


def _folders(executable: str, namespace: str, in_file: dict, several: bool) -> dict:
    """Folders of a node that nobody names, or that are named for several robots at once."""
    folders = {}
    for argument in FOLDERS:
        executables, parameter, *_ = PARAMETERS[argument]
        value, for_several = in_file.get(parameter, (argument, True))
        if executable in executables and (parameter not in in_file or (several and for_several)):
            folder = str(PurePosixPath(str(value), namespace))
            folders[parameter] = ParameterValue(folder, value_type=str)
    return folders


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
    """What to do next, one line for a shell each."""
    of = f"/{namespace}/" if namespace else "/"
    steps = []
    if given["autostart"].lower() == "false":
        steps += [f"ros2 lifecycle set {of}identifier {step}" for step in ("configure", "activate")]
    auto = given["auto"].lower() == "true"
    if COLLECTOR in executables:
        goal = "{}" if auto else "{identify: true}"  # auto identifies every bag anyway
        steps += [
            "# nobody near the robot, and its way free:",
            f"ros2 param set {of}collector allow_motion true",
            f"ros2 action send_goal --feedback {of}collector/collect "
            f'idim_iv_interfaces/action/Collect "{goal}"',
        ]
    else:
        steps += [] if auto else [f"ros2 param set {of}identifier auto true"]
        steps += _by_hand(of, SIMULATOR in executables)
    # No option of QoS: one of them alone would make it best effort, which gets no latched message.
    steps.append(f"ros2 topic echo {of}identifier/result")
    if PREDICTOR in executables:
        steps.append("idim-iv watch" + f" --namespace {namespace}" * bool(namespace))
    return steps


def _by_hand(of: str, simulated: bool) -> list:
    """Record a bag without the collector; it is identified when it is closed."""
    if simulated:
        moving = f"ros2 topic echo --once {of}robot_simulator/moving"
        motion = [
            f"ros2 service call {of}robot_simulator/move std_srvs/srv/Trigger; sleep 1",
            f"until {moving} | grep -q false; do :; done",
        ]
    else:
        motion = ["# now move the robot (idim-iv excite writes a motion that shows its parameters)"]
    return [
        f"ros2 service call {of}recorder/start std_srvs/srv/Trigger",
        *motion,
        f"ros2 service call {of}recorder/stop std_srvs/srv/Trigger",
    ]
