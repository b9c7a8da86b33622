"""From what was recorded to joint positions and joint torques."""

from dataclasses import dataclass

import numpy as np

from idim_iv_ros.configuration import Configuration
from idim_iv_ros.errors import DataError, UsageError
from idim_iv_ros.recording.recording import Recording
from idim_iv_ros.types import BoolArray, FloatArray

_LARGEST_POSITION = 1e6  # rad (m)
# Least and greatest peak of a joint's torque, N m (N): what is beyond is no torque, or has another
# unit, and its squares have no place in a float.
_TORQUES = (1e-9, 1e9)


@dataclass(frozen=True)
class JointSignals:
    """A recording in joint coordinates, on its uniform grid; all arrays (n_samples, n_joints)."""

    name: str
    rate: float  # Hz
    position: FloatArray  # measured, unfiltered, rad or m
    torque: FloatArray  # N m or N (or the unit of the effort where that is no torque)
    valid: BoolArray  # whether the joint's position and torque rest on measurements
    # As the driver publishes it, rad/s or m/s; the control law is fitted with it.
    velocity: FloatArray | None = None
    position_reference: FloatArray | None = None  # rad or m
    velocity_reference: FloatArray | None = None  # rad/s or m/s
    link_position: FloatArray | None = None  # of encoders behind the gears, unfiltered, rad or m
    link_valid: BoolArray | None = None  # whether that rests on measurements


@dataclass(frozen=True)
class JointTransform:
    """From the side of what is recorded to the joints: q = to_joint · q_recorded + offset."""

    to_joint: FloatArray  # (n_joints, n_joints)
    to_torque: FloatArray  # (n_joints, n_joints), τ = to_torque · effort, scale of efforts included
    offset: FloatArray  # (n_joints,), rad or m

    def position(self, recorded: FloatArray) -> FloatArray:
        """Positions (n_samples, n_joints) of the joints, rad or m."""
        return _transformed(recorded, self.to_joint, self.offset)

    def velocity(self, recorded: FloatArray) -> FloatArray:
        """Speeds (n_samples, n_joints) of the joints, rad/s or m/s."""
        return _transformed(recorded, self.to_joint, np.zeros(len(self.offset)))

    def torque(self, recorded: FloatArray) -> FloatArray:
        """Torques (n_samples, n_joints) on the joints, N m or N."""
        return _transformed(recorded, self.to_torque, np.zeros(len(self.offset)))

    def touched(self, position: BoolArray, effort: BoolArray) -> BoolArray:
        """Joints (n_samples, n_joints) whose values depend on marked ones of what is recorded."""
        return _touched(position, self.to_joint) | _touched(effort, self.to_torque)


def joint_transform(configuration: Configuration) -> JointTransform:
    """Return the transform of a configuration; see `joint_side`."""
    robot = configuration.robot
    joints = len(robot.joints)
    to_joint, to_torque = np.eye(joints), np.eye(joints)
    if robot.motor_to_joint is not None:
        matrix = np.array(robot.motor_to_joint)
        to_joint, to_torque = np.linalg.inv(matrix), matrix.T
    if robot.motor_to_joint_torque is not None:
        to_torque = np.array(robot.motor_to_joint_torque)
    offset = np.array(robot.position_offset or [0.0] * joints)
    scale = np.array(configuration.signals.effort_scale or [1.0] * joints)
    return JointTransform(to_joint, to_torque * scale, offset)


def joint_side(recording: Recording, configuration: Configuration) -> JointSignals:
    """Apply effort scale, transmission and position offsets.

    With a motor-to-joint matrix R all recorded signals are on the motor side: q = R⁻¹ q_motor and τ
    = Rᵀ τ_motor (or `motor_to_joint_torque` · τ_motor). Encoders behind the gears are on the joint
    side. Where no effort is recorded, `servo_torque` makes it of the position error.

    Raises UsageError: no effort is recorded, and no law is given from which it follows; DataError:
    positions or torques that no robot has, before or after the scaling.
    """
    transform = joint_transform(configuration)
    position = transform.position(recording.position.values)
    reference, unasked = joint_reference(recording, configuration)
    if configuration.signals.effort_topic is None:
        torque = servo_torque(configuration, recording, position, reference)
    else:
        torque = transform.torque(recording.effort.values)
    _require_possible(recording, "position", "rad (m)", position, 0.0, _LARGEST_POSITION)
    _require_possible(recording, "torque", configuration.signals.effort_unit, torque, *_TORQUES)
    invented = transform.touched(recording.position.invented, recording.effort.invented)
    if unasked is not None:
        invented |= unasked
    measured, link = recording.velocity, recording.link_position
    asked = None if configuration.signals.effort_topic is None else recording.velocity_reference
    return JointSignals(
        name=recording.path.name,
        rate=recording.rate,
        position=position,
        torque=torque,
        valid=~invented,
        velocity=None if measured is None else transform.velocity(measured.values),
        position_reference=reference,
        velocity_reference=None if asked is None else transform.velocity(asked.values),
        link_position=None if link is None else link.values,
        link_valid=None if link is None else ~link.invented,
    )


def joint_reference(
    recording: Recording, configuration: Configuration
) -> tuple[FloatArray | None, BoolArray | None]:
    """References of the joints as their law sees them, and which of them were not recorded.

    Of a robot without efforts they are held from one to the next and arrive
    `signals.reference_delay` late; what is returned is their mean about each sample.

    Returns references (n_samples, n_joints), rad or m, and which are missing; None, None without.
    """
    signal, signals = recording.position_reference, configuration.signals
    if signal is None:
        return None, None
    transform = joint_transform(configuration)
    reference = transform.position(signal.values)
    if signals.effort_topic is None:
        samples = np.arange(len(reference))
        place = samples - signals.reference_delay * recording.rate - 0.5
        reference = np.stack([np.interp(place, samples, column) for column in reference.T], axis=1)
    return reference, _touched(signal.invented, transform.to_joint)


def servo_torque(
    configuration: Configuration,
    recording: Recording,
    position: FloatArray,
    reference: FloatArray | None,
) -> FloatArray:
    """Torques (n_samples, n_joints) that the law of a servo makes of its position error, N m.

    Raises UsageError: there is no reference, or no law of the position error alone.
    """
    law, name = configuration.controller, configuration.source or "the configuration"
    if reference is None:
        raise UsageError(
            f"{name}: signals.effort is none, and nothing says what was asked for: give "
            "signals.reference"
        )
    if law.type != "pd" or law.kp is None or any((*(law.kd or []), *(law.ki or []))):
        raise UsageError(
            f"{name}: signals.effort is none: torques follow from a law of the position error; "
            f"`idim-iv servo {recording.path.name} --config …` finds it (type pd, kd 0: the "
            "damping of the loop counts as friction of the joint)"
        )
    limit = np.inf if law.torque_limit is None else np.array(law.torque_limit)
    return np.asarray(np.clip(np.array(law.kp) * (reference - position), -limit, limit))


def _transformed(values: FloatArray, matrix: FloatArray, offset: FloatArray) -> FloatArray:
    """Matrix · values + offset for each sample; the values themselves where nothing changes."""
    if np.array_equal(matrix, np.eye(len(matrix))) and not offset.any():
        return values
    return np.asarray(values @ matrix.T + offset)


def _require_possible(
    recording: Recording, what: str, unit: str, values: FloatArray, least: float, most: float
) -> None:
    for joint, peak in zip(recording.joints, np.abs(values).max(axis=0, initial=0.0), strict=True):
        if not least <= peak <= most:
            raise DataError(
                f"{recording.path.name}: the largest {what} of {joint} is {peak:.3g} {unit}, and "
                "no robot has that; look at the driver and its units, and at signals.effort_scale "
                "and robot.motor_to_joint, or leave a joint that does nothing out of robot.joints"
            )


def _touched(invented: BoolArray, matrix: FloatArray) -> BoolArray:
    """Joints whose value depends on an invented motor value."""
    if not invented.any():
        return np.zeros_like(invented)
    return np.asarray(invented.astype(float) @ (np.abs(matrix) > 1e-12).T > 0.0)
