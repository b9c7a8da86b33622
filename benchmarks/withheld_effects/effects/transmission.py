"""Effects between the motor and its link."""

import numpy as np

from benchmarks.withheld_effects.drive import altered
from benchmarks.withheld_effects.effects.effect import Effect, on_drive
from benchmarks.withheld_effects.robot import GivenRobot
from benchmarks.withheld_effects.world import World, with_drive

LINK_INERTIA = 0.5  # share of the armature: a light link to choose stiffness and damping by


def elasticity(rng: np.random.Generator, given: GivenRobot, joint: int) -> Effect:
    """Two masses with a hardening shaft, seen from the motor; strength is its compliance.

    The catalogue linearises one linear spring around the rigid motion.
    """
    hardening, damping = rng.uniform(50.0, 400.0), rng.uniform(0.02, 0.08)
    inertia = LINK_INERTIA * given.armature[joint]

    def apply(world: World, strength: float) -> World:
        stiffness = inertia * (2.0 * np.pi * 20.0) ** 2 / strength
        values = {
            "stiffness": stiffness,
            "hardening": hardening,
            "damping": 2.0 * damping * np.sqrt(stiffness * inertia),
        }
        return with_drive(world, altered(world.drive, joint, **values))

    return Effect("elasticity", joint, apply, 0.3, 12.0, {"hardening": hardening})


def backlash(rng: np.random.Generator, given: GivenRobot, joint: int) -> Effect:
    """Two masses with a dead zone and flanks that push and never pull."""
    damping = rng.uniform(0.2, 0.5)
    stiffness = LINK_INERTIA * given.armature[joint] * (2.0 * np.pi * rng.uniform(150, 220)) ** 2

    apply = on_drive(
        joint,
        lambda strength: {
            "stiffness": stiffness,
            "damping": 2.0 * damping * np.sqrt(stiffness * LINK_INERTIA * given.armature[joint]),
            "gap": 4e-3 * strength,
        },
    )

    return Effect("backlash", joint, apply, 0.5, 5.0, {"stiffness": stiffness})


def joint_coupling(rng: np.random.Generator, given: GivenRobot, joint: int) -> Effect:
    """Friction of the sum of two speeds with a power law, on this joint and the one before.

    The catalogue's is linear viscous and dry.
    """
    exponent, dry_part = rng.uniform(0.6, 1.4), rng.uniform(0.4, 0.9)
    before = joint - 1 if joint > 0 else 1

    def apply(world: World, strength: float) -> World:
        torque = strength * given.dry[joint]
        return with_drive(
            world,
            world.drive._replace(
                pair=np.array([before, joint]),
                pair_ratio=np.ones(1),
                pair_dry=np.array([torque * dry_part]),
                pair_viscous=np.array([torque * (1.0 - dry_part)]),
                pair_exponent=np.array([exponent]),
            ),
        )

    return Effect(
        "joint_coupling",
        joint,
        apply,
        0.07,
        15.0,
        {"with_joint": str(before + 1), "exponent": exponent, "dry_part": dry_part},
        joints=(joint, before),
    )


def spring(rng: np.random.Generator, given: GivenRobot, joint: int) -> Effect:
    """Spring that hardens as sinh or softens as arctan; the catalogue adds a cubic term."""
    bend = rng.uniform(0.35, 0.7) * rng.choice([1.0, 1.0, -0.4])
    at = given.centre[joint] + rng.uniform(-0.3, 0.3)

    apply = on_drive(
        joint,
        lambda strength: {
            "spring": strength * 0.1 * given.effort[joint],
            "spring_at": at,
            "spring_bend": bend,
        },
    )

    return Effect("spring", joint, apply, 0.05, 40.0, {"bend": bend, "at": at})


def position_ripple(rng: np.random.Generator, given: GivenRobot, joint: int) -> Effect:
    """Two waves over the position that are no integers and no multiples of each other."""
    wave = rng.uniform(9.3, 41.0)
    waves = np.array([wave, wave * rng.uniform(1.35, 1.9)])
    share, phase = rng.uniform(0.1, 0.35), rng.uniform(0.0, 2.0 * np.pi, 2)

    apply = on_drive(
        joint,
        lambda strength: {
            "ripple": (strength * 0.01 * given.effort[joint]) * np.array([1.0, share]),
            "ripple_wave": waves,
            "ripple_phase": phase,
        },
    )

    return Effect(
        "position_ripple", joint, apply, 0.2, 40.0, {"wave": wave, "second": float(waves[1])}
    )


def encoder_eccentricity(rng: np.random.Generator, given: GivenRobot, joint: int) -> Effect:
    """On what the encoder tells, controller included; with a part twice a turn."""
    phase, second = rng.uniform(0.0, 2.0 * np.pi, 2), rng.uniform(0.2, 0.5)

    apply = on_drive(
        joint,
        lambda strength: {
            "eccentricity": 2e-3 * strength * np.array([1.0, second]),
            "eccentricity_phase": phase,
        },
    )

    return Effect("encoder_eccentricity", joint, apply, 8.0, 10.0, {"second": second})


def encoder_offset(rng: np.random.Generator, given: GivenRobot, joint: int) -> Effect:
    """The encoder's zero is not the drawing's; of large arms not at the first or last joint."""
    last = len(given.joints) - 1
    joint = joint if last == 1 else min(max(joint, 1), last - 1)
    side = rng.choice([-1.0, 1.0])

    apply = on_drive(joint, lambda strength: {"zero": 5e-3 * side * strength})

    return Effect("encoder_offset", joint, apply, 1.0, 10.0, {"side": side}, measure="given")
