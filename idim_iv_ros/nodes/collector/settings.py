"""Parameters of the collector."""

import math
from dataclasses import dataclass

from idim_iv_ros.errors import UsageError
from idim_iv_ros.excitation.passes import KINDS
from idim_iv_ros.nodes.parameters import Settings, check_configuration, parameter

TOPIC, ACTION, AUTO = "topic", "action", "auto"
_LARGEST_SEED = 2**31


@dataclass(frozen=True)
class CollectorSettings(Settings):
    """Values of the parameters; the names are the same."""

    configuration: str = parameter("", "the robot's YAML file; set again, it is read anew")
    allow_motion: bool = parameter(
        False,
        "whether the robot may be moved; set to false while it moves, it is stopped",
    )
    controller: str = parameter(
        "joint_trajectory_controller",
        "of the robot: its topic joint_trajectory or its action follow_joint_trajectory is used",
        read_only=True,
    )
    interface: str = parameter(
        AUTO,
        "topic, action, or auto: the action where control_msgs is installed and a server is there",
        read_only=True,
    )
    motion: str = parameter("designed", "designed for the condition number, or random (at once)")
    motion_duration: float = parameter(20.0, "of the motion at full speed, s", (1.0, 1000.0))
    motion_seed: int = parameter(1, "one seed gives one motion", (0, _LARGEST_SEED))
    speed_scale: float = parameter(
        0.5, "share of the limits of speed and acceleration that the motion may use", (0.01, 1.0)
    )
    approach_speed: float = parameter(
        0.1, "share of the robot's limits on the way to the start of the motion", (0.01, 1.0)
    )
    slow_speed: float = parameter(
        0.2, "speed of the slow pass before the recorded one, share of its speed", (0.05, 1.0)
    )
    floor: float = parameter(
        math.nan, "height that all moving frames stay above, m in the base frame; nan: none"
    )
    tracking_error: float = parameter(
        0.1,
        "a robot that is so far from where it should be is stopped, rad (m)",
        (0.001, 1.0),
    )
    start_delay: float = parameter(
        1.0, "time until the controller begins a motion at the latest, s", (0.05, 120.0)
    )
    stale_after: float = parameter(
        0.2, "joint states are too old after this time: the robot is stopped, s", (0.02, 10.0)
    )
    point_rate: float = parameter(
        100.0, "points of the trajectory per second at full speed", (10.0, 1000.0)
    )
    job_timeout: float = parameter(
        3600.0, "a goal ends after this time, s; that of a request may be shorter", (1.0, 86_400.0)
    )

    def check(self) -> None:
        """Check what the ranges cannot express."""
        if self.motion not in KINDS:
            raise UsageError(f"motion: {self.motion!r} is neither {' nor '.join(KINDS)}")
        if self.interface not in (TOPIC, ACTION, AUTO):
            raise UsageError(f"interface: {self.interface!r} is not {TOPIC}, {ACTION} or {AUTO}")
        if not self.controller:
            raise UsageError("controller: name the controller that follows trajectories")
        if math.isinf(self.floor):
            raise UsageError("floor: a height in m, or nan")
        if self.configuration:
            check_configuration(self.configuration)
