"""Torques of effects at one step of MuJoCo (compiled).

The laws are those of `effects/`; MuJoCo has the rest: what opposes motion becomes its dry friction
(`frictionloss`) and its damping of this step, which it solves together with contacts and limits,
and what does not becomes an applied force. The project's own simulator asks the same laws at the
same instants (`simulation.effect_kernel`), but solves friction, steps and rigid bodies by itself.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from idim_iv_ros.compilation import dispatcher, entry, kernel, source_digest
from idim_iv_ros.effects import registry
from idim_iv_ros.effects.contribution import LEAST_SPEED, Instant, Load
from idim_iv_ros.effects.registry import TORQUE_LAWS
from idim_iv_ros.simulation import effect_kernel
from idim_iv_ros.simulation.effect_kernel import (
    LEAST_LEVEL,
    Rows,
    acting_torque,
    advance_states,
    measure,
    states_turn,
)
from idim_iv_ros.types import FloatArray, IntArray

_torque = dispatcher({kind: law.torque for kind, law in enumerate(TORQUE_LAWS)}, "p, at, state")


class Friction(NamedTuple):
    """Friction of the model, and what effects replace of it: n joints, then couplings.

    Attributes
    ----------
    level, damping : (contacts,), (n,)
        Dry friction less what effects take the place of; viscous friction.
    model_level : (n,)
        Dry friction before that.
    inertia : (n,)
        Of the drives, kg m².
    dry, dissipative : (contacts,), (n,)
        Which have dry friction at any time; whose friction is kept from driving.
    first, second, direction : (contacts,)
        Joints whose speeds a contact adds; second −1 for a joint of its own.
    """

    level: FloatArray
    damping: FloatArray
    model_level: FloatArray
    inertia: FloatArray
    dry: NDArray[np.bool_]
    dissipative: NDArray[np.bool_]
    first: IntArray
    second: IntArray
    direction: FloatArray


class Motion(NamedTuple):
    """Where the n joints are at the start of a step.

    Attributes
    ----------
    position, velocity, acceleration : (n,)
        The acceleration is that of the last step.
    load, static : (n,)
        Torque of the links, and the same without accelerations, N m (N).
    push : (n,)
        Direction in which a joint at rest would be moved, −1, 0 or 1.
    moved, rest : (n,)
        Since the last step, rad (m); zeros.
    """

    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    load: FloatArray
    static: FloatArray
    push: FloatArray
    moved: FloatArray
    rest: FloatArray


@kernel
def _slip(friction: Friction, contact: int, values: FloatArray) -> float:
    total: float = values[friction.first[contact]]
    if friction.second[contact] >= 0:
        total += friction.direction[contact] * values[friction.second[contact]]
    return total


def _entries(digest: str) -> tuple[Callable[..., Any], Callable[..., Any]]:
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
        for t in range(rows.state.shape[0]):
            c = rows.joint[t]
            ahead = _slip(friction, c, motion.velocity)
            ahead += 0.5 * step * _slip(friction, c, motion.acceleration)
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
            middle = time + 0.5 * step
            at = Instant(start_time + middle, middle, position, max(sign * ahead, 0.0), sign, load,
                         velocity, step)  # fmt: skip
            term = _torque(rows.kind[t], rows.value[t], at, rows.state[t])
            level[c] += term.level
            damping[c] += term.damping
            if c < n:
                # Half a step ahead, where MuJoCo's implicit damping puts the velocity.
                stiff = 0.5 * step * term.stiffness
                damping[c] += stiff
                force[c] += term.force - stiff * velocity
        for c in range(level.shape[0]):
            speed_of = abs(_slip(friction, c, motion.velocity))
            if damping[c] < 0.0 and (c >= n or friction.dissipative[c]):
                # Less friction at higher speed: a lower level, which cannot drive.
                level[c] += damping[c] * max(speed_of, LEAST_SPEED)
                damping[c] = 0.0
            if friction.dry[c]:
                level[c] = max(level[c], LEAST_LEVEL)
            level[c] = max(level[c], 0.0)

    @entry
    def drives(
        rows: Rows,
        commanded: FloatArray,
        acting: FloatArray,
    ) -> None:
        """Write the torque that acts for a commanded one, (n,)."""
        _ = digest
        for i in range(commanded.shape[0]):
            acting[i] = acting_torque(rows, i, commanded[i])

    @entry
    def encoders(rows: Rows, q: FloatArray, dq: FloatArray, measured: FloatArray) -> None:
        """Write what encoders show, (2, n)."""
        _ = digest
        measure(rows, q, dq, measured)

    return torques, drives, encoders  # type: ignore[return-value]


torques, drives, encoders = _entries(source_digest(effect_kernel, *registry.MODULES))  # type: ignore[misc]
