"""The proposal as a YAML file in which every key has its line: meaning, default, an example."""

import io
from pathlib import Path
from typing import NamedTuple

from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedMap

from idim_iv_ros.errors import UsageError
from idim_iv_ros.files import FilePath, require_replaceable, signed, write_together
from idim_iv_ros.first_configuration.proposal import Proposal

_WIDTH = 10_000  # no value is broken over lines


class Key(NamedTuple):
    """One key."""

    meaning: str  # With its unit
    default: str  # What holds where it is left out
    # Shown, as a comment, where nothing is proposed; an `Each` is repeated for each joint
    example: object


class Each(NamedTuple):
    """An example for each joint."""

    value: float


_SIMULATED = "only read by `idim-iv simulate`"

SECTIONS: dict[str, dict[str, Key]] = {
    "robot": {
        "name": Key("shown in reports", "the URDF's name", "my_arm"),
        "urdf": Key("path relative to this file", "/robot_description of the bag", "my_arm.urdf"),
        "mjcf": Key("an MJCF instead of the URDF; needs the extra `mujoco`", "none", "my_arm.xml"),
        "joints": Key("identified; every other joint is locked at zero", "required", []),
        "gravity": Key("m/s² in the base frame", "[0, 0, -9.81]", [0.0, 0.0, -9.81]),
        "position_offset": Key("rad (m), added to the measured positions", "0", Each(0.0)),
        "motor_to_joint": Key(
            "matrix R, motor position = R · joint position; signals are then the motors'",
            "signals are on the joint side",
            [[100.0, 0.0], [0.0, 100.0]],
        ),
        "motor_to_joint_torque": Key(
            "joint torque = this matrix · motor torque", "Rᵀ", [[100.0, 0.0], [0.0, 100.0]]
        ),
        "couplings": Key(
            "pairs of joints: the motor of the second turns with both",
            "none",
            [{"joints": ["joint_5", "joint_6"]}],
        ),
    },
    "simulator": {
        "armature": Key(
            "kg m² (kg), drive inertia on the joint side in your simulator; give it to diagnose",
            "0",
            Each(0.1),
        ),
        "torque_offset": Key(
            "N m (N), constant torques that the motors of your simulator overcome", "0", Each(0.1)
        ),
    },
    "controller": {
        "type": Key("pd, cascade or unknown (fitted from each recording)", "unknown", "unknown"),
        "kp": Key("N m/rad (cascade: 1/s), on the position error", "none", Each(100.0)),
        "kd": Key("N m s/rad, on the velocity error (pd)", "none", Each(10.0)),
        "ki": Key("N m/(rad s), on the integral of the position error (pd)", "0", Each(0.0)),
        "kv": Key("N m s/rad, of the velocity loop (cascade)", "none", Each(10.0)),
        "drive_gain": Key("N m per unit of the velocity loop's output (cascade)", "1", Each(1.0)),
        "velocity_reference": Key("false: kd acts on the measured velocity alone", "true", True),
        "torque_limit": Key("N m (N), where the controller clips", "none", Each(100.0)),
        "period": Key("s, of the controller", "the sampling interval", 0.001),
        "delay": Key("s, from the command to the torque", "0", 0.0),
    },
    "signals": {
        "joint_states": Key(
            "sensor_msgs/JointState, or what ros2_control publishes; without a leading slash: in "
            "the namespace of the robot",
            "joint_states",
            "joint_states",
        ),
        "effort": Key(
            "also std_msgs/Float64MultiArray; none: the robot has no efforts (`idim-iv servo`)",
            "joint_states",
            "/joint_states",
        ),
        "reference": Key(
            "what the controller was asked for: a JointState or a controller_state",
            "no reference",
            "/joint_trajectory_controller/controller_state",
        ),
        "reference_delay": Key(
            "s, from the reference to its effect; only read where effort is none", "0", 0.02
        ),
        "link_states": Key(
            "sensor_msgs/JointState of encoders behind the gears: shows stiffness and play",
            "none",
            "/link_states",
        ),
        "effort_scale": Key(
            "what arrives to N m (N), e.g. torque constant · gear ratio", "1", Each(1.0)
        ),
        "effort_unit": Key("N m, A or V: the unit after the scale", "N m", "N m"),
    },
    "processing": {
        "position_cutoff": Key("Hz, low-pass of the positions", "from the data", 50.0),
        "position_order": Key("of that filter, one pass", "4", 4),
        "decimation_cutoff": Key("Hz, low-pass before decimation", "0.4 position_cutoff", 20.0),
        "decimation_edge": Key("end of that filter, share of the new Nyquist rate", "0.95", 0.95),
        "decimation_phase": Key("first or last sample of each group is kept", "first", "first"),
        "minimum_speed": Key(
            "rad/s (m/s), slower samples are left out", "1 % of the peak speed", Each(0.02)
        ),
        "reversal_margin": Key("decimated samples left out beside a slow one", "1", 1.0),
        "trim": Key("s, cut at start and end", "from the filters", [0.5, 0.5]),
    },
    "identification": {
        "friction": Key("terms of the model", "all three", ["viscous", "coulomb", "offset"]),
        "drive_inertia": Key("whether drives have an inertia of their own", "true", True),
        "exclude": Key("base parameters that are taken out of the model", "none", ["off1"]),
        "start": Key("given (URDF and armature) or regular (unit inertias)", "given", "given"),
        "tolerance": Key("relative change that ends the iteration", "0.01", 0.01),
        "max_iterations": Key("of IDIM-IV", "10", 10),
        "significance": Key("level of all tests", "0.05", 0.05),
    },
    "simulated_robot": {
        "parameters": Key(f"true base parameters by name; {_SIMULATED}", "as given", {"Fv1": 2.0}),
        "rate": Key("Hz, of the recording", "that of the control", 1000.0),
        "position_noise": Key("rad (m), standard deviation", "0", Each(2e-5)),
        "encoder_resolution": Key("rad (m), step of the positions", "0", Each(1e-5)),
        "torque_noise": Key("N m (N), standard deviation", "0", Each(0.1)),
        "disturbance": Key("N m (N), of a torque that nothing explains", "0", Each(0.1)),
        "disturbance_bandwidth": Key("Hz, of its low-pass", "10", 10.0),
        "stamp_jitter": Key("s, standard deviation of the stamps", "0", 0.0),
        "delay": Key("s, true delay of the command", "controller.delay", 0.0),
        "plant_step": Key("s, of the simulation", "a quarter of the period", 0.00025),
    },
}


def configuration_text(proposal: Proposal, out: FilePath) -> str:
    """Return the text of a configuration file at `out`."""
    values = proposal.values_for(Path(out))
    bags = " ".join(path.name for path in proposal.bags)
    lines = [
        f"# A first configuration, made by idim-iv init from {' '.join(bags.split())}.",
        "# Lists are in the order of robot.joints. A line that begins with # is a key that is left",
        "# out; behind its example: what it means, and what holds without it. All keys at length:",
        "# docs/configuration.md.",
    ]
    for section, keys in SECTIONS.items():
        given = values.get(section, {})
        lines += ["", f"{section}:" if given else f"# {section}:"]
        for name, key in keys.items():
            lines.append(_line(proposal, section, name, key, given))
            if (section, name) == ("robot", "joints"):
                left_out = proposal.left_out.items()
                lines += [f"  # left out: {joint}: {reason}" for joint, reason in left_out]
    return signed("\n".join(lines) + "\n")


def write_configuration(proposal: Proposal, out: FilePath, *, force: bool = False) -> Path:
    """Write the proposal as a configuration file.

    Raises
    ------
    UsageError
        It cannot be written, or a file of the user is in its place.
    """
    path = Path(out)
    require_replaceable([path], force=force)
    try:
        write_together({path: configuration_text(proposal, path)})
    except OSError as error:
        raise UsageError(f"{path}: cannot be written: {error.strerror or error}") from error
    return path


def _line(proposal: Proposal, section: str, name: str, key: Key, given: dict[str, object]) -> str:
    """One key with its value, or as a comment with its example."""
    reason = proposal.reasons.get((section, name), "")
    about = f"{key.meaning}; default: {key.default}"
    if name in given:
        return f"  {_yaml(name, given[name])}  # {f'{about}. {reason}' if reason else about}"
    example = key.example
    if (section, name) == ("controller", "torque_limit") and proposal.limits:
        example = list(proposal.limits)
    elif isinstance(example, Each):
        example = [example.value] * len(proposal.joints)
    return f"  # {_yaml(name, example)}  # {f'{about}. {reason}' if reason else about}"


def _yaml(name: str, value: object) -> str:
    """``name: value`` in one line."""
    yaml = YAML()
    yaml.default_flow_style = True
    yaml.width = _WIDTH
    stream = io.StringIO()
    mapping = CommentedMap({name: value})
    mapping.fa.set_block_style()
    yaml.dump(mapping, stream)
    return stream.getvalue().strip()
