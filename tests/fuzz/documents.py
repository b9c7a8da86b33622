"""Diagnoses for `simulate`, `replay` and `export`, MJCF files, and trajectories."""

import copy
import json
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from idim_iv_ros.effects.registry import BY_NAME, EFFECTS
from tests.fuzz.case import (
    Case,
    Good,
    Yaml,
    command,
    flipped,
    simulation,
    spelt,
    write_text,
)
from tests.gap_files import gap_content

_NUMBERS = ("0", "-1", "1e300", "-1e300", "1e-300", "NaN", "Infinity", "1" + "0" * 400, "null",
            '"1"', "true", "[]", "{}", "0.5", "1e10")  # fmt: skip


def cases(seed: int) -> Iterator[Case]:
    """Whole documents; each effect with a number it cannot have; files with one thing changed."""
    for name, text in _DOCUMENTS.items():
        yield Case(f"gap-{name}", partial(_document, text))
    for effect in EFFECTS:
        yield Case(f"effect-{effect}", partial(_effect, effect))
    for name, text in _TRAJECTORIES.items():
        yield Case(f"trajectory-{name}", partial(_trajectory, text))
    yield Case("trajectory-flipped", _flipped_trajectory)
    for number in range(8):
        build = partial(_replay, "--effects", "effects.json", _changed(_EFFECTS))
        yield Case(f"replay-effects-{number}", build)
        yield Case(f"export-gap-{number}", partial(_export, _changed(gap_content())))
    for name, text in _MJCF.items():
        for what, option in (("mjcf", "--model"), ("as-effects", "--effects")):
            build = partial(_replay, option, "arm.xml", lambda _, text=text: text)
            yield Case(f"replay-{what}-{name}", build)


def _document(text: str, folder: Path, good: Good, _: object) -> list[str]:
    return [*simulation(folder), "--effects", str(write_text(folder / "gap.json", text))]


def _effect(effect: str, folder: Path, good: Good, random: np.random.Generator) -> list[str]:
    names = [spec.name.replace("_k", "_1") for spec in BY_NAME[effect].specs] or ["a"]
    wrong = random.choice(names)
    cause = {
        "effect": effect,
        "parameters": {
            name: Yaml(str(random.choice(_NUMBERS)) if name == wrong else "0.5") for name in names
        },
        "joint": str(random.choice(["joint_1", "joint_2"])),
        "other_joint": random.choice([None, "joint_1", "joint_2"]),
    }
    return _document(spelt(gap_content(cause)), folder, good, None)


def _gap(parameters: Any = None, **changes: Any) -> str:
    return spelt(gap_content(parameters=parameters) | changes)


def _one(**values: Any) -> str:
    cause = {"effect": "stribeck", "joint": "joint_1", "parameters": {}}
    return spelt(gap_content({**cause, **values}))


_DOCUMENTS = {
    "empty": "",
    "list": "[]",
    "number": "1e999",
    "not-text": "\udcff\udcfe",
    "nested": "[" * 100_000,
    "nested-objects": '{"a":' * 100_000,
    "huge-integer": '{"format": ' + "1" * 10_000 + "}",
    "result-json": '{"format": "idim_iv_ros/identification/1", "parameters": []}',
    "format-as-list": '{"format": ["idim_iv_ros/gap/1"]}',
    "no-causes": '{"format": "idim_iv_ros/gap/1"}',
    "causes-numbers": _gap(causes=[1, 2]),
    "unknown-parameter": _gap({"[bold]X": 1}),
    "huge-parameter": _gap({"YY1": 1e308}),
    "huge-integer-parameter": _gap({"YY1": Yaml("1" + "0" * 400)}),
    "overflowing-parameter": _gap({"YY1": Yaml("1e999")}),
    "negative-inertia": _gap({"YY1": -9, "YY2": -9}),
    "negative-friction": _gap({"Fc1": -50, "Fv1": -500}),
    "text-value": _gap({"YY1": "1"}),
    "effect-unknown": _one(effect="[red]magic"),
    "joint-unknown": _one(joint="none"),
    "joint-list": _one(joint=["joint_1"]),
    "parameters-of-another": _one(parameters={"stiffness": 1}),
    "many-causes": _gap(causes=json.loads(_one())["causes"] * 2000),
}

_WRONG = (None, 0, -1, 1e300, -1e300, 1e-300, "x", "", [], {}, True, 0.5)
_EFFECTS: dict[str, Any] = {
    "format": "idim_iv_ros/effects/1",
    "base_parameters": {"Fv1": 1.4},
    "effects": [
        {"effect": effect, "joint": joint, "other_joint": other, "parameters": numbers}
        for effect, joint, other, numbers in (
            ("stribeck", "joint_1", None, {"excess": 0.5, "speed": 0.1}),
            ("elasticity", "joint_2", None, {"stiffness": 500.0, "damping": 0.8}),
            ("joint_coupling", "joint_1", "joint_2", {"coulomb": 0.2, "viscous": 0.1}),
            ("time_delay", None, None, {"delay": 0.003}),
        )
    ],
}
_MJCF = {
    "no-xml": "mujoco",
    "another-root": "<robot/>",
    "not-closed": "<mujoco><worldbody>",
    "itself": '<mujoco><include file="arm.xml"/></mujoco>',
    "no-mass": '<mujoco><worldbody><body><joint name="joint_1"/></body></worldbody></mujoco>',
}
Text = Callable[[np.random.Generator], str]


def _changed(whole: dict[str, Any]) -> Text:
    """The document with something else in one of its places."""

    def text(random: np.random.Generator) -> str:
        content = copy.deepcopy(whole)
        places = list(_places(content))
        *parents, last = places[int(random.integers(len(places)))]
        inside = content
        for key in parents:
            inside = inside[key]
        inside[last] = _WRONG[int(random.integers(len(_WRONG)))]
        return json.dumps(content)

    return text


def _places(content: Any, parents: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    keys = content.keys() if isinstance(content, dict) else range(len(content))
    for key in keys:
        yield (*parents, key)
        if isinstance(content[key], dict | list):
            yield from _places(content[key], (*parents, key))


def _replay(
    option: str, file: str, text: Text, folder: Path, good: Good, random: np.random.Generator
) -> list[str]:
    path = write_text(folder / file, text(random))
    return [*command("replay", folder, [good.bag]), option, str(path)]


def _export(text: Text, folder: Path, good: Good, random: np.random.Generator) -> list[str]:
    return command("export", folder, [write_text(folder / "gap.json", text(random))])


_STEPS = np.arange(201) / 200.0


def _motion(time: Any = _STEPS, first: Any = None, names: Any = ("joint_1", "joint_2")) -> str:
    wave = 0.1 * np.sin(6.0 * _STEPS)
    columns = [time, wave if first is None else first, wave]
    headings = ["time", *(f"{name}.position" for name in names)]
    rows = zip(*columns[: len(headings)], strict=True)
    return "\n".join([",".join(headings), *(",".join(map(str, row)) for row in rows)]) + "\n"


_TRAJECTORIES = {
    "empty": "",
    "header-alone": "time,joint_1.position,joint_2.position\n",
    "three-samples": "\n".join(_motion().splitlines()[:4]),
    "no-time": _motion().replace("time", "t", 1),
    "other-joints": _motion(names=("a", "b")),
    "one-joint": _motion(names=("joint_1",)),
    "same-joint": _motion(names=("joint_1", "joint_1")),
    "nan": _motion().replace("0.0,0.0", "0.0,nan", 1),
    "huge-integer": _motion().replace("0.0,0.0", "0.0," + "1" * 6000, 1),
    "backward": _motion(time=1.0 - _STEPS),
    "tiny-steps": _motion(time=_STEPS * 1e-300),
    "huge-steps": _motion(time=_STEPS * 1e300),
    "hour-steps": _motion(time=_STEPS * 7.2e5),
    "huge-positions": _motion(first=np.full(201, 1e300)),
    "jumping": _motion(first=(-1.0) ** np.arange(201) * 1e3),
    "ragged": _motion().replace("\n", ",1\n", 3),
    "zeros": "\0" * 4000,
    "one-cell": _motion().replace("0.0,", '"0.0,', 1),
    "long-cell": "time,joint_1.position\n" + "1" * 200_000 + ",1\n",
    "not-text": "\udcff\udcfe,\n",
}


def _flipped_trajectory(folder: Path, good: Good, random: np.random.Generator) -> list[str]:
    text = flipped(_motion().encode(), random, 5).decode("utf-8", "surrogateescape")
    return _trajectory(text, folder, good, None)


def _trajectory(text: str, folder: Path, good: Good, _: object) -> list[str]:
    trajectory = write_text(folder / "t.csv", text)
    return [*simulation(folder)[:-2], "--trajectory", str(trajectory)]
