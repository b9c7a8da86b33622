"""URDFs that are no robots, and robots that cannot be."""

import math
from collections.abc import Callable, Iterator
from functools import partial
from itertools import pairwise
from pathlib import Path

import numpy as np

from tests.fuzz.case import (
    CONFIG,
    Case,
    Good,
    command,
    excitation,
    first_configuration,
    flipped,
    simulation,
    write_configuration,
    write_text,
)

_WHOLE = (CONFIG / "arm2.urdf").read_text(encoding="utf-8")
_COMMANDS = ("check", "simulate", "init", "identify", "excite")


def cases(seed: int) -> Iterator[Case]:
    """Texts, replacements in the arm's URDF, and arms with random numbers."""
    impossible = {**_NO_ROBOTS, **{name: _replaced(pairs) for name, pairs in _IMPOSSIBLE.items()}}
    odd = {**_ODD_ROBOTS, **{name: _replaced(pairs) for name, pairs in _STRANGE.items()}}
    for number, (name, text) in enumerate({**impossible, **odd}.items()):
        build = partial(_with_urdf, lambda _, text=text: text, _COMMANDS[number % len(_COMMANDS)])
        yield Case(f"urdf-{name}", build, name in impossible)
    for number in range(15):
        what = _COMMANDS[number % len(_COMMANDS)]
        yield Case(f"urdf-random-{number}", partial(_with_urdf, _numbers_changed, what))
    for number in range(5):
        yield Case(f"urdf-flipped-{number}", partial(_with_urdf, _flipped, "check"))
        yield Case(f"urdf-lines-lost-{number}", partial(_with_urdf, _lines_lost, "init"))


def _with_urdf(
    text_of: Callable[[np.random.Generator], str],
    what: str,
    folder: Path,
    good: Good,
    random: np.random.Generator,
) -> list[str]:
    urdf = write_text(folder / "robot.urdf", text_of(random))
    config = write_configuration(folder, urdf="robot.urdf")
    if what == "simulate":
        return simulation(folder, config)
    if what == "excite":
        return excitation(folder, config)
    if what == "init":
        return first_configuration(folder, good.bag, urdf)
    return command(what, folder, [good.bag], config)


def _replaced(pairs: tuple[tuple[str, str], ...]) -> str:
    text = _WHOLE
    for old, new in pairs:
        assert old in text, old
        text = text.replace(old, new)
    return text


def _chain(links: int, joint: str = "revolute") -> str:
    parts = ['<robot name="r"><link name="l0"/>']
    for k in range(1, links + 1):
        name = f"joint_{k}"
        parts.append(
            f'<link name="l{k}"><inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" '
            f'iyy="1" iyz="0" izz="1"/></inertial></link><joint name="{name}" type="{joint}">'
            f'<parent link="l{k - 1}"/><child link="l{k}"/><origin xyz="0.1 0 0"/>'
            '<axis xyz="0 1 0"/><limit lower="-1" upper="1" velocity="1" effort="50"/></joint>'
        )
    return "".join(parts) + "</robot>"


def bomb(letters: str) -> str:
    """Entities within entities, each ten times."""
    entities = "".join(f'<!ENTITY {b} "{f"&{a};" * 10}">' for a, b in pairwise(letters))
    head = f'<?xml version="1.0"?><!DOCTYPE r [<!ENTITY {letters[0]} "aaaaaaaaaa">{entities}]>'
    return f'{head}<robot name="&{letters[-1]};"/>'


_MASS, _INERTIA = '<mass value="4.2"/>', 'ixx="0.0042525"'
_LIMIT = 'lower="-2.8" upper="2.8" velocity="4.0" effort="90"'

_NO_ROBOTS = {
    "empty": "",
    "not-xml": "robot: {}",
    "binary": "\udcff\udc80\udcfe" * 100,
    "html": "<html><body>404</body></html>",
    "no-links": '<robot name="r"/>',
    "one-link": '<robot name="r"><link name="a"/></robot>',
    "bomb": bomb("abcdefghij"),
    "half": _WHOLE[: len(_WHOLE) // 2],
    "unknown-type": _chain(2, "wobbly"),
    "fixed": _chain(2, "fixed"),
}
_ODD_ROBOTS = {
    "external-entity": (
        '<?xml version="1.0"?><!DOCTYPE r [<!ENTITY e SYSTEM "file:///etc/passwd">]>'
        + _WHOLE.partition("?>")[2].replace('name="arm2"', 'name="&e;"')
    ),
    "deep": "<robot>" + "<a>" * 20_000 + "</a>" * 20_000 + "</robot>",
    "long-name": _WHOLE.replace('name="arm2"', f'name="{"r" * 100_000}"'),
    "twice": _WHOLE + _WHOLE.partition("?>")[2],
    "utf-16": _WHOLE.encode("utf-16").decode("utf-8", "surrogateescape"),
    "thousand-links": _chain(1000),
    "spheres": _chain(2, "floating"),
    "prismatic": _chain(2, "prismatic"),
    "continuous": _chain(2, "continuous"),
}

_IMPOSSIBLE: dict[str, tuple[tuple[str, str], ...]] = {
    "cycle": (('<child link="tool0"/>', '<child link="base_link"/>'),),
    "missing-parent": (('<parent link="link_1"/>', '<parent link="none"/>'),),
    "two-parents": (('<child link="tool0"/>', '<child link="link_1"/>'),),
    "same-link-twice": (('<link name="tool0"/>', '<link name="link_2"/>'),),
    "negative-mass": ((_MASS, '<mass value="-4.2"/>'),),
    "infinite-mass": ((_MASS, '<mass value="inf"/>'),),
    "text-mass": ((_MASS, '<mass value="heavy"/>'),),
    "indefinite-inertia": (('ixz="0.0009"', 'ixz="5"'),),
    "broken-inequality": ((_INERTIA, 'ixx="50"'),),
    "nan-inertia": ((_INERTIA, 'ixx="nan"'),),
    "zero-axis": (('<axis xyz="0 1 0"/>', '<axis xyz="0 0 0"/>'),),
    "nan-origin": (('xyz="0.42 0 0"', 'xyz="nan 0 0"'),),
    "limits-swapped": ((_LIMIT, 'lower="2.8" upper="-2.8" velocity="4.0" effort="90"'),),
    "limits-nan": ((_LIMIT, 'lower="nan" upper="nan" velocity="nan" effort="nan"'),),
}
_STRANGE: dict[str, tuple[tuple[str, str], ...]] = {
    "joint-named-as-link": (('"link_1"', '"joint_1"'), ('"link_2"', '"joint_2"')),
    "no-inertial": (("inertial>", "visual_>"),),
    "zero-mass": ((_MASS, '<mass value="0"/>'),),
    "huge-mass": ((_MASS, '<mass value="1e300"/>'),),
    "tiny-mass": ((_MASS, '<mass value="1e-300"/>'),),
    "huge-inertia": ((_INERTIA, 'ixx="1e305"'),),
    "zero-inertia": (('"0.0042525"', '"0"'), ('"0.0581263"', '"0"'), ('"0.0009"', '"0"')),
    "long-axis": (('<axis xyz="0 1 0"/>', '<axis xyz="0 1e200 0"/>'),),
    "tiny-axis": (('<axis xyz="0 1 0"/>', '<axis xyz="0 1e-200 0"/>'),),
    "vertical-axes": (('<axis xyz="0 1 0"/>', '<axis xyz="0 0 1"/>'),),
    "huge-origin": (('xyz="0.42 0 0"', 'xyz="1e200 0 0"'),),
    "huge-rpy": (('xyz="0.42 0 0" rpy="0 0 0"', 'xyz="0.42 0 0" rpy="1e300 0 0"'),),
    "limits-equal": ((_LIMIT, 'lower="1" upper="1" velocity="4.0" effort="90"'),),
    "limits-huge": ((_LIMIT, 'lower="-1e300" upper="1e300" velocity="1e300" effort="1e300"'),),
    "limits-tiny": ((_LIMIT, 'lower="-1e-9" upper="1e-9" velocity="1e-9" effort="1e-9"'),),
    "no-limits": ((f"<limit {_LIMIT}/>", ""),),
    "huge-friction": (('friction="1.8"', 'friction="1e300"'),),
    "mimic-itself": ((f"<limit {_LIMIT}/>", f'<limit {_LIMIT}/><mimic joint="joint_1"/>'),),
    "markup-name": (('"link_2"', '"[/]link_2[red]"'),),
}


def _numbers_changed(random: np.random.Generator) -> str:
    """The arm with one to three of its numbers replaced."""
    parts = _WHOLE.split('"')
    numeric = [k for k in range(1, len(parts), 2) if any(c.isdigit() for c in parts[k][:3])]
    for place in random.choice(numeric[1:], int(random.integers(1, 4)), replace=False):
        words = parts[place].split()
        chosen = int(random.integers(len(words)))
        kinds = (
            "nan", "inf", "-1", "0", "1e308", "-1e308", "1e-308", "x", "", "1e9999", "0x1F", "１",
            repr(math.exp(random.normal(0, 20))),
        )  # fmt: skip
        words[chosen] = str(random.choice(kinds))
        parts[place] = " ".join(words)
    return '"'.join(parts)


def _flipped(random: np.random.Generator) -> str:
    return flipped(_WHOLE.encode(), random, 6).decode("utf-8", "surrogateescape")


def _lines_lost(random: np.random.Generator) -> str:
    lines = _WHOLE.splitlines()
    lost = set(map(int, random.integers(2, len(lines), 3)))
    return "\n".join(line for k, line in enumerate(lines) if k not in lost)
