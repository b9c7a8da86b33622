"""Effects and results for `replay` and `export`: one thing in a good file is wrong."""

import copy
import json
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from tests.fuzz.case import Case, Good, write_configuration, write_text
from tests.gap_files import gap_content

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
            ("spring", "joint_1", None, {"linear": 2.0}),
        )
    ],
}
_MJCF = {
    "empty": "",
    "not-text": "\udcff\udcfe",
    "no-xml": "mujoco",
    "another-root": "<robot/>",
    "not-closed": "<mujoco><worldbody>",
    "no-joints": "<mujoco/>",
    "itself": '<mujoco><include file="arm.xml"/></mujoco>',
    "no-mass": '<mujoco><worldbody><body><joint name="joint_1"/></body></worldbody></mujoco>',
}


def cases(seed: int) -> Iterator[Case]:
    """Replays with changed effects and with other files; exports of changed results."""
    for number in range(12):
        yield Case(
            f"replay-effects-{number}",
            partial(_replay, "--effects", "effects.json", _changed(_EFFECTS)),
        )
    for name, text in _MJCF.items():
        for what, option in (("mjcf", "--model"), ("as-effects", "--effects")):
            build = partial(_replay, option, "arm.xml", lambda _, text=text: text)
            yield Case(f"replay-{what}-{name}", build)
    for number in range(8):
        yield Case(f"export-gap-{number}", partial(_export, _changed(gap_content())))


Text = Callable[[np.random.Generator], str]


def _changed(whole: dict[str, Any]) -> Text:
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
    config, out = write_configuration(folder), folder / "out"
    arguments = ["replay", str(good.bag), "--config", str(config), "--out", str(out)]
    return [*arguments, option, str(path)]


def _export(text: Text, folder: Path, good: Good, random: np.random.Generator) -> list[str]:
    path = write_text(folder / "gap.json", text(random))
    config, out = write_configuration(folder), folder / "out"
    return ["export", str(path), "--config", str(config), "--out", str(out)]
