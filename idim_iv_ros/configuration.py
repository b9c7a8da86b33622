"""One YAML file a robot, checked key by key (design: Configuration)."""

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    PositiveFloat,
    PositiveInt,
    ValidationError,
    model_validator,
)
from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError

from idim_iv_ros.errors import UsageError
from idim_iv_ros.file_paths import FilePath

Vector = list[float]
Matrix = list[list[float]]
Levels = list[Annotated[float, Field(ge=0.0)]]
Fraction = Annotated[float, Field(gt=0.0, lt=1.0)]


class Section(BaseModel):
    """Base of all sections: unknown keys are errors, values do not change."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class Coupling(Section):
    """A transmission that couples two joints: the second's motor turns with both (TX40 wrist)."""

    joints: Annotated[list[str], Field(min_length=2, max_length=2)]


class RobotSection(Section):
    """Geometry, joints and transmission; every list is in the order of `joints`."""

    name: str | None = None
    urdf: Path | None = None
    joints: Annotated[list[str], Field(min_length=1)]
    gravity: Annotated[Vector, Field(min_length=3, max_length=3)] = [0.0, 0.0, -9.81]
    position_offset: Vector | None = None
    motor_to_joint: Matrix | None = None
    motor_to_joint_torque: Matrix | None = None
    couplings: list[Coupling] = []


class SimulatorSection(Section):
    """What the user's simulator holds besides the URDF: drive inertia on the joint side, kg m²."""

    armature: Vector | None = None


class SimulatedRobotSection(Section):
    """The robot that `simulate` runs, where it differs from the given model and is not ideal.

    Attributes
    ----------
    parameters : dict
        True values of base parameters, by the names and in the units that `identify` prints;
        the others are as given.
    rate : float or None
        Of the recording, Hz; None: that of the control.
    position_noise, encoder_resolution : (n_joints,) or None
        Standard deviation and step of the recorded positions, rad (m).
    torque_noise : (n_joints,) or None
        Standard deviation of the recorded efforts, white, N m (N).
    disturbance : (n_joints,) or None
        Standard deviation of a torque on the joints that no model explains, N m (N).
    disturbance_bandwidth : float
        Hz; first-order low-pass.
    stamp_jitter : float
        Standard deviation of the stamps, s.
    delay : float or None
        True transport delay of the command, s; None: `controller.delay`.
    plant_step : float or None
        s; None: a quarter of the control period.
    """

    parameters: dict[str, float] = {}
    rate: PositiveFloat | None = None
    position_noise: Levels | None = None
    encoder_resolution: Levels | None = None
    torque_noise: Levels | None = None
    disturbance: Levels | None = None
    disturbance_bandwidth: PositiveFloat = 10.0
    stamp_jitter: Annotated[float, Field(ge=0.0)] = 0.0
    delay: Annotated[float, Field(ge=0.0)] | None = None
    plant_step: PositiveFloat | None = None


class ControllerSection(Section):
    """The control law of the recorded robot.

    ``pd``: tau = kp (q_ref - q) + kd (dq_ref - dq) + ki ∫(q_ref - q), with dq_ref left out when
    `velocity_reference` is false. ``cascade``: tau = drive_gain · kv (kp (q_ref - q) - dq).
    `period` in s, `delay` the transport delay of the torque command in s, torques in N m.
    """

    type: Literal["pd", "cascade", "unknown"] = "unknown"
    kp: Vector | None = None
    kd: Vector | None = None
    ki: Vector | None = None
    kv: Vector | None = None
    drive_gain: Vector | None = None
    velocity_reference: bool = True
    torque_limit: Vector | None = None
    period: PositiveFloat | None = None
    delay: Annotated[float, Field(ge=0.0)] = 0.0

    @model_validator(mode="after")
    def _gains_of_the_law(self) -> "ControllerSection":
        needed = {"pd": ("kp", "kd"), "cascade": ("kp", "kv"), "unknown": ()}[self.type]
        allowed = {
            "pd": {"kp", "kd", "ki"},
            "cascade": {"kp", "kv", "drive_gain"},
            "unknown": set(),
        }[self.type]
        for key in needed:
            if getattr(self, key) is None:
                raise ValueError(f"type {self.type} needs {key}")
        for key in {"kp", "kd", "ki", "kv", "drive_gain"} - allowed:
            if getattr(self, key) is not None:
                raise ValueError(f"{key} does not belong to type {self.type}")
        return self


class SignalsSection(Section):
    """Topics, and what arrives on the effort topic."""

    joint_states: str = "/joint_states"
    effort: str | None = None
    reference: str | None = None
    effort_scale: Vector | None = None
    effort_unit: Literal["N m", "A", "V"] = "N m"


class ProcessingSection(Section):
    """Filters (Hz), reversal speed (rad/s or m/s) and seconds cut from each end.

    `decimation_edge` is where the decimation filter ends, as a share of the new Nyquist frequency:
    at 0.95 white noise stays white, at MATLAB's 0.8 the empty band above the edge colours it.
    `decimation_phase` chooses which sample of each group is kept: ``first`` as SciPy does,
    ``last`` as MATLAB's decimate does. `reversal_margin` is the number of decimated samples that
    are dropped on either side of a slow one, for the decimation filter smears what happens there.
    """

    position_cutoff: PositiveFloat | None = None
    position_order: Annotated[int, Field(ge=1, le=10)] = 4
    decimation_cutoff: PositiveFloat | None = None
    decimation_edge: Annotated[float, Field(ge=0.5, le=1.0)] = 0.95
    decimation_phase: Literal["first", "last"] = "first"
    minimum_speed: Vector | None = None
    reversal_margin: Annotated[float, Field(ge=0.0, le=20.0)] = 1.0
    trim: Annotated[Vector, Field(min_length=2, max_length=2)] | None = None


class IdentificationSection(Section):
    """Model terms, start and stop of the IDIM-IV iteration.

    `exclude` names base parameters that are taken out of the model, and out of the instruments.
    """

    friction: list[Literal["viscous", "coulomb", "offset"]] = ["viscous", "coulomb", "offset"]
    drive_inertia: bool = True
    exclude: list[str] = []
    start: Literal["given", "regular"] = "given"
    tolerance: Fraction = 0.01
    max_iterations: PositiveInt = 10
    significance: Fraction = 0.05


class Configuration(Section):
    """All that is known of one robot before its recording is read."""

    robot: RobotSection
    simulator: SimulatorSection = SimulatorSection()
    simulated_robot: SimulatedRobotSection = SimulatedRobotSection()
    controller: ControllerSection = ControllerSection()
    signals: SignalsSection = SignalsSection()
    processing: ProcessingSection = ProcessingSection()
    identification: IdentificationSection = IdentificationSection()
    source: Annotated[Path | None, Field(exclude=True)] = None

    @model_validator(mode="after")
    def _lengths(self) -> "Configuration":
        n = len(self.robot.joints)
        if len(set(self.robot.joints)) != n:
            raise ValueError("robot.joints names a joint twice")
        lists = {
            "robot.position_offset": self.robot.position_offset,
            "simulator.armature": self.simulator.armature,
            "signals.effort_scale": self.signals.effort_scale,
            "processing.minimum_speed": self.processing.minimum_speed,
        }
        for key in ("position_noise", "encoder_resolution", "torque_noise", "disturbance"):
            lists[f"simulated_robot.{key}"] = getattr(self.simulated_robot, key)
        for key in ("kp", "kd", "ki", "kv", "drive_gain", "torque_limit"):
            lists[f"controller.{key}"] = getattr(self.controller, key)
        for name, values in lists.items():
            if values is not None and len(values) != n:
                raise ValueError(f"{name} has {len(values)} values for {n} joints")
        for name in ("motor_to_joint", "motor_to_joint_torque"):
            matrix = getattr(self.robot, name)
            if matrix is not None and (len(matrix) != n or any(len(row) != n for row in matrix)):
                raise ValueError(f"robot.{name} must be {n} by {n}")
        for coupling in self.robot.couplings:
            for joint in coupling.joints:
                if joint not in self.robot.joints:
                    raise ValueError(f"robot.couplings names {joint}, not in robot.joints")
        for key in ("kp", "kv"):
            gains = getattr(self.controller, key)
            if gains is not None and any(gain <= 0.0 for gain in gains):
                raise ValueError(f"controller.{key} must be positive")
        return self


def load_configuration(path: FilePath) -> Configuration:
    """Read and check a robot's YAML file; the URDF path becomes absolute.

    Raises
    ------
    UsageError
        File missing or unreadable, broken YAML, unknown key, wrong type, length or value,
        URDF file missing. The message names the key and the file.
    """
    path = Path(path)
    try:
        data: Any = YAML(typ="safe", pure=True).load(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "not a text file"
        raise UsageError(f"{path}: cannot read the configuration: {reason}") from error
    except YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        where = f", line {mark.line + 1}" if mark else ""
        problem = getattr(error, "problem", None) or "not YAML"
        raise UsageError(f"{path}{where}: {problem}") from error
    if not isinstance(data, dict):
        raise UsageError(f"{path}: a mapping with the key 'robot' is expected")
    try:
        configuration = Configuration.model_validate(data)
    except ValidationError as error:
        raise UsageError(f"{path}: {_first_problem(error)}") from error
    urdf = configuration.robot.urdf
    if urdf is not None:
        urdf = (path.parent / urdf).resolve()
        if not urdf.is_file():
            raise UsageError(f"{path}: robot.urdf: no file {urdf}")
    robot = configuration.robot.model_copy(update={"urdf": urdf})
    return configuration.model_copy(update={"robot": robot, "source": path})


def _first_problem(error: ValidationError) -> str:
    problems = error.errors()
    first = problems[0]
    key = ".".join(str(part) for part in first["loc"])
    if first["type"] == "extra_forbidden":
        text = f"unknown key {key}"
    elif first["type"] == "missing":
        text = f"key {key} is missing"
    else:
        reason = first["msg"].removeprefix("Value error, ")
        text = f"{key}: {reason}" if key else reason
    more = len(problems) - 1
    return f"{text} (and {more} more)" if more else text
