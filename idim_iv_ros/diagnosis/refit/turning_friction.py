"""When dry friction changes its direction: as simulated, as measured, or as a solver softens it.

Solvers make dry friction a soft constraint. MuJoCo's asks for the acceleration −b v of a joint in
reach of its friction loss, b = 2 / (d T_ref), and grants a share d of it: the torque is
−M d / (1 − d) (dv/dt + b v) within ± the loss (Computation chapter of its documentation, softness
of constraints). With d near one the direction of the friction is that of v + (dv/dt) / b: it turns
1/b before the joint does, 9.5 ms with the default of T_ref. A model that sticks is wrong there by
twice the friction, which passes for another friction at low speed, or a soft shaft.

A robot's own friction turns with the joint or after it. A lead at most joints is therefore taken
for the solver's, and its friction put in the place of the one that sticks: a property of the
recording, no cause. Without a lead the measured motion may still tell better than the simulated one
when joints turn, where samples are few or the simulated loop is another than the robot's.

Where no loop is simulated, a joint rests while it is slower than some speed, that of the greatest
likelihood, and its friction crosses evenly in time: the torque that moves it on does. A step in the
place of this rings at the edge of the decimation filter, and looks like a delay of every joint.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from scipy.interpolate import CubicSpline

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.refit.baseline import Baseline
from idim_iv_ros.diagnosis.refit.smooth_motion import SmoothMotion
from idim_iv_ros.simulation import joint_inertia
from idim_iv_ros.types import FloatArray

# 1/b, s: half to twice that of MuJoCo's default (a time constant of 20 ms, d of 0.95).
_LEADS = (0.005, 0.0065, 0.008, 0.0095, 0.011, 0.014, 0.019)
LEAST_LEAD = _LEADS[0]  # no solver's: the likeliest lead is one that is shorter than all tried
# (1 − d) / d: MuJoCo's default is 1/9. What the motion leaves of its noise widens the crossing.
_SOFTNESS = (1.0 / 9.0, 0.25, 0.5, 1.0)
_FINER = (1.1, 1.05, 1.025)  # factors of a lead; of the softness their third power
_PARTS = 8  # of a step of the motion's grid, over which the direction of the friction is averaged
_STILL = 1e-6  # rad/s (m/s): width of the crossing, at least

# Time in which its dry friction alone makes a joint as fast as one that rests may be, s.
_RESTING = (0.0005, 0.001, 0.002, 0.004)

Crossing = tuple[float, float]  # lead and time of crossing of the dry friction of a joint, s


@dataclass(frozen=True)
class TurningFriction:
    """How early the dry friction of some joints turns; that of the others sticks as simulated.

    `widths`: of v + lead · dv/dt, within which the friction crosses from one level to the other.
    """

    leads: dict[int, float]  # by joint, s before the joint
    widths: dict[int, float]  # rad/s (m/s)
    evenly: bool = False  # whether it crosses evenly in time, without a lead

    @property
    def soft(self) -> list[int]:
        """Joints whose dry friction a solver softens."""
        return [joint for joint, lead in self.leads.items() if lead > LEAST_LEAD]

    def soft_leads(self, joints: Sequence[str]) -> dict[str, float]:
        """Lead, s, of joints whose dry friction a solver softens."""
        return {joints[joint]: self.leads[joint] for joint in self.soft}

    def put_into(self, data: Baseline) -> Baseline:
        """Return the same motions with this friction."""
        motions = []
        for motion in data.motions:
            slip, states = motion.slip.copy(), _fine(motion)
            for joint in self.leads:
                slip[:, joint] = self.slip(joint, *states)
            motions.append(replace(motion, slip=slip))
        return data.on(tuple(motions))

    def slip(self, joint: int, velocity: FloatArray, acceleration: FloatArray) -> FloatArray:
        """Friction (s,) of a joint as a share of its level, mean over each step of the grid.

        `velocity`, `acceleration`: (n_joints, parts, s) within each step.
        """
        width = self.widths[joint]
        if not self.evenly:
            ahead = velocity[joint] + self.leads[joint] * acceleration[joint]
            return np.asarray(np.clip(ahead / width, -1.0, 1.0).mean(axis=0))
        speed = velocity[joint].T.ravel()  # in the order of time
        slides = np.flatnonzero(np.abs(speed) >= width)
        if not len(slides):
            slides = np.array([0])
        crossed = np.interp(np.arange(len(speed)), slides, np.sign(speed[slides]))
        return np.asarray(crossed.reshape(-1, len(velocity[joint])).mean(axis=1))

    def sentence(self, joints: Sequence[str]) -> str:
        """Say for the notes what a solver softens; empty where none does."""
        if not self.soft:
            return ""
        leads = [self.leads[joint] for joint in self.soft]
        low, high = (f"{1e3 * lead:.2g}" for lead in (min(leads), max(leads)))
        times = f"{low} ms" if low == high else f"{low} to {high} ms"
        names = ", ".join(joints[joint] for joint in self.soft)
        return (
            f"dry friction of {names} turns {times} before the joint: a soft constraint, as "
            "simulators solve friction (MuJoCo's frictionloss with its default solreffriction: "
            "9.5 ms); a robot's own friction does not, and this is taken for no cause"
        )


def turning_friction(data: Baseline) -> TurningFriction:
    """Find the joints whose dry friction does not stick and slip as simulated, and when it turns.

    `data`: with the effort aligned: one that is recorded before it acts would turn early, too.
    """
    whole = data.motions[0].whole
    level = np.maximum(whole.coulomb, 0.0)
    rubs = level > settings.LEAST_DRY_FRICTION * data.torque_sizes
    every: list[int] = [j for j in np.flatnonzero(rubs).tolist() if len(data.columns_of(j, "Fc"))]
    if not every:
        return TurningFriction({}, {})
    robot, position = data.prepared.model.robot, data.motions[0].position
    inertia = np.abs(joint_inertia(robot, whole, position))
    fastest = level / np.maximum(inertia, 1e-12)  # change of speed by the friction alone
    fit, fine = data.regression.fitted, [_fine(motion) for motion in data.motions]

    def turning(crossings: dict[int, Crossing]) -> TurningFriction:
        leads = {joint: lead for joint, (lead, _) in crossings.items()}
        times = {joint: time * float(fastest[joint]) for joint, (_, time) in crossings.items()}
        widths = {joint: max(width, _STILL) for joint, width in times.items()}
        return TurningFriction(leads, widths, not data.sticking and not any(leads.values()))

    @cache
    def column(joint: int, crossing: Crossing) -> FloatArray:
        turns = turning({joint: crossing})
        return data.decimated(joint, [turns.slip(joint, *states) for states in fine])

    def gains(crossings: dict[int, Crossing]) -> FloatArray:
        """Gain (n_joints,) of the ln likelihood of each joint, with the noise of the refit."""
        joints = list(data.rows)
        for joint, crossing in crossings.items():
            matrix = joints[joint].matrix.copy()
            matrix[:, data.columns_of(joint, "Fc")] = column(joint, crossing)[:, None]
            joints[joint] = replace(joints[joint], matrix=matrix)
        changed = replace(data.regression, joints=tuple(joints))
        return changed.fit(fit.noise_models, steps=0).log_likelihoods - fit.log_likelihoods

    @cache
    def everywhere(crossing: Crossing) -> FloatArray:
        return gains(dict.fromkeys(every, crossing))

    def same_everywhere(crossing: Crossing) -> float:
        return float(everywhere(crossing).sum())

    times = (0.0,) if data.sticking else _RESTING
    as_measured = {
        joint: max(((0.0, time) for time in times), key=lambda option: everywhere(option)[joint])
        for joint in every
    }
    measured = float(gains(as_measured).sum())
    leads = [(lead, lead * _SOFTNESS[1]) for lead in _LEADS]
    best = max(leads, key=same_everywhere)
    best = max(((best[0], best[0] * soft) for soft in _SOFTNESS), key=same_everywhere)
    if same_everywhere(best) >= max(settings.SOFT_FRICTION_SUPPORT, measured):
        chosen: dict[int, Crossing] = dict.fromkeys(every, best)
        for step in _FINER:
            for joint in every:
                lead, time = chosen[joint]
                near = [(lead * step, time * step), (lead / step, time / step)]
                near += [(lead, time * step**3), (lead, time / step**3), (lead, time)]
                options = [{**chosen, joint: crossing} for crossing in near]
                chosen = max(options, key=lambda option: float(gains(option).sum()))
        of_joints = gains(chosen)
        early = {
            joint: crossing
            for joint, crossing in chosen.items()
            if of_joints[joint] > 0.0 and crossing[0] > LEAST_LEAD
        }
        if 2 * len(early) > len(every):
            return turning(early)
    return turning(as_measured if measured >= settings.SOFT_FRICTION_SUPPORT else {})


def _fine(motion: SmoothMotion) -> tuple[FloatArray, FloatArray]:
    """Velocity and acceleration (n_joints, parts, s) within each step of the motion's grid."""
    steps = np.arange(len(motion.time), dtype=float)
    within = np.clip(steps[:, None] + (np.arange(_PARTS) + 0.5) / _PARTS - 0.5, 0.0, steps[-1])
    velocity, acceleration = (
        np.ascontiguousarray(CubicSpline(steps, states)(within).T)
        for states in (motion.velocity, motion.acceleration)
    )
    return velocity, acceleration
