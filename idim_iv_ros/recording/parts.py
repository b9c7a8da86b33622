"""Joints whose numbers come in messages of their own: each part of the robot is on its own clock.

An arm and its gripper, or the joints of one arm, may share a topic with a message each. What has
the same stamp or not, and the same rate or not, is then no concern of the reader: every part is
put in order, stamped and interpolated by itself.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from idim_iv_ros.recording.bags.joint_messages import JointMessages
from idim_iv_ros.recording.clock import StampedMessages, stamp_messages
from idim_iv_ros.recording.grid import Grid, on_grid, read_only
from idim_iv_ros.recording.recording import Note, Signal
from idim_iv_ros.types import BoolArray, IntArray


@dataclass(frozen=True)
class Part:
    """Joints that come together, and the messages of each source that hold them.

    `columns` (k,) int: places of the joints among all that are read. `stamped`: with the columns of
    these joints only.
    """

    columns: IntArray
    stamped: Mapping[str, StampedMessages]


def parts_of(sources: Mapping[str, JointMessages], where: str) -> tuple[Part, ...]:
    """Split the messages of all sources by the joints that come together in every source.

    Raises DataError: see `stamp_messages`.
    """
    labels = np.array([_together(messages.named) for messages in sources.values()])
    _, label = np.unique(labels, axis=1, return_inverse=True)
    columns = [np.flatnonzero(label == part) for part in dict.fromkeys(label.ravel().tolist())]
    return tuple(
        Part(
            joints,
            {
                source: stamp_messages(_of_joints(messages, joints), where)
                for source, messages in sources.items()
            },
        )
        for joints in columns
    )


def _together(named: BoolArray) -> IntArray:
    """Label (n_joints,) the joints that messages name (n_layouts, n_joints) together."""
    label = np.arange(named.shape[1])
    for layout in named:
        joined = np.isin(label, label[layout])
        label[joined] = np.min(label[joined], initial=named.shape[1])
    present = named.any(axis=0)
    # Joints that are never named split nothing.
    label[~present] = label[present][0] if present.any() else 0
    return label


def _of_joints(messages: JointMessages, joints: IntArray) -> JointMessages:
    """Messages that name some of the joints, or no joint at all, with these joints only."""
    whole = len(joints) == messages.named.shape[1]
    some = np.flatnonzero(messages.named[:, joints].any(axis=1) | ~messages.named.any(axis=1))
    kept = np.isin(messages.layout, some if len(some) else messages.layout)
    chosen = messages if kept.all() else messages.taken(np.flatnonzero(kept))
    if whole:
        return chosen
    values = {name: value[:, joints] for name, value in chosen.values.items()}
    return replace(chosen, values=values, named=messages.named[:, joints])


def parts_note(topic: str, parts: Sequence[Part], joints: Sequence[str]) -> list[Note]:
    """Say which joints come in which message, where there is more than one."""
    if len(parts) == 1:
        return []
    listed = "; ".join(", ".join(joints[place] for place in part.columns) for part in parts)
    return [Note(topic, f"the joints come in {len(parts)} messages, put together: {listed}", 1)]


def joined(
    grid: Grid, parts: Sequence[Part], source: str, name: str, *, stepwise: bool = False
) -> Signal:
    """One quantity of all joints on the grid, each part from its own stamps.

    `stepwise`: a value stays until the next one, as commands of servos do.
    """
    first = parts[0].stamped[source].messages
    origin = f"{first.topic} {first.origins.get(name, name)}"
    signals = []
    for part in parts:
        stamped = part.stamped[source]
        values, smooth = stamped.messages.values[name], name == "position"
        signals.append(
            on_grid(grid, stamped.time, values, origin, smooth=smooth, stepwise=stepwise)
        )
    if len(parts) == 1:
        return signals[0]
    order = np.argsort(np.concatenate([part.columns for part in parts]))
    values = np.hstack([signal.values for signal in signals])[:, order]
    invented = np.hstack([signal.invented for signal in signals])[:, order]
    return Signal(read_only(values), read_only(invented), origin)
