"""Frozen stretches of all channels of a bag, taken out before anything is put on a grid."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from idim_iv_ros.recording.clock import StampedMessages
from idim_iv_ros.recording.held_samples import (
    FrozenStretches,
    described,
    frozen_efforts,
    frozen_positions,
    moving_speed,
)
from idim_iv_ros.types import BoolArray, FloatArray, IntArray


def without_frozen(
    stamped: dict[str, StampedMessages],
    joint_states: str,
    effort: str,
    joints: Sequence[str],
    start: int,
) -> tuple[dict[str, StampedMessages], tuple[FrozenStretches, ...]]:
    """Take out what efforts and positions repeat while they are frozen.

    Parameters
    ----------
    stamped
        Messages of each topic.
    joint_states, effort
        Topics of the positions and of the efforts.
    joints
    start
        Of the recording, ns.

    Returns
    -------
    dict
        The same messages, with NaN for frozen values.
    tuple of FrozenStretches
    """
    states, efforts = stamped[joint_states], stamped[effort]
    positions, torques = states.messages.values["position"], efforts.messages.values["effort"]
    found: list[FrozenStretches] = []
    lost = np.zeros(positions.shape, dtype=bool), np.zeros(torques.shape, dtype=bool)
    for column, joint in enumerate(joints):
        position = positions[:, column]
        lost[0][:, column] = frozen_positions(position, moving_speed(position))
        there = _at(efforts.time, states.time, position)
        lost[1][:, column] = frozen_efforts(torques[:, column], there, moving_speed(there))
        for name, topic, frozen in (
            ("position", states, lost[0][:, column]),
            ("effort", efforts, lost[1][:, column]),
        ):
            channel = f"{name} of {joint} on {topic.messages.topic}"
            seconds: FloatArray = (topic.time - start).astype(np.float64) * 1e-9
            stretches = described(channel, frozen, seconds)
            found += [] if stretches is None else [stretches]
    if not found:
        return stamped, ()
    cleaned = dict(stamped)
    cleaned[joint_states] = _without(cleaned[joint_states], "position", lost[0])
    cleaned[effort] = _without(cleaned[effort], "effort", lost[1])
    return cleaned, tuple(found)


def _at(wanted: IntArray, time: IntArray, position: FloatArray) -> FloatArray:
    """Positions at the times of the efforts, linearly where these are others."""
    if wanted is time or np.array_equal(wanted, time):
        return position
    known = np.isfinite(position)
    begin = time[0]
    return np.asarray(np.interp(wanted - begin, time[known] - begin, position[known]))


def _without(stamped: StampedMessages, field: str, lost: BoolArray) -> StampedMessages:
    values = np.where(lost, np.nan, stamped.messages.values[field])
    messages = replace(stamped.messages, values={**stamped.messages.values, field: values})
    return replace(stamped, messages=messages)
