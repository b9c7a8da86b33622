"""The control law that a robot runs, as far as its torques depend on it."""

from dataclasses import dataclass, replace

from idim_iv_ros.types import FloatArray


@dataclass(frozen=True)
class ControlLaw:
    """Sampled control law with zero-order hold, all values on the joint side.

    τ = kp e + kd (dq_ref − dq) + ki ∫e + feedforward, e = q_ref − q; without `velocity_reference`
    the kd term acts on −dq, as that of a cascade does.
    """

    # kp, kd, ki: (n_joints,), from position error, velocity error and integral of the first to
    # torque
    kp: FloatArray
    kd: FloatArray
    ki: FloatArray
    velocity_reference: bool  # Whether dq_ref enters the command
    # (n_joints,) N m (N); infinite where there is none. The integral stands still in saturation.
    torque_limit: FloatArray
    period: float | None  # Of the control, s; None: one sample of the references
    delay: float  # From the command to the torque on the joint, s
    # (n_samples, n_joints) or None: torque added to the command, sampled like the references
    feedforward: FloatArray | None = None
    # Of the first-order filter through which the law sees backward differences of the position over
    # its period, v ← v + factor (Δq / period − v); 1 is no filter. None: the exact speed.
    speed_factor: float | None = None

    def scaled(self, factor: FloatArray) -> "ControlLaw":
        """Multiply the gains by (n_joints,) factors (gain update of IDIM-IV).

        A loop whose inertia was guessed `factor` times the actual one keeps its bandwidth.
        """
        return replace(self, kp=self.kp * factor, kd=self.kd * factor, ki=self.ki * factor)
