"""Topics that a configuration names, in a bag: relative names lie in the namespace of a robot.

A name with a leading slash is meant as it is written. One without is relative, as everywhere in
ROS: a node in the namespace ``/left`` records ``joint_states`` as ``/left/joint_states``, and the
same configuration finds it there again.
"""

from collections.abc import Collection, Mapping
from pathlib import Path

from idim_iv_ros.errors import DataError

ROBOT_DESCRIPTION = "robot_description"


def in_root(name: str) -> str:
    """Return a name as a node without a namespace resolves it."""
    return name if name.startswith("/") else f"/{name}"


def topics_in_bag(
    path: Path,
    named: Mapping[str, str],
    topics: Collection[str],
    node_topics: Mapping[str, str],
) -> dict[str, str]:
    """Return the full names of topics that a configuration names.

    All relative names lie in one namespace, for a reference of another robot is none: in that of
    the node that asks (``/`` where none asks) if the first of them is there, else where the only
    topic lies whose name ends with the first of them.

    `path`: the bag, for messages. `named`: name of each key of the section `signals`, the one that
    matters most first. `topics`: full names of the topics that can be meant. `node_topics`: what
    relative names are for the node that asks, remapping included. Of a topic that the bag does not
    hold the name that it should have is returned.
    Raises DataError: several topics end with a relative name.
    """
    full_names = {name: name for name in named.values() if name.startswith("/")}
    relative = {key: name for key, name in named.items() if not name.startswith("/")}
    if not relative:
        return full_names
    key, first = next(iter(relative.items()))
    mine = {name: node_topics.get(name, in_root(name)) for name in relative.values()}
    candidates = sorted(topic for topic in topics if topic.endswith(f"/{first}"))
    if mine[first] in topics or not candidates:
        return {**full_names, **mine}
    if len(candidates) > 1:
        rest = ", ".join(other for other, name in relative.items() if name != first)
        others = f", and the same for {rest}" if rest else ""
        raise DataError(
            f"{path}: signals.{key}: {first} may be {' or '.join(candidates)}: write the full name "
            f"of your robot's, as `{key}: {candidates[0]}`, under signals{others}"
        )
    namespace = candidates[0].removesuffix(first)
    return {**full_names, **{name: namespace + name for name in relative.values()}}


def descriptions_of(joint_states: str, node_topics: Mapping[str, str]) -> list[str]:
    """Return the topics that may hold the description of a robot, the likeliest first.

    The node's own, then that in the namespace of the joint states, then those above it; at last
    the global one.
    """
    likely = [node_topics[ROBOT_DESCRIPTION]] if ROBOT_DESCRIPTION in node_topics else []
    namespace = joint_states
    while namespace:
        namespace = namespace.rpartition("/")[0]
        likely.append(f"{namespace}/{ROBOT_DESCRIPTION}")
    return list(dict.fromkeys(likely))
