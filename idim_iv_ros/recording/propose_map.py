"""A first map of a table from the names of its columns, to be corrected by whoever knows them."""

import re
from pathlib import Path

from idim_iv_ros.errors import UsageError
from idim_iv_ros.recording.table_map import SIGNALS, column_names

_TIME = re.compile(r"^(t|time|times|timestamp|stamp|sec|secs|seconds|clock)([_ .(\[]|$)", re.I)
_UNITS = (("ns", r"ns\b|nano"), ("us", r"us\b|µs|micro"), ("ms", r"ms\b|milli"))
# Words of a name that say which signal it is; what is left says which joint.
_WORDS = {
    "reference": r"ref|reference|des|desired|cmd|command|commanded|target|goal|set|setpoint",
    "velocity": r"dq|qd|qdot|vel|velocity|velocities|speed|omega",
    "effort": r"tau|torque|torques|effort|efforts|current|trq|eff|moment",
    "link": r"link|output|load|secondary",
    "position": r"q|pos|position|positions|theta|angle|angles|act|actual|meas|measured",
}
# Words that tell no joint from another.
_OF_ALL = ("j", "joint", "joints", "axis", "motor", "robot", "arm", "deg", "rad", "nm")


def _signal(name: str) -> tuple[str, str] | None:
    """Signal and joint that a name stands for; None where no word of it says so."""
    parts = re.findall(r"[A-Za-z]+|\d+", re.sub(r"([a-z])([A-Z])", r"\1 \2", name))
    kinds, rest = set(), []
    for part in parts:
        kind = next((k for k, words in _WORDS.items() if re.fullmatch(words, part, re.I)), None)
        if kind is not None:
            kinds.add(kind)
        elif part.lower() not in _OF_ALL:
            rest.append(part.lower())
    if not kinds:
        return None
    if kinds >= {"reference", "velocity"}:
        return "velocity_reference", "_".join(rest)
    first = next(kind for kind in _WORDS if kind in kinds)
    return first, "_".join(rest)


def proposed_map(table: Path) -> str:
    """Text of a map, every key with a comment.

    Raises
    ------
    UsageError
        No column is named like a position.
    """
    names = column_names(table)
    time = next((name for name in names if _TIME.match(name.rpartition("/")[2])), None)
    joints: dict[str, dict[str, str]] = {}
    unknown = []
    for name in names:
        found = None if name == time else _signal(name.rpartition("/")[2])
        if found is None:
            if name != time:
                unknown.append(name)
            continue
        joints.setdefault(found[1], {}).setdefault(found[0], name)
    joints = {joint: columns for joint, columns in joints.items() if "position" in columns}
    if not joints:
        raise UsageError(
            f"{table}: no column is named like a position, there are {', '.join(names[:30])}; "
            "write a map by hand, see docs/commands.md"
        )
    lines = [
        "# Which column is what: correct it, then idim-iv import OUT.mcap --columns THIS_FILE",
        f"file: {_text(table.name)}  # beside this map",
    ]
    if time is None:
        lines.append("rate: 1000.0  # rows per second: no column is named like a time; CHECK")
    else:
        unit = next((u for u, words in _UNITS if re.search(words, time, re.I)), "s")
        lines.append(f"time: {{column: {_text(time)}, unit: {unit}}}  # s, ms, us, ns or iso")
    lines.append("joints:  # names as the URDF has them")
    for joint, columns in joints.items():
        shown = f"joint_{joint}" if joint.isdigit() else joint or "joint_1"
        pairs = ", ".join(f"{s}: {_text(columns[s])}" for s in SIGNALS if s in columns)
        lines.append(f"  {shown}: {{{pairs}}}")
    lines += [
        "units:",
        "  position: rad  # rad, deg, rev, m or mm; of references and link, too",
        "  velocity: rad/s  # rad/s, deg/s, rev/s, rpm, m/s or mm/s",
        "  effort: N m  # N m, mN m, N, kN, A or mA",
        "# Of text: delimiter: ';'   decimal: ','   comment: '#'",
    ]
    if unknown:
        lines.append(f"# Not used: {', '.join(unknown)}")
    return "\n".join(lines) + "\n"


def _text(name: str) -> str:
    """A name as YAML reads it back, whatever is in it."""
    return "'" + name.replace("'", "''") + "'"
