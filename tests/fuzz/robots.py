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
    flipped,
    simulation,
    write_configuration,
    write_text,
)

_WHOLE = (CONFIG / "arm2.urdf").read_text(encoding="utf-8")
_COMMANDS = ("check", "simulate", "check", "identify", "excite")


def cases(seed: int) -> Iterator[Case]:
    """Texts, replacements in the arm's URDF, and arms with random numbers."""
    for number, (name, text) in enumerate(texts().items()):
        what = _COMMANDS[number % len(_COMMANDS)]
        build = partial(_with_urdf, lambda _, text=text: text, what)
        yield Case(f"urdf-{name}", build, name in _IMPOSSIBLE)
    for number in range(20):
        what = _COMMANDS[number % len(_COMMANDS)]
        yield Case(f"urdf-random-{number}", partial(_with_urdf, _numbers_changed, what))
    for name, change, count in _DAMAGED:
        for number in range(count):
            yield Case(f"urdf-{name}-{number}", partial(_with_urdf, change, "check"))


def texts() -> dict[str, str]:
    """URDFs by what is wrong with them."""
    return {**_TEXTS, **{name: _replaced(*pairs) for name, pairs in _REPLACED.items()}}


def _with_urdf(
    text_of: Callable[[np.random.Generator], str],
    what: str,
    folder: Path,
    good: Good,
    random: np.random.Generator,
) -> list[str]:
    write_text(folder / "robot.urdf", text_of(random))
    config = write_configuration(folder, urdf="robot.urdf")
    if what == "simulate":
        return simulation(folder, config)
    if what == "excite":
        return excitation(folder, config)
    return command(what, folder, [good.bag], config)


def _replaced(*pairs: tuple[str, str]) -> str:
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


def _bomb(letters: str) -> str:
    entities = "".join(f'<!ENTITY {b} "{f"&{a};" * 10}">' for a, b in pairwise(letters))
    head = f'<?xml version="1.0"?><!DOCTYPE r [<!ENTITY {letters[0]} "aaaaaaaaaa">{entities}]>'
    return f'{head}<robot name="&{letters[-1]};"/>'


_MASS, _INERTIA = '<mass value="4.2"/>', 'ixx="0.0042525"'
_LIMIT = 'lower="-2.8" upper="2.8" velocity="4.0" effort="90"'
_AXIS_1 = '<origin xyz="0 0 0.6" rpy="0 0 0"/>\n    <axis xyz="0 1 0"/>'

_TEXTS = {
    "empty": "",
    "not-xml": "robot: {}",
    "binary": "\udcff\udc80\udcfe" * 100,
    "html": "<html><body>404</body></html>",
    "no-links": '<robot name="r"/>',
    "one-link": '<robot name="r"><link name="a"/></robot>',
    "no-name": "<robot/>",
    "bomb": _bomb("abcdefghij"),
    "external-entity": (
        '<?xml version="1.0"?><!DOCTYPE r [<!ENTITY e SYSTEM "file:///etc/passwd">]>'
        + _WHOLE.partition("?>")[2].replace('name="arm2"', 'name="&e;"')
    ),
    "deep": "<robot>" + "<a>" * 20_000 + "</a>" * 20_000 + "</robot>",
    "long-name": _WHOLE.replace('name="arm2"', f'name="{"r" * 100_000}"'),
    "half": _WHOLE[: len(_WHOLE) // 2],
    "twice": _WHOLE + _WHOLE.partition("?>")[2],
    "xacro": _WHOLE.replace('value="4.2"', 'value="${mass}"'),
    "comma-decimals": _WHOLE.replace("0.0581263", "0,0581263"),
    "utf-16": _WHOLE.encode("utf-16").decode("utf-8", "surrogateescape"),
    "thousand-links": _chain(1000),
    "hundred-fixed": _chain(2) .replace("</robot>", "".join(
        f'<link name="f{k}"/><joint name="x{k}" type="fixed"><parent link="l1"/>'
        f'<child link="f{k}"/></joint>' for k in range(100)) + "</robot>"),
    "two-roots": _chain(2).replace("</robot>", '<link name="other"/></robot>'),
    "spheres": _chain(2, "floating"),
    "planar": _chain(2, "planar"),
    "unknown-type": _chain(2, "wobbly"),
    "prismatic": _chain(2, "prismatic"),
    "continuous": _chain(2, "continuous"),
    "fixed": _chain(2, "fixed"),
}  # fmt: skip

_REPLACED: dict[str, tuple[tuple[str, str], ...]] = {
    "cycle": (('<child link="tool0"/>', '<child link="base_link"/>'),),
    "own-parent": (('<parent link="link_2"/>', '<parent link="tool0"/>'),),
    "missing-parent": (('<parent link="link_1"/>', '<parent link="none"/>'),),
    "missing-child": (('<child link="link_2"/>', '<child link="none"/>'),),
    "no-parent": (('<parent link="link_1"/>', ""),),
    "two-parents": (('<child link="tool0"/>', '<child link="link_1"/>'),),
    "same-link-twice": (('<link name="tool0"/>', '<link name="link_2"/>'),),
    "same-joint-twice": (('<joint name="flange"', '<joint name="joint_2"'),),
    "joint-named-as-link": (('"link_1"', '"joint_1"'), ('"link_2"', '"joint_2"')),
    "empty-link-name": (('<link name="tool0"/>', '<link name=""/>'),),
    "no-inertial": (("inertial>", "visual_>"),),
    "no-mass": ((_MASS, ""),),
    "negative-mass": ((_MASS, '<mass value="-4.2"/>'),),
    "zero-mass": ((_MASS, '<mass value="0"/>'),),
    "nan-mass": ((_MASS, '<mass value="nan"/>'),),
    "infinite-mass": ((_MASS, '<mass value="inf"/>'),),
    "huge-mass": ((_MASS, '<mass value="1e300"/>'),),
    "tiny-mass": ((_MASS, '<mass value="1e-300"/>'),),
    "text-mass": ((_MASS, '<mass value="heavy"/>'),),
    "negative-inertia": ((_INERTIA, 'ixx="-1"'),),
    "indefinite-inertia": (('ixz="0.0009"', 'ixz="5"'),),
    "broken-inequality": ((_INERTIA, 'ixx="50"'),),
    "nan-inertia": ((_INERTIA, 'ixx="nan"'),),
    "huge-inertia": ((_INERTIA, 'ixx="1e305"'),),
    "zero-inertia": (('"0.0042525"', '"0"'), ('"0.0581263"', '"0"'), ('"0.0009"', '"0"')),
    "zero-axis": (('<axis xyz="0 1 0"/>', '<axis xyz="0 0 0"/>'),),
    "nan-axis": (('<axis xyz="0 1 0"/>', '<axis xyz="nan 1 0"/>'),),
    "short-axis": (('<axis xyz="0 1 0"/>', '<axis xyz="0 1"/>'),),
    "long-axis": (('<axis xyz="0 1 0"/>', '<axis xyz="0 1e200 0"/>'),),
    "tiny-axis": (('<axis xyz="0 1 0"/>', '<axis xyz="0 1e-200 0"/>'),),
    "vertical-axes": (('<axis xyz="0 1 0"/>', '<axis xyz="0 0 1"/>'),),
    "nan-origin": (('xyz="0.42 0 0"', 'xyz="nan 0 0"'),),
    "huge-origin": (('xyz="0.42 0 0"', 'xyz="1e200 0 0"'),),
    "long-origin": (('xyz="0.42 0 0"', 'xyz="0 0 0 0 0 0"'),),
    "huge-rpy": (('xyz="0.42 0 0" rpy="0 0 0"', 'xyz="0.42 0 0" rpy="1e300 0 0"'),),
    "nan-rpy": (('xyz="0.42 0 0" rpy="0 0 0"', 'xyz="0.42 0 0" rpy="nan 0 0"'),),
    "limits-swapped": ((_LIMIT, 'lower="2.8" upper="-2.8" velocity="4.0" effort="90"'),),
    "limits-equal": ((_LIMIT, 'lower="1" upper="1" velocity="4.0" effort="90"'),),
    "limits-nan": ((_LIMIT, 'lower="nan" upper="nan" velocity="nan" effort="nan"'),),
    "limits-infinite": ((_LIMIT, 'lower="-inf" upper="inf" velocity="inf" effort="inf"'),),
    "limits-huge": ((_LIMIT, 'lower="-1e300" upper="1e300" velocity="1e300" effort="1e300"'),),
    "limits-tiny": ((_LIMIT, 'lower="-1e-9" upper="1e-9" velocity="1e-9" effort="1e-9"'),),
    "limits-zero": ((_LIMIT, 'lower="0" upper="0" velocity="0" effort="0"'),),
    "limits-negative": ((_LIMIT, 'lower="-1" upper="1" velocity="-4" effort="-90"'),),
    "no-limits": ((f"<limit {_LIMIT}/>", ""),),
    "negative-damping": (('damping="1.1" friction="1.8"', 'damping="-1.1" friction="-1.8"'),),
    "nan-damping": (('damping="1.1"', 'damping="nan"'),),
    "huge-friction": (('friction="1.8"', 'friction="1e300"'),),
    "mimic": ((f"<limit {_LIMIT}/>", f'<limit {_LIMIT}/><mimic joint="joint_2"/>'),),
    "mimic-itself": ((f"<limit {_LIMIT}/>", f'<limit {_LIMIT}/><mimic joint="joint_1"/>'),),
    "mimic-none": ((f"<limit {_LIMIT}/>", f'<limit {_LIMIT}/><mimic joint="none"/>'),),
    "joint-one-fixed": (('name="joint_1" type="revolute"', 'name="joint_1" type="fixed"'),),
    "missing-mesh": (("<inertial>", '<visual><geometry><mesh filename="package://x/y.stl"/>'
                      "</geometry></visual><inertial>"),),
    "markup-name": (('"link_2"', '"[/]link_2[red]"'),),
    "com-far": (('xyz="0.19 0.01 0.004"', 'xyz="1e5 0 0"'),),
}  # fmt: skip
_IMPOSSIBLE = {
    "negative-mass", "nan-mass", "infinite-mass", "negative-inertia", "indefinite-inertia",
    "broken-inequality", "nan-inertia", "zero-axis", "nan-axis", "nan-origin", "nan-rpy", "cycle",
    "missing-parent", "missing-child", "own-parent", "two-parents", "same-link-twice",
    "same-joint-twice", "limits-swapped", "limits-nan", "empty", "not-xml", "binary", "html",
    "half", "no-links", "one-link", "bomb", "text-mass", "unknown-type", "fixed",
}  # fmt: skip


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


def _lines_shuffled(random: np.random.Generator) -> str:
    lines = _WHOLE.splitlines()[3:-1]
    return '<robot name="r">' + "\n".join(random.permutation(lines)) + "</robot>"


_DAMAGED = (
    ("flipped", _flipped, 5),
    ("lines-lost", _lines_lost, 5),
    ("lines-shuffled", _lines_shuffled, 3),
)
