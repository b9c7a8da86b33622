"""Parameters of the simulated robot."""

from dataclasses import dataclass
from pathlib import Path

from idim_iv_ros.errors import UsageError
from idim_iv_ros.excitation import read_trajectory
from idim_iv_ros.nodes.parameters import Settings, parameter

_LARGEST_SEED = 2**31


@dataclass(frozen=True)
class SimulatorSettings(Settings):
    """Values of the parameters; the names are the same."""

    configuration: str = parameter("", "the robot's YAML file", read_only=True)
    trajectory: str = parameter("", "CSV file that ~/move plays; empty: a random motion")
    motion_duration: float = parameter(10.0, "duration of the random motion, s", (1.0, 3600.0))
    motion_seed: int = parameter(1, "seed of the random motion", (0, _LARGEST_SEED))
    seed: int = parameter(1, "seed of the noise", (0, _LARGEST_SEED))

    def check(self) -> None:
        """Check what a range cannot express.

        Raises
        ------
        UsageError
            No configuration, or a trajectory that cannot be read.
        """
        if not self.configuration:
            raise UsageError("configuration: name it: --ros-args -p configuration:=ROBOT.yaml")
        if self.trajectory:
            read_trajectory(Path(self.trajectory))
