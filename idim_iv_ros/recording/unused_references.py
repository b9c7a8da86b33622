"""Topics that could be the reference of a recording and are not used."""

from collections.abc import Sequence

from idim_iv_ros.errors import DataError
from idim_iv_ros.recording.bags.cdr_layout import JOINT_STATE, read_layout
from idim_iv_ros.recording.bags.folder import Bag
from idim_iv_ros.recording.reference_names import sounds_like_reference


def unused_references(bag: Bag, used: Sequence[str], joints: Sequence[str]) -> tuple[str, ...]:
    """Return the topics of a bag that hold positions of all joints, likely references first.

    Parameters
    ----------
    bag
        It was read before, so that its topics are known.
    used
        Topics that are used already.
    joints
        Names of the joints.
    """
    other = {name for name, kind in bag.topics.items() if kind == JOINT_STATE} - set(used)
    found: set[str] = set()
    waiting = set(other)
    for topic, batch in Bag(bag.path).batches(other) if other else ():
        if topic in waiting and len(batch):
            waiting.discard(topic)
            if _holds(batch.message(0), joints):
                found.add(topic)
        if not waiting:
            break
    return tuple(sorted(found, key=lambda name: (not sounds_like_reference(name), name)))


def _holds(message: bytes, joints: Sequence[str]) -> bool:
    try:
        layout = read_layout(message, JOINT_STATE)
    except DataError:
        return False
    _, positions = layout.fields["position"]
    return set(joints) <= set(layout.names) and positions == len(layout.names)
