"""Texts that are read: configurations, robots, diagnoses, effects and trajectories."""

import json
import re
from collections.abc import Callable, Iterator
from functools import partial
from itertools import pairwise
from pathlib import Path

import numpy as np

from idim_iv_ros.configuration import Configuration
from idim_iv_ros.effects.registry import BY_NAME, EFFECTS
from tests.fuzz import tables
from tests.fuzz.case import (
    CONFIG,
    Case,
    Good,
    Yaml,
    command,
    configuration,
    excitation,
    first_configuration,
    flipped,
    simulation,
    spelt,
    write_configuration,
    write_text,
)
from tests.inputs import gap_content
from tests.test_configuration import keys

_NUMBER = re.compile(r"(?<![\w.])-?\d+\.?\d*(?:e[-+]?\d+)?(?![\w.])")
_WORD = re.compile(r"(?<=\")[a-z]\w*(?=\")")
_ODD_NUMBERS = ("nan", "NaN", ".inf", "Infinity", "-1", "0", "1e300", "-1e300", "1e-300", "1e9999",
                "1" + "0" * 400, "null", '"1"', "[]", "{}", "x", "", "１", "0x1F")  # fmt: skip
_ODD_WORDS = ("", "joint_1", "[bold]x[/]", "a\nb", "x" * 3000, "none", "revolute", "1")
_KEY_VALUES = (
    "null", ".nan", ".inf", "-1", "[-1.0, -1.0]", "[0, 0]", "1.0e-300", "1.0e+300", "[]", "text",
    "1" + "0" * 400, "[1.7976931348623157e+308, 1.7976931348623157e+308]", "[1.0, 2.0, 3.0]",
    "[[1.0e+300, 0], [1.0e-300, 1.0e+300]]", r'"\ud800"', '"a\\nb\\e[2J"', "true", "!!set {a, b}",
    "{YY1: 1.0e+300, MX1: -1.0e+300}", "{YY1: -5.0, YY2: -5.0}",
    "[" + ", ".join(["1.0"] * 2000) + "]",
)  # fmt: skip
_COMMANDS = ("check", "simulate", "init", "identify", "excite")
_ARM = (CONFIG / "arm2.urdf").read_text(encoding="utf-8")


def cases(seed: int) -> Iterator[Case]:
    """Of each kind of file what is no such file at all, and the good one with damage."""
    for kind, (good, usages) in _KINDS.items():
        for number, (name, text) in enumerate({**_NO_FILE, **_SPECIAL.get(kind, {})}.items()):
            build = partial(_with, usages[number % len(usages)], lambda _, text=text: text)
            yield Case(f"{kind}-{name}", build, name in _NO_FILE)
        for name, damage in _DAMAGES.items():
            for number in range(6):
                build = partial(_with, usages[number % len(usages)], partial(damage, good))
                yield Case(f"{kind}-{name}-{number}", build)
    for effect in EFFECTS:
        build = partial(_with, _simulated, partial(_odd_number, _document_of(effect)))
        yield Case(f"effect-{effect}", build)
    for key in [("robot",), ("simulator",), *keys(Configuration)]:
        for number in range(2):
            yield Case(f"key-{'.'.join(key)}-{number}", partial(_with_key, key))


Text = Callable[[np.random.Generator], str]
Usage = Callable[[Path, Good, str], list[str]]


def _with(usage: Usage, text: Text, folder: Path, good: Good, random: object) -> list[str]:
    return usage(folder, good, text(random))


def _with_key(key: tuple[str, ...], folder: Path, good: Good, random: np.random.Generator) -> list:
    """Another value of one key; those of a simulation are used in one."""
    document = configuration()
    place = document
    for part in key[:-1]:
        place = place.setdefault(part, {})
    place[key[-1]] = Yaml(str(random.choice(_KEY_VALUES)))
    if key[0] in ("simulator", "simulated_robot", "controller"):
        return simulation(folder, write_configuration(folder, document))
    what = "identify" if key[0] == "identification" or random.uniform() < 0.3 else "check"
    return command(what, folder, [good.bag], write_configuration(folder, document))


def _replaced(
    pattern: re.Pattern[str], values: tuple[str, ...], good: str, random: np.random.Generator
) -> str:
    found = list(pattern.finditer(good))
    place = found[int(random.integers(len(found)))] if found else re.match("", good)
    return good[: place.start()] + str(random.choice(values)) + good[place.end() :]


def _flipped(good: str, random: np.random.Generator) -> str:
    return flipped(good.encode(), random, 6).decode("utf-8", "surrogateescape")


def _torn(good: str, random: np.random.Generator) -> str:
    return good[: int(random.integers(len(good)))]


_odd_number = partial(_replaced, _NUMBER, _ODD_NUMBERS)
_odd_word = partial(_replaced, _WORD, _ODD_WORDS)
_DAMAGES = {"number": _odd_number, "word": _odd_word, "flipped": _flipped, "torn": _torn}


def _configured(what: str, folder: Path, good: Good, text: str) -> list[str]:
    return command(what, folder, [good.bag], write_text(folder / "robot.yaml", text))


def _described(what: str, folder: Path, good: Good, text: str) -> list[str]:
    """The URDF of a robot."""
    urdf = write_text(folder / "robot.urdf", text)
    config = write_configuration(folder, urdf="robot.urdf")
    if what == "init":
        return first_configuration(folder, good.bag, urdf)
    if what in ("simulate", "excite"):
        return {"simulate": simulation, "excite": excitation}[what](folder, config)
    return command(what, folder, [good.bag], config)


def _simulated(folder: Path, good: Good, text: str) -> list[str]:
    return [*simulation(folder), "--effects", str(write_text(folder / "gap.json", text))]


def _exported(folder: Path, good: Good, text: str) -> list[str]:
    return command("export", folder, [write_text(folder / "gap.json", text)])


def _replayed(option: str, file: str, folder: Path, good: Good, text: str) -> list[str]:
    path = write_text(folder / file, text)
    return [*command("replay", folder, [good.bag]), option, str(path)]


def _followed(folder: Path, good: Good, text: str) -> list[str]:
    path = write_text(folder / "t.csv", text)
    return [*simulation(folder)[:-2], "--trajectory", str(path)]


def _imported(folder: Path, good: Good, text: str) -> list[str]:
    return tables.table(folder, write_text(folder / "t.csv", text).name)


def _document_of(effect: str) -> str:
    """A diagnosis with this effect, all of whose parameters are a half."""
    names = [spec.name.replace("_k", "_1") for spec in BY_NAME[effect].specs]
    parameters = dict.fromkeys(names, 0.5)
    cause = {"effect": effect, "joint": "joint_1", "other_joint": None, "parameters": parameters}
    return json.dumps(gap_content(cause, parameters={"YY1": 1.0, "Fc1": 0.5}))


def bomb(letters: str) -> str:
    """Entities within entities, each ten times."""
    entities = "".join(f'<!ENTITY {b} "{f"&{a};" * 10}">' for a, b in pairwise(letters))
    head = f'<?xml version="1.0"?><!DOCTYPE r [<!ENTITY {letters[0]} "aaaaaaaaaa">{entities}]>'
    return f'{head}<robot name="&{letters[-1]};"/>'


def _chain(links: int) -> str:
    parts = ['<robot name="r"><link name="l0"/>']
    for k in range(1, links + 1):
        parts.append(
            f'<link name="l{k}"/><joint name="joint_{k}" type="prismatic"><parent link="l{k - 1}"/>'
            f'<child link="l{k}"/><axis xyz="0 1 0"/>'
            '<limit lower="-1" upper="1" velocity="1" effort="50"/></joint>'
        )
    return "".join(parts) + "</robot>"


_STEPS = np.arange(201) / 200.0
_WAVE = 0.1 * np.sin(6.0 * _STEPS)


def _motion(time: np.ndarray = _STEPS, first: np.ndarray = _WAVE, second: str = "joint_2") -> str:
    rows = "".join(f"{t},{a},{b}\n" for t, a, b in zip(time, first, _WAVE, strict=True))
    return f"time,joint_1.position,{second}.position\n{rows}"


_MJCF = """<mujoco><worldbody><body><joint name="joint_1" axis="0 1 0" armature="0.2" damping="1"/>
<inertial mass="4" pos="0.1 0 0" diaginertia="0.1 0.1 0.1"/><body pos="0.4 0 0">
<joint name="joint_2" axis="0 1 0"/><inertial mass="2" pos="0.1 0 0" diaginertia="0.1 0.1 0.1"/>
</body></body></worldbody></mujoco>"""
_CAUSE = json.loads(_document_of("stribeck"))["causes"]
_NO_FILE = {"empty": "", "not-text": "\udcff\udcfe", "html": "<html><body>404</body></html>"}
# The good text of each kind of file, and the commands that read it.
_KINDS: dict[str, tuple[str, tuple[Usage, ...]]] = {
    "yaml": (spelt(configuration()), (partial(_configured, "check"),)),
    "urdf": (
        _ARM,
        tuple(
            partial(_described, what)
            for what in ("check", "simulate", "init", "identify", "excite")
        ),
    ),
    "mjcf": (_MJCF, (partial(_replayed, "--model", "arm.xml"),)),
    "gap": (
        _document_of("load_dependent_friction"),
        (_simulated, _exported, partial(_replayed, "--effects", "effects.json")),
    ),
    "trajectory": (_motion(), (_followed,)),
    "csv": (tables.GOOD_CSV, (_imported,)),
}
_SPECIAL: dict[str, dict[str, str]] = {
    "yaml": {
        "brackets": "[" * 5000,
        "nested-blocks": "".join(" " * k + "a:\n" for k in range(1500)),
        "aliases": "a: &a [1,1,1,1,1,1,1,1,1,1]\n"
        + "".join(f"{b}: &{b} [{','.join(['*' + a] * 10)}]\n" for a, b in pairwise("abcdefghi"))
        + "robot: *i\n",
        "merge-itself": "robot: &r {<<: *r}",
        "null-byte": "robot: \x00",
        "object": "!!python/object/apply:os.system ['true']",
        "million-keys": "{" + ",".join(f"k{n}: {n}" for n in range(20_000)) + "}",
    },
    "urdf": {
        "bomb": bomb("abcdefghij"),
        "external-entity": (
            '<?xml version="1.0"?><!DOCTYPE r [<!ENTITY e SYSTEM "file:///etc/passwd">]>'
            + _ARM.partition("?>")[2].replace('name="arm2"', 'name="&e;"')
        ),
        "deep": "<robot>" + "<a>" * 20_000 + "</a>" * 20_000 + "</robot>",
        "long-name": _ARM.replace('name="arm2"', f'name="{"r" * 100_000}"'),
        "utf-16": _ARM.encode("utf-16").decode("utf-8", "surrogateescape"),
        "thousand-links": _chain(1000),
        "cycle": _ARM.replace('<child link="tool0"/>', '<child link="base_link"/>'),
        "no-inertial": _ARM.replace("inertial>", "visual_>"),
        "huge-mass": _ARM.replace('mass value="4.2"', 'mass value="1e300"'),
        "vertical-axes": _ARM.replace('axis xyz="0 1 0"', 'axis xyz="0 0 1"'),
        "markup-name": _ARM.replace('"link_2"', '"[/]link_2[red]"'),
    },
    "mjcf": {"itself": '<mujoco><include file="arm.xml"/></mujoco>'},
    "gap": {
        "nested": "[" * 100_000,
        "huge-integer": '{"format": ' + "1" * 10_000 + "}",
        "huge-integer-parameter": spelt(gap_content(parameters={"YY1": Yaml("1" + "0" * 400)})),
        "negative-inertia": spelt(gap_content(parameters={"YY1": -9, "YY2": -9})),
        "format-as-list": '{"format": ["idim_iv_ros/gap/1"]}',
        "many-causes": json.dumps(gap_content() | {"causes": _CAUSE * 2000}),
    },
    "trajectory": {
        "three-samples": "\n".join(_motion().splitlines()[:4]),
        "same-joint": _motion(second="joint_1"),
        "huge-steps": _motion(_STEPS * 1e300),
        "hour-steps": _motion(_STEPS * 7.2e5),
        "huge-positions": _motion(first=np.full(201, 1e300)),
        "zeros": "\0" * 4000,
        "long-cell": "time,joint_1.position\n" + "1" * 200_000 + ",1\n",
    },
}
