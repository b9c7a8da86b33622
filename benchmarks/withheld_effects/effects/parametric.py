"""Parameters that are not the given ones, one cause at a time; nothing structural."""

from dataclasses import replace

import numpy as np

from benchmarks.withheld_effects.drive import altered
from benchmarks.withheld_effects.effects.effect import Effect, on_drive
from benchmarks.withheld_effects.robot import GivenRobot, Inertials, first_axis, with_body
from benchmarks.withheld_effects.world import World, with_drive


def payload(rng: np.random.Generator, given: GivenRobot, joint: int) -> Effect:
    """A body held by the last link; seen at the first joint that gravity loads."""
    last = len(given.joints) - 1
    centre = rng.uniform([0.02, -0.03, 0.01], [0.12, 0.03, 0.08])

    def apply(world: World, strength: float) -> World:
        mass = 0.2 * strength * world.inertials.mass[last]
        return replace(world, inertials=with_body(world.inertials, last, mass, centre))

    return Effect("payload", last, apply, 0.065, 12.0, joints=(_loaded(given),), measure="given")


def link_inertia(rng: np.random.Generator, given: GivenRobot, joint: int) -> Effect:
    """One link's mass, centre and moments are others than its drawing says."""
    signs, shift = rng.choice([-1.0, 1.0]), rng.uniform(-1.0, 1.0, 3)
    shift /= np.linalg.norm(shift)

    def apply(world: World, strength: float) -> World:
        old = world.inertials
        factor = np.exp(0.15 * signs * strength)
        mass, centre, inertia = old.mass.copy(), old.centre.copy(), old.inertia.copy()
        mass[joint] *= factor
        centre[joint] += 0.01 * min(strength, 4.0) * shift
        inertia[joint] *= factor
        return replace(world, inertials=Inertials(mass, centre, inertia))

    seen = joint if joint > 0 or len(given.joints) == 2 else 1
    return Effect("link_inertia", joint, apply, 0.2, 12.0, joints=(seen,), measure="given")


def gravity_direction(rng: np.random.Generator, given: GivenRobot, joint: int) -> Effect:
    """The base is tilted about an axis in the ground; on a planar arm about the joints' axis."""
    heading = rng.uniform(0.0, 2.0 * np.pi)
    axis = np.array([np.cos(heading), np.sin(heading), 0.0])
    if len(given.joints) == 2:
        axis = rng.choice([-1.0, 1.0]) * first_axis(given)

    def apply(world: World, strength: float) -> World:
        angle = np.deg2rad(strength)
        g = world.gravity
        turned = g * np.cos(angle) + np.cross(axis, g) * np.sin(angle)
        return replace(world, gravity=turned)

    return Effect(
        "gravity_direction", None, apply, 0.6, 40.0, joints=(_loaded(given),), measure="given"
    )


def torque_gain(rng: np.random.Generator, given: GivenRobot, joint: int) -> Effect:
    """The torque constant is off: what is recorded is not what acts."""
    side = rng.choice([-1.0, 1.0])

    apply = on_drive(joint, lambda strength: {"gain": np.exp(0.05 * side * strength)})

    return Effect("torque_gain", joint, apply, 0.2, 12.0, {"side": side}, measure="given")


def friction_level(rng: np.random.Generator, given: GivenRobot, joint: int) -> Effect:
    """Dry and viscous friction of one joint above or below the given ones."""
    part, side = rng.uniform(0.3, 0.9), rng.choice([1.0, 1.0, -1.0])

    def apply(world: World, strength: float) -> World:
        drive = world.drive
        more, thicker = np.exp(side * 0.2 * strength), np.exp(side * 0.2 * part * strength)
        return with_drive(
            world,
            altered(
                drive,
                joint,
                dry_forward=drive.dry_forward[joint] * more,
                dry_backward=drive.dry_backward[joint] * more,
                viscous_forward=drive.viscous_forward[joint] * thicker,
                viscous_backward=drive.viscous_backward[joint] * thicker,
            ),
        )

    return Effect("friction_level", joint, apply, 0.22, 12.0, {"side": side}, measure="given")


def drive_inertia(rng: np.random.Generator, given: GivenRobot, joint: int) -> Effect:
    """Rotor or gear with another inertia than the data sheet's."""
    side = rng.choice([1.0, -1.0])

    def apply(world: World, strength: float) -> World:
        inertia = world.drive.inertia[joint] * np.exp(0.15 * side * strength)
        return with_drive(world, altered(world.drive, joint, inertia=inertia))

    return Effect("drive_inertia", joint, apply, 0.75, 12.0, {"side": side}, measure="given")


def _loaded(given: GivenRobot) -> int:
    """First joint with a horizontal axis."""
    return 0 if len(given.joints) == 2 else 1
