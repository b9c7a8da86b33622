"""Parameters of the identifier."""

from dataclasses import dataclass

from idim_iv_ros.errors import UsageError
from idim_iv_ros.nodes.parameters import Settings, parameter, period_of_status

_LARGEST = 1 << 62
WAIT, REFUSE = "wait", "refuse"


@dataclass(frozen=True)
class IdentifierSettings(Settings):
    """Values of the parameters; the names are the same."""

    configuration: str = parameter(
        "",
        "the robot's YAML file; setting it again reads it anew. A request may name another file in "
        "its folder",
    )
    bag_directory: str = parameter(".", "requests name bags in this folder and no others")
    output_directory: str = parameter(
        "results",
        "each job writes into a new folder in here; history and last result too",
        read_only=True,
    )
    autostart: bool = parameter(
        True,
        "configure and activate at once; else the node waits for both to be asked for by the "
        "services of its lifecycle",
        read_only=True,
    )
    auto: bool = parameter(False, "identify every complete bag of recorder/bag_closed")
    when_busy: str = parameter(
        WAIT, "what happens to a request while another is worked on: wait or refuse"
    )
    queue_limit: int = parameter(10, "requests that wait at most; more are refused", (1, 1000))
    job_timeout: float = parameter(600.0, "a job is ended after this time, s", (1.0, 86_400.0))
    max_bag_size: int = parameter(
        20_000_000_000,
        "all bags of a job together, and each file that it unpacks, B",
        (1, _LARGEST),
    )
    memory_limit: int = parameter(
        8_000_000_000, "memory that a job may allocate, B", (100_000_000, _LARGEST)
    )
    history_length: int = parameter(
        100, "identifications that are kept to find drifting parameters", (2, 100_000)
    )
    drift_significance: float = parameter(
        0.01,
        "probability that any parameter of a bag is flagged although none has changed",
        (1e-9, 0.5),
    )
    status_period: float = period_of_status()

    def check(self) -> None:
        """Check what the ranges cannot express."""
        if self.when_busy not in (WAIT, REFUSE):
            raise UsageError(f"when_busy: {self.when_busy!r} is neither {WAIT} nor {REFUSE}")
