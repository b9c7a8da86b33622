"""Labelled stretches of a diagnosis motion, and what each of them reveals."""

from dataclasses import dataclass

from idim_iv_ros.effects.registry import BY_NAME, CAUSES
from idim_iv_ros.excitation.shapes import Shape
from idim_iv_ros.types import FloatArray

# Kinds of segment; which effects each reveals is in the files of `effects/`.
KINDS = ("repeat", "range_sweep", "creep", "plateau", "reversals", "multisine")
EFFECTS: dict[str, tuple[str, ...]] = {
    kind: tuple(cause.name for cause in CAUSES if kind in cause.segments) for kind in KINDS
}
NOT_REVEALED = {cause.name: cause.beyond_motion for cause in CAUSES if not cause.segments}


@dataclass(frozen=True)
class SegmentPlan:
    """A stretch before it has its place in time.

    Attributes
    ----------
    name, kind : str
    offset : (n_joints,)
        Where it starts, relative to the base posture, rad (m).
    shape : position, velocity, acceleration relative to its start
    speed : (n_joints,) or None
        Constant speeds of the way there, rad/s (m/s); the way back has the opposite.
    amplitude : (n_joints,) or None
        Largest deviation, rad (m).
    frequency : (lowest, highest) Hz or None
    """

    name: str
    kind: str
    offset: FloatArray
    shape: Shape
    speed: FloatArray | None = None
    amplitude: FloatArray | None = None
    frequency: tuple[float, float] | None = None


@dataclass(frozen=True)
class Segment:
    """A stretch with its place in the motion.

    Attributes
    ----------
    plan : SegmentPlan
    start, end : float
        s
    effects : tuple of str
    """

    plan: SegmentPlan
    start: float
    end: float
    effects: tuple[str, ...]

    def document(self) -> dict[str, object]:
        """Row of the side table, for JSON: s, rad/s (m/s), rad (m), Hz."""
        plan = self.plan
        return {
            "name": plan.name,
            "kind": plan.kind,
            "start": round(self.start, 9),
            "end": round(self.end, 9),
            "effects": list(self.effects),
            "speed": None if plan.speed is None else [float(v) for v in plan.speed],
            "amplitude": None if plan.amplitude is None else [float(a) for a in plan.amplitude],
            "frequency": None if plan.frequency is None else list(plan.frequency),
        }


def effects_of(kind: str, joints: int) -> tuple[str, ...]:
    """Effects that a kind of segment reveals on a robot with so many joints."""
    return tuple(name for name in EFFECTS[kind] if joints >= BY_NAME[name].joints_needed)
