"""The motion on which an effect's columns are computed."""

from abc import ABC, abstractmethod
from dataclasses import dataclass

from idim_iv_ros.model import DynamicParameters, RobotModel
from idim_iv_ros.types import FloatArray

Torques = dict[int, FloatArray]  # (s, k) by joint


@dataclass(frozen=True)
class RobotMotion(ABC):
    """A recording's motion on a uniform grid of s samples, with the torques of the refit.

    Units as of the joints: rad, rad/s, N m, or m, m/s, N for a prismatic one.
    """

    robot: RobotModel  # Kinematics
    links: DynamicParameters  # Dynamics of the rigid bodies alone
    rate: float  # Of the grid, Hz
    start: float  # In the session, s
    time: FloatArray  # (s,): in the session, s
    position: FloatArray  # (s, n_joints), as the next two
    velocity: FloatArray
    acceleration: FloatArray
    slip: FloatArray  # (s, n_joints): dry friction as a share of its level, −1 to 1

    @property
    def elapsed(self) -> FloatArray:
        """Time (s,) since the start of the recording, s."""
        return self.time - self.start

    @property
    @abstractmethod
    def load(self) -> FloatArray:
        """(s, n_joints): torque of the links alone, without drives and friction."""

    @property
    @abstractmethod
    def static_load(self) -> FloatArray:
        """(s, n_joints): load at the same speeds without accelerations: gravity and Coriolis."""

    @property
    @abstractmethod
    def torque(self) -> FloatArray:
        """Torque (s, n_joints) of the refit, N m (N)."""

    @property
    @abstractmethod
    def inertia(self) -> FloatArray:
        """(s, n_joints, n_joints): mass matrix of the links alone."""

    @abstractmethod
    def slope(self, joint: int) -> FloatArray:
        """(s, n_joints): change of the links' torques as a joint's position moves."""

    @abstractmethod
    def moved(self, joint: int, shift: FloatArray, *, links: bool) -> FloatArray:
        """(s, n_joints): change of all torques when a joint moves by a small `shift` (s,).

        `links`: of the links alone (what is behind the shaft), else of everything.
        """
