"""Effects of friction; what differs from the catalogue's forms stands in each docstring."""

from dataclasses import replace

import numpy as np

from benchmarks.withheld_effects.drive import BRISTLES, altered
from benchmarks.withheld_effects.effects.effect import Effect, on_drive
from benchmarks.withheld_effects.robot import GivenRobot
from benchmarks.withheld_effects.world import World, with_drive


def stribeck(rng: np.random.Generator, given: GivenRobot, joint: int) -> Effect:
    """Dry friction higher at low speed: exponent 0.6 to 1.6 instead of 2."""
    shape = {"exponent": rng.uniform(0.6, 1.6), "speed": rng.uniform(0.04, 0.2)}

    apply = on_drive(
        joint,
        lambda strength: {
            "breakaway": strength * given.dry[joint],
            "breakaway_speed": shape["speed"],
            "breakaway_exponent": shape["exponent"],
        },
    )

    return Effect("stribeck", joint, apply, 0.3, 6.0, dict(shape))


def nonlinear_viscous(rng: np.random.Generator, given: GivenRobot, joint: int) -> Effect:
    """Power of the speed that is neither 2 nor 3; two in five flatten at speed instead."""
    concave = rng.random() < 0.4
    exponent = rng.uniform(0.35, 0.65) if concave else rng.uniform(1.6, 2.6)
    reference = 0.4 * given.fastest[joint]

    apply = on_drive(
        joint,
        lambda strength: {
            "drag": (strength * given.viscous[joint] * reference) / reference**exponent,
            "drag_exponent": exponent,
        },
    )

    return Effect("nonlinear_viscous", joint, apply, 0.35, 20.0, {"exponent": exponent})


def asymmetric_friction(rng: np.random.Generator, given: GivenRobot, joint: int) -> Effect:
    """Viscous and dry friction differ between the directions, in shares that are drawn."""
    side, dry_part = rng.choice([-1.0, 1.0]), rng.uniform(0.2, 0.6)

    def apply(world: World, strength: float) -> World:
        drive, part = world.drive, np.tanh(strength)
        dry = side * dry_part * part
        # Above a difference of a whole coefficient the sum grows, as friction is not negative.
        grown = 1.0 + max(strength - part, 0.0)
        forward, backward = drive.viscous_forward[joint], drive.viscous_backward[joint]
        return with_drive(
            world,
            altered(
                drive,
                joint,
                viscous_forward=forward * grown * (1.0 + side * part),
                viscous_backward=backward * grown * (1.0 - side * part),
                dry_forward=drive.dry_forward[joint] * (1.0 + dry),
                dry_backward=drive.dry_backward[joint] * (1.0 - dry),
            ),
        )

    return Effect(
        "asymmetric_friction", joint, apply, 0.17, 10.0, {"side": side, "dry_part": dry_part}
    )


def load_dependent_friction(rng: np.random.Generator, given: GivenRobot, joint: int) -> Effect:
    """Grows with the total torque of the motor, its own friction and rotor included, to a power.

    The catalogue takes the rigid-body torque, linearly.
    """
    shape = {"exponent": rng.uniform(0.85, 1.35), "direction": rng.uniform(-0.25, 0.25)}
    scale = 0.15 * given.effort[joint]

    apply = on_drive(
        joint,
        lambda strength: {
            "load": strength * scale,
            "load_scale": scale,
            "load_exponent": shape["exponent"],
            "load_direction": shape["direction"],
        },
    )

    return Effect("load_dependent_friction", joint, apply, 0.035, 0.9, dict(shape))


def static_load_friction(rng: np.random.Generator, given: GivenRobot, joint: int) -> Effect:
    """Load-dependent friction whose load is the torque of gravity and Coriolis forces alone."""
    transmitted = load_dependent_friction(rng, given, joint)

    def apply(world: World, strength: float) -> World:
        loaded = transmitted.apply(world, strength)
        return with_drive(loaded, altered(loaded.drive, joint, load_static=1.0))

    return replace(transmitted, apply=apply, largest=3.0)


def position_dependent_friction(rng: np.random.Generator, given: GivenRobot, joint: int) -> Effect:
    """Two incommensurate waves off the grid of integers, or one tight spot."""
    centre, room = given.centre[joint], 0.25 * (given.upper - given.lower)[joint]
    if rng.random() < 0.6:
        wave, at = rng.uniform(2.2, 9.5), rng.uniform(-3.0, 3.0)

        def apply(world: World, strength: float) -> World:
            return with_drive(
                world,
                altered(
                    world.drive,
                    joint,
                    patch=[strength, 0.0],
                    patch_wave=wave,
                    patch_at=[at, 0.0],
                ),
            )

        return Effect(
            "position_dependent_friction", joint, apply, 0.2, 8.0, {"wave": wave, "at": at}
        )
    spot = centre + rng.uniform(-0.3, 0.3) * room
    width = rng.uniform(0.08, 0.25)

    tight = on_drive(
        joint,
        lambda strength: {"patch": [0.0, strength], "patch_at": [0.0, spot], "patch_width": width},
    )

    return Effect(
        "position_dependent_friction", joint, tight, 0.3, 10.0, {"spot": spot, "width": width}
    )


def friction_drift(rng: np.random.Generator, given: GivenRobot, joint: int) -> Effect:
    """A heat balance driven by the motion, over the session; the catalogue's is a plain decay."""
    time, dry_part = rng.uniform(6.0, 25.0), rng.uniform(0.2, 0.7)
    speed = rng.uniform(0.15, 0.3) * given.fastest[joint]

    def apply(world: World, strength: float) -> World:
        # The cold robot has more friction than the nominal one, the warm one has less.
        drive = world.drive
        grown = 1.0 + 0.6 * strength
        lost = strength / grown
        return with_drive(
            world,
            altered(
                drive,
                joint,
                warm_viscous=min(lost, 0.7),
                warm_dry=min(dry_part * lost, 0.7),
                warm_time=time,
                warm_speed=speed,
                viscous_forward=drive.viscous_forward[joint] * grown,
                viscous_backward=drive.viscous_backward[joint] * grown,
                dry_forward=drive.dry_forward[joint] * (1.0 + dry_part * (grown - 1.0)),
                dry_backward=drive.dry_backward[joint] * (1.0 + dry_part * (grown - 1.0)),
            ),
        )

    return Effect(
        "friction_drift",
        joint,
        apply,
        0.3,
        25.0,
        {"time": time, "dry_part": dry_part},
        whole_session=True,
    )


def friction_drift_anew(rng: np.random.Generator, given: GivenRobot, joint: int) -> Effect:
    """A drift that starts anew with each recording: the joint cools down between them."""
    on = friction_drift(rng, given, joint)

    def apply(world: World, strength: float) -> World:
        return replace(on.apply(world, strength), warmth_kept=0.0)

    return replace(on, apply=apply)


def presliding(rng: np.random.Generator, given: GivenRobot, joint: int) -> Effect:
    """Bundle of bristles with spans and weights of its own; the catalogue's is one exponential."""
    span = np.sort(rng.uniform(0.15, 1.0, BRISTLES))
    span[-1] = 1.0
    weight = rng.dirichlet(np.full(BRISTLES, 3.0))

    apply = on_drive(
        joint,
        lambda strength: {
            "bristle_travel": 3e-3 * strength,
            "bristle_span": span,
            "bristle_weight": weight,
        },
    )

    return Effect("presliding", joint, apply, 0.12, 7.0, {"longest_share": float(weight[-1])})
