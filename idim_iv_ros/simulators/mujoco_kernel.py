"""Torques of effects at one step of MuJoCo (compiled).

The laws are those of `effects/`, asked as `simulation.effect_kernel` asks them; MuJoCo has the
rest: what opposes motion becomes its dry friction (`frictionloss`) and its damping of this step,
which it solves together with contacts and limits, and what does not becomes an applied force.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from idim_iv_ros.compilation import entry, source_digest
from idim_iv_ros.effects import registry
from idim_iv_ros.effects.contribution import LEAST_SPEED, Load
from idim_iv_ros.simulation import dry_friction, effect_kernel
from idim_iv_ros.simulation.dry_friction import slip
from idim_iv_ros.simulation.effect_kernel import (
    LEAST_LEVEL,
    Rows,
    acting_torque,
    advance_states,
    measure,
    states_turn,
    torque_at,
)
from idim_iv_ros.types import FloatArray, IntArray


class Friction(NamedTuple):
    """Friction of the model, and what effects replace of it: n joints, then couplings."""

    # level, damping: (contacts,), (n,): dry friction less what effects take the place of; viscous
    # friction
    level: FloatArray
    damping: FloatArray
    # model_level, inertia: (n,): dry friction before that; of the drives, kg m²
    model_level: FloatArray
    inertia: FloatArray
    # dry, dissipative: (contacts,), (n,): which have dry friction at any time; whose friction is
    # kept from driving
    dry: NDArray[np.bool_]
    dissipative: NDArray[np.bool_]
    # first, second, direction: (contacts,): joints whose speeds a contact adds; second −1 for a
    # joint of its own
    first: IntArray
    second: IntArray
    direction: FloatArray


class Motion(NamedTuple):
    """Where the n joints are at the start of a step, (n,) each.

    The acceleration is that of the last step, `moved` the way since then. `load` is the torque of
    the links, `static` the same without accelerations; `push` is the direction in which a joint at
    rest would be moved; `rest` is zero.
    """

    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    load: FloatArray
    static: FloatArray
    push: FloatArray
    moved: FloatArray
    rest: FloatArray


def _entries(digest: str) -> tuple[Callable[..., Any], Callable[..., Any], Callable[..., Any]]:
    """Compile what Python calls; `digest` is part of its key in numba's cache."""

    @entry
    def torques(
        rows: Rows,
        friction: Friction,
        motion: Motion,
        start_time: float,
        time: float,
        step: float,
        level: FloatArray,
        damping: FloatArray,
        force: FloatArray,
    ) -> None:
        """Write dry friction (contacts,), damping (contacts,) and force (n,) of one step."""
        _ = digest
        n = motion.position.shape[0]
        if step > 0.0:
            # States move by what was travelled since the last step.
            advance_states(rows, motion.moved, motion.rest, 1.0)
            states_turn(rows, motion.velocity, motion.acceleration, step)
        for c in range(level.shape[0]):
            level[c] = friction.level[c]
            damping[c] = friction.damping[c] if c < n else 0.0
        for i in range(n):
            force[i] = 0.0
        middle = time + 0.5 * step
        for t in range(rows.state.shape[0]):
            c = rows.joint[t]
            contact = (friction.first, friction.second, friction.direction, c)
            ahead = slip(*contact, motion.velocity)
            ahead += 0.5 * step * slip(*contact, motion.acceleration)
            sign = np.sign(ahead)
            position = velocity = load = 0.0
            if c < n:
                if sign == 0.0:
                    sign = motion.push[c]
                velocity = motion.velocity[c]
                position = motion.position[c] + 0.5 * step * velocity
                load = motion.load[c]
                if rows.load[t] == Load.STATIC:
                    load = motion.static[c]
                elif rows.load[t] == Load.MOTOR:
                    load += friction.inertia[c] * motion.acceleration[c]
                    load += sign * friction.model_level[c] + friction.damping[c] * velocity
            term = torque_at(
                rows, t, start_time + middle, middle, position, ahead, sign, load, velocity, step
            )
            level[c] += term.level
            damping[c] += term.damping
            if c < n:
                # Half a step ahead, where MuJoCo's implicit damping puts the velocity.
                stiff = 0.5 * step * term.stiffness
                damping[c] += stiff
                force[c] += term.force - stiff * velocity
        for c in range(level.shape[0]):
            if damping[c] < 0.0 and (c >= n or friction.dissipative[c]):
                # Less friction at higher speed: a lower level, which cannot drive.
                contact = (friction.first, friction.second, friction.direction, c)
                speed = abs(slip(*contact, motion.velocity))
                level[c] += damping[c] * max(speed, LEAST_SPEED)
                damping[c] = 0.0
            level[c] = max(level[c], LEAST_LEVEL if friction.dry[c] else 0.0)

    @entry
    def drives(rows: Rows, commanded: FloatArray, acting: FloatArray) -> None:
        """Write the torque that acts for a commanded one, (n,)."""
        _ = digest
        for i in range(commanded.shape[0]):
            acting[i] = acting_torque(rows, i, commanded[i])

    @entry
    def encoders(rows: Rows, q: FloatArray, dq: FloatArray, measured: FloatArray) -> None:
        """Write what encoders show, (2, n)."""
        _ = digest
        measure(rows, q, dq, measured)

    return torques, drives, encoders


torques, drives, encoders = _entries(source_digest(dry_friction, effect_kernel, *registry.MODULES))
