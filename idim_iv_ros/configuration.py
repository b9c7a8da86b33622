"""One YAML file a robot, checked key by key."""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    PrivateAttr,
    ValidationError,
    model_validator,
)

from idim_iv_ros.configuration_file import read_mapping
from idim_iv_ros.errors import UsageError
from idim_iv_ros.files import FilePath
from idim_iv_ros.signal_source import NO_EFFORT, source_text, topic_of
from idim_iv_ros.validation import first_problem, shortened

# Steps of the simulated plant in one control period.
_MOST_STEPS = 100
# Lists that do not hold one item for each joint.
_OF_ANY_LENGTH = ("joints", "gravity", "couplings", "trim", "friction", "exclude")


def _printable(text: str) -> str:
    if not text.isprintable():
        raise ValueError("holds characters that cannot be shown")
    return text


def _topic(text: str) -> str:
    if text.startswith("~"):
        raise ValueError("~ is the name of a node: write the topic without it, or in full")
    if topic_of(text).endswith("/"):
        raise ValueError("ends with a slash: no topic does")
    return text


def _not_zero(value: float) -> float:
    if abs(value) < 1e-12:
        raise ValueError("must not be zero")
    return value


# No quantity of a robot is larger in SI units; products of larger ones overflow.
_LARGEST = 1e9
Number = Annotated[float, Field(ge=-_LARGEST, le=_LARGEST)]
NotNegative = Annotated[float, Field(ge=0.0, le=_LARGEST)]
Positive = Annotated[float, Field(ge=1e-6, le=_LARGEST)]
NotZero = Annotated[Number, AfterValidator(_not_zero)]
# No recorder of a robot is faster than 100 kHz, and no control of its joints than 20 kHz; what is
# slower than 0.01 Hz is no motion.
Frequency = Annotated[float, Field(ge=0.01, le=1e5)]
Period = Annotated[float, Field(ge=5e-5, le=10.0)]
Delay = Annotated[float, Field(ge=0.0, le=1.0)]
Acceleration = Annotated[float, Field(ge=-1000.0, le=1000.0)]
Fraction = Annotated[float, Field(gt=0.0, lt=1.0)]
Name = Annotated[str, Field(min_length=1, max_length=255), AfterValidator(_printable)]
# `topic`, `topic#field` or a mapping with both; kept as text.
Topic = Annotated[Name, BeforeValidator(source_text), AfterValidator(_topic)]
# Read from YAML as text, in any mode of pydantic.
YamlPath = Annotated[Path, Field(strict=False)]
Vector = list[Number]
Matrix = list[list[Number]]
Levels = list[NotNegative]
Positives = list[Positive]


def key(meaning: str, without: str = "", example: Any = None, *, default: Any = None) -> Any:
    """Field of a section, with what `idim-iv init` writes of it.

    `meaning` has the unit; `without` is what holds where the key is left out; of `example` a list
    of one number is repeated for every joint. Both are the default where they are not given.
    """
    words: dict[str, Any] = {
        "without": without or (default if isinstance(default, str) else f"{default:g}"),
        "example": default if example is None else example,
    }
    return Field(default=default, description=meaning, json_schema_extra=words)


class Section(BaseModel):
    """Base of all sections: unknown keys are errors, text is no number, values do not change."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)


class Coupling(Section):
    """A transmission that couples two joints: the second's motor turns with both (TX40 wrist)."""

    joints: Annotated[list[Name], Field(min_length=2, max_length=2)]


class RobotSection(Section):
    """Geometry, joints and transmission; every list is in the order of `joints`."""

    name: Name | None = key("shown in reports", "the URDF's name", "my_arm")
    urdf: YamlPath | None = key(
        "path relative to this file", "/robot_description of the bag", "my_arm.urdf"
    )
    mjcf: YamlPath | None = key(
        "an MJCF instead of the URDF; needs the extra `mujoco`", "none", "my_arm.xml"
    )
    joints: Annotated[list[Name], Field(min_length=1, max_length=100)] = key(
        "identified; every other joint is locked at zero", "required", [], default=...
    )
    gravity: Annotated[list[Acceleration], Field(min_length=3, max_length=3)] = key(
        "m/s² in the base frame", "[0, 0, -9.81]", default=[0.0, 0.0, -9.81]
    )
    position_offset: Vector | None = key("rad (m), added to the measured positions", "0", [0.0])
    motor_to_joint: Matrix | None = key(
        "matrix R, motor position = R · joint position; signals are then the motors'",
        "signals are on the joint side",
        [[100.0, 0.0], [0.0, 100.0]],
    )
    motor_to_joint_torque: Matrix | None = key(
        "joint torque = this matrix · motor torque", "Rᵀ", [[100.0, 0.0], [0.0, 100.0]]
    )
    couplings: list[Coupling] = key(
        "pairs of joints: the motor of the second turns with both",
        "none",
        [{"joints": ["joint_5", "joint_6"]}],
        default=[],
    )

    @model_validator(mode="after")
    def _one_description(self) -> "RobotSection":
        if self.urdf is not None and self.mjcf is not None:
            raise ValueError("urdf and mjcf are both given: one file is the nominal model")
        return self

    @property
    def description(self) -> Path | None:
        """The file of the nominal model, URDF or MJCF."""
        return self.mjcf if self.urdf is None else self.urdf


class SimulatorSection(Section):
    """What the user's simulator holds besides the URDF."""

    armature: Levels | None = key(
        "kg m² (kg), drive inertia on the joint side in your simulator; give it to diagnose",
        "0",
        [0.1],
    )
    torque_offset: Vector | None = key(
        "N m (N), constant torques that the motors of your simulator overcome", "0", [0.1]
    )


class SimulatedRobotSection(Section):
    """The robot that `simulate` runs, where it differs from the nominal model and is not ideal."""

    parameters: dict[Name, Number] = key(
        "true base parameters by name; only read by `idim-iv simulate`",
        "as given",
        {"Fv1": 2.0},
        default={},
    )
    rate: Frequency | None = key("Hz, of the recording", "that of the control", 1000.0)
    position_noise: Levels | None = key("rad (m), standard deviation", "0", [2e-5])
    encoder_resolution: Levels | None = key("rad (m), step of the positions", "0", [1e-5])
    torque_noise: Levels | None = key("N m (N), standard deviation", "0", [0.1])
    disturbance: Levels | None = key("N m (N), of a torque that nothing explains", "0", [0.1])
    disturbance_bandwidth: Frequency = key("Hz, of its low-pass", default=10.0)
    stamp_jitter: Delay = key("s, standard deviation of the stamps", default=0.0)
    delay: Delay | None = key("s, true delay of the command", "controller.delay", 0.0)
    plant_step: Annotated[float, Field(ge=1e-6, le=10.0)] | None = key(
        "s, of the simulation", "a quarter of the period", 0.00025
    )


class ControllerSection(Section):
    """The control law of the recorded robot.

    ``pd``: tau = kp (q_ref - q) + kd (dq_ref - dq) + ki ∫(q_ref - q), with dq_ref left out when
    `velocity_reference` is false. ``cascade``: tau = drive_gain · kv (kp (q_ref - q) - dq).
    """

    type: Literal["pd", "cascade", "unknown"] = key(
        "pd, cascade or unknown (fitted from each recording)", default="unknown"
    )
    kp: Positives | None = key("N m/rad (cascade: 1/s), on the position error", "none", [100.0])
    kd: Levels | None = key("N m s/rad, on the velocity error (pd)", "none", [10.0])
    ki: Levels | None = key("N m/(rad s), on the integral of the position error (pd)", "0", [0.0])
    kv: Positives | None = key("N m s/rad, of the velocity loop (cascade)", "none", [10.0])
    drive_gain: Positives | None = key(
        "N m per unit of the velocity loop's output (cascade)", "1", [1.0]
    )
    velocity_reference: bool = key(
        "false: kd acts on the measured velocity alone", "true", default=True
    )
    torque_limit: Positives | None = key("N m (N), where the controller clips", "none", [100.0])
    period: Period | None = key("s, of the controller", "the sampling interval", 0.001)
    delay: Delay = key("s, from the command to the torque", default=0.0)

    @model_validator(mode="after")
    def _gains_of_the_law(self) -> "ControllerSection":
        needed = {"pd": ("kp", "kd"), "cascade": ("kp", "kv"), "unknown": ()}[self.type]
        optional = {"pd": ("ki",), "cascade": ("drive_gain",), "unknown": ()}[self.type]
        for key in ("kp", "kd", "ki", "kv", "drive_gain"):
            given = getattr(self, key) is not None
            if key in needed and not given:
                raise ValueError(f"type {self.type} needs {key}")
            if given and key not in (*needed, *optional):
                raise ValueError(f"{key} does not belong to type {self.type}")
        return self


class SignalsSection(Section):
    """Topics, and what arrives on the effort topic.

    A topic without a leading slash lies in the namespace of the robot. One whose messages hold
    several sets of numbers may be given with a field, as
    ``{topic: arm_controller/controller_state, field: output}`` or ``topic#field``. `effort` is
    ``none`` for a robot without efforts, whose torques follow from its position error by the law
    under `controller`.
    """

    joint_states: Topic = key(
        "sensor_msgs/JointState, or what ros2_control publishes; without a leading slash: in "
        "the namespace of the robot",
        default="joint_states",
    )
    effort: Topic | None = key(
        "also std_msgs/Float64MultiArray; none: the robot has no efforts (`idim-iv servo`)",
        "joint_states",
        "/joint_states",
    )
    reference: Topic | None = key(
        "what the controller was asked for: a JointState or a controller_state",
        "no reference",
        "/joint_trajectory_controller/controller_state",
    )
    link_states: Topic | None = key(
        "sensor_msgs/JointState of encoders behind the gears: shows stiffness and play",
        "none",
        "/link_states",
    )
    reference_delay: Delay = key(
        "s, from the reference to its effect; only read where effort is none",
        example=0.02,
        default=0.0,
    )
    effort_scale: list[NotZero] | None = key(
        "what arrives to N m (N), e.g. torque constant · gear ratio", "1", [1.0]
    )
    effort_unit: Literal["N m", "A", "V"] = key(
        "N m, A or V: the unit after the scale", default="N m"
    )

    @property
    def effort_topic(self) -> str | None:
        """Topic of the efforts; None for a robot without."""
        return None if self.effort == NO_EFFORT else self.effort or self.joint_states

    @property
    def relative_topics(self) -> tuple[str, ...]:
        """Topics in the namespace of the robot."""
        named = (self.joint_states, self.effort_topic, self.reference, self.link_states)
        topics = (topic_of(name) for name in named if name and not name.startswith("/"))
        return tuple(dict.fromkeys(topics))

    @model_validator(mode="after")
    def _other_encoders(self) -> "SignalsSection":
        topic = self.link_states
        used = {name.lstrip("/") for name in (self.joint_states, self.reference) if name}
        if topic is not None and topic.lstrip("/") in used:
            raise ValueError(f"link_states is {topic}, which has another meaning already")
        return self


class ProcessingSection(Section):
    """Filters, reversal speed and what is cut from each end.

    `decimation_edge`: at 0.95 white noise stays white, at MATLAB's 0.8 the empty band above
    autocorrelates it. `decimation_phase`: ``first`` as SciPy does, ``last`` as MATLAB's decimate.
    `reversal_margin`: the decimation filter smears what happens at a reversal; where the margin is
    left out, a diagnosis decides once it knows whether the closed loop is simulated.
    """

    position_cutoff: Frequency | None = key("Hz, low-pass of the positions", "from the data", 50.0)
    position_order: Annotated[int, Field(ge=1, le=10)] = key("of that filter, one pass", default=4)
    decimation_cutoff: Frequency | None = key(
        "Hz, low-pass before decimation", "0.4 position_cutoff", 20.0
    )
    decimation_edge: Annotated[float, Field(ge=0.5, le=1.0)] = key(
        "end of that filter, share of the new Nyquist rate", default=0.95
    )
    decimation_phase: Literal["first", "last"] = key(
        "first or last sample of each group is kept", default="first"
    )
    minimum_speed: Levels | None = key(
        "rad/s (m/s), slower samples are left out", "1 % of the peak speed", [0.02]
    )
    reversal_margin: Annotated[float, Field(ge=0.0, le=20.0)] | None = key(
        "decimated samples left out beside a slow one", "1", 1.0
    )
    trim: Annotated[Levels, Field(min_length=2, max_length=2)] | None = key(
        "s, cut at start and end", "from the filters", [0.5, 0.5]
    )


class IdentificationSection(Section):
    """Model terms, start and stop of the IDIM-IV iteration."""

    friction: list[Literal["viscous", "coulomb", "offset"]] = key(
        "terms of the model", "all three", default=["viscous", "coulomb", "offset"]
    )
    drive_inertia: bool = key("whether drives have an inertia of their own", "true", default=True)
    exclude: list[Name] = key(
        "base parameters that are taken out of the model", "none", ["off1"], default=[]
    )
    start: Literal["given", "regular"] = key(
        "given (URDF and armature) or regular (unit inertias)", default="given"
    )
    tolerance: Annotated[float, Field(ge=1e-6, lt=1.0)] = key(
        "relative change that ends the iteration", default=0.01
    )
    max_iterations: Annotated[int, Field(ge=1, le=100)] = key("of IDIM-IV", default=10)
    significance: Fraction = key("level of all tests", default=0.05)


class Configuration(Section):
    """All that is known of one robot before its recording is read."""

    robot: RobotSection
    simulator: SimulatorSection = SimulatorSection()
    simulated_robot: SimulatedRobotSection = SimulatedRobotSection()
    controller: ControllerSection = ControllerSection()
    signals: SignalsSection = SignalsSection()
    processing: ProcessingSection = ProcessingSection()
    identification: IdentificationSection = IdentificationSection()
    source: Annotated[YamlPath | None, Field(exclude=True)] = None
    _node_topics: dict[str, str] = PrivateAttr(default_factory=dict)

    @property
    def node_topics(self) -> dict[str, str]:
        """What relative topics are for the node that asks; empty where none does."""
        return dict(self._node_topics)

    def with_node_topics(self, topics: Mapping[str, str]) -> "Configuration":
        """Return the configuration for a node for which relative topics have these names."""
        copied = self.model_copy()
        copied._node_topics = dict(topics)
        return copied

    def changed(self, section: str, **values: object) -> "Configuration":
        """Return the configuration with other values in a section, which are not checked."""
        part = getattr(self, section).model_copy(update=values)
        return self.model_copy(update={section: part})

    @model_validator(mode="after")
    def _lengths(self) -> "Configuration":
        """Refuse lists that do not hold one number for each joint."""
        n = len(self.robot.joints)
        if len(set(self.robot.joints)) != n:
            raise ValueError("robot.joints names a joint twice")
        for key, section in self:
            for name, values in section if isinstance(section, Section) else ():
                if not isinstance(values, list) or name in _OF_ANY_LENGTH:
                    continue
                if name.startswith("motor_to_joint"):
                    if any(len(row) != n for row in (values, *values)):
                        raise ValueError(f"{key}.{name} must be {n} by {n}")
                elif len(values) != n:
                    raise ValueError(f"{key}.{name} has {len(values)} values for {n} joints")
        self._couplings()
        self._plant_step()
        return self

    def _couplings(self) -> None:
        motors: set[str] = set()
        for first, second in (coupling.joints for coupling in self.robot.couplings):
            for joint in (first, second):
                if joint not in self.robot.joints:
                    raise ValueError(f"robot.couplings names {joint}, not in robot.joints")
            if first == second:
                raise ValueError(f"robot.couplings couples {first} with itself")
            if second in motors:
                raise ValueError(f"robot.couplings couples the motor of {second} twice")
            motors.add(second)

    def _plant_step(self) -> None:
        step, period = self.simulated_robot.plant_step, self.controller.period
        if step and period and not period / _MOST_STEPS <= step <= period:
            raise ValueError(
                f"simulated_robot.plant_step is {step:g} s: between controller.period, {period:g} "
                f"s, and a {_MOST_STEPS}th of it is needed"
            )


def load_configuration(path: FilePath) -> Configuration:
    """Read and check a robot's YAML file; the path of its URDF or MJCF becomes absolute.

    Raises
    ------
    UsageError
        File missing or unreadable, broken YAML, unknown key, wrong type, length or value,
        URDF or MJCF file missing. The message names the key and the file.
    """
    path = Path(path)
    data = read_mapping(path)
    try:
        configuration = Configuration.model_validate(data)
    except ValidationError as error:
        raise UsageError(f"{path}: {first_problem(error)}") from error
    files = {
        key: _existing(path, f"robot.{key}", value)
        for key in ("urdf", "mjcf")
        if (value := getattr(configuration.robot, key)) is not None
    }
    return configuration.changed("robot", **files).model_copy(update={"source": path})


def _existing(path: Path, key: str, urdf: Path) -> Path:
    """Absolute path of the URDF or MJCF that a key of a configuration names."""
    try:
        absolute = (path.parent / urdf).resolve()
        present = absolute.is_file()
    except (OSError, ValueError, RuntimeError) as error:  # too long, a zero byte, a loop of links
        reason = getattr(error, "strerror", None) or "not a path"
        raise UsageError(f"{path}: {key}: {shortened(str(urdf))}: {reason}") from error
    if not present:
        raise UsageError(f"{path}: {key}: no file {absolute}")
    return absolute
