"""Parameters of the predictor."""

from dataclasses import dataclass

from idim_iv_ros.errors import UsageError
from idim_iv_ros.nodes.parameters import Settings, check_configuration, parameter, period_of_status


@dataclass(frozen=True)
class PredictorSettings(Settings):
    """Values of the parameters; the names are the same."""

    configuration: str = parameter("", "the robot's YAML file", read_only=True)
    result: str = parameter(
        "",
        "a result.json, which is read again when it changes; empty: the newest of the identifier",
    )
    output_directory: str = parameter(
        "results", "where the identifier of this robot writes its results", read_only=True
    )
    rate: float = parameter(20.0, "predictions per second, Hz", (1.0, 100.0), read_only=True)
    frame_prefix: str = parameter(
        "", "in front of the names of links in ~/residual_markers, as of robot_state_publisher"
    )
    false_warnings: float = parameter(
        1.0,
        "warnings a day of motion that are accepted while the model fits, all joints together",
        (1e-6, 1000.0),
    )
    status_period: float = period_of_status()

    def _check(self) -> None:
        if not self.configuration:
            raise UsageError("configuration: name it: --ros-args -p configuration:=ROBOT.yaml")
        check_configuration(self.configuration)
