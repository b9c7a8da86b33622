"""Result of a replay: errors of the simulated robot against the recorded one, by stage."""

from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from idim_iv_ros.documents import Document, Number, Unsaved
from idim_iv_ros.files import REPLAY_FORMAT
from idim_iv_ros.types import FloatArray

NOMINAL, CORRECTED, WITH_EFFECTS = "nominal", "corrected", "with effects"


@dataclass(frozen=True)
class ReplayError:
    """Root mean square difference of simulation and recording at one joint.

    - `rms`: rad (m), or N m (N)
    - `low`, `high`: 95 % interval, by blocks of time
    - `over_noise`: `rms` over the standard deviation of the recording's noise
    """

    rms: Number
    low: Number
    high: Number
    over_noise: Number


@dataclass(frozen=True)
class ReplayStage:
    """One simulated robot of a replay, and its errors.

    - `name`: ``nominal``, ``corrected`` or ``with effects``
    - `model`: its origin, in words
    - `tracking`, `torque`: errors by joint; None where the simulation failed
    - `tool`: error of the centre of the last link, m
    - `note`: why it failed, or what the model lacks; empty otherwise
    """

    name: Annotated[str, Field(alias="stage")]
    model: str
    tracking: dict[str, ReplayError] | None
    torque: dict[str, ReplayError] | None
    tool: ReplayError | None = None
    note: str = ""


@dataclass(frozen=True)
class ReplaySeries:
    """Curves of one joint in one recording, thinned; in order of time."""

    joint: str
    bag: str
    time: FloatArray  # (n,) s
    error: FloatArray  # (n,) rad (m): reference less recorded position
    errors: dict[str, FloatArray]  # Reference less simulated position, by stage
    torque: FloatArray  # Recorded, N m (N)
    torques: dict[str, FloatArray]  # Simulated, by stage, N m (N)


@dataclass(frozen=True, kw_only=True)
class ReplayResult(Document):
    """Result of a replay; the document `replay.json`.

    - `duration`: s of recording that were compared, in total over `bags`
    - `model`, `effects`: file of the model (``urdf``: made from the nominal model), file of the
      effects or empty
    - `tracking_noise`, `torque_noise`: noise of the recordings by joint, RMS in rad (m) and N m (N)
    - `held_out`: whether model and effects were found on other recordings; None where that is not
      known
    """

    what: ClassVar[str] = "a replay"
    written_by: ClassVar[str] = "replay"

    format: Literal["idim_iv_ros/replay/1"] = REPLAY_FORMAT
    robot: str
    joints: tuple[str, ...]
    joint_types: tuple[str, ...]
    bags: tuple[str, ...]
    duration: float
    software: dict[str, str]
    model: str
    effects: str = ""
    tracking_noise: dict[str, Number]
    torque_noise: dict[str, Number]
    stages: tuple[ReplayStage, ...]
    held_out: bool | None = None
    notes: tuple[str, ...] = ()
    series: Unsaved[tuple[ReplaySeries, ...]] = ()

    @property
    def best(self) -> ReplayStage:
        """Return the last stage that was simulated to its end; the first if all failed."""
        done = [stage for stage in self.stages if stage.tracking is not None]
        return done[-1] if done else self.stages[0]
