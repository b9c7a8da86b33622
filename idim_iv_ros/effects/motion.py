"""The motion on which an effect's columns are computed."""

from typing import Protocol

from idim_iv_ros.model import DynamicParameters, RobotModel
from idim_iv_ros.types import FloatArray

Torques = dict[int, FloatArray]  # (s, k) by joint


class RobotMotion(Protocol):
    """One recording's motion on a uniform grid of s samples, with the torques of the refit.

    Units as of the joints: rad, rad/s, N m, or m, m/s, N for a prismatic one.
    """

    @property
    def robot(self) -> RobotModel:
        """Kinematics."""

    @property
    def links(self) -> DynamicParameters:
        """Of the rigid bodies alone."""

    @property
    def rate(self) -> float:
        """Hz, of the grid."""

    @property
    def time(self) -> FloatArray:
        """(s,) s, of the session."""

    @property
    def elapsed(self) -> FloatArray:
        """(s,) s, since the start of the recording."""

    @property
    def position(self) -> FloatArray:
        """(s, n_joints)."""

    @property
    def velocity(self) -> FloatArray:
        """(s, n_joints)."""

    @property
    def acceleration(self) -> FloatArray:
        """(s, n_joints)."""

    @property
    def slip(self) -> FloatArray:
        """(s, n_joints): dry friction as a share of its level, −1 to 1."""

    @property
    def load(self) -> FloatArray:
        """(s, n_joints): torque of the links alone, without drives and friction."""

    @property
    def static_load(self) -> FloatArray:
        """(s, n_joints): load at the same speeds without accelerations: gravity and Coriolis."""

    @property
    def torque(self) -> FloatArray:
        """(s, n_joints): torque of the refit."""

    @property
    def inertia(self) -> FloatArray:
        """(s, n_joints, n_joints): mass matrix of the links alone."""

    def slope(self, joint: int) -> FloatArray:
        """(s, n_joints): change of the links' torques as a joint's position moves."""

    def moved(self, joint: int, shift: FloatArray, *, links: bool) -> FloatArray:
        """(s, n_joints): change of all torques when a joint moves by a small `shift` (s,).

        `links`: of the links alone (what is behind the shaft), else of everything.
        """
