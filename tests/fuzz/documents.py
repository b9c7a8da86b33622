"""Diagnoses for `simulate --effects`, and trajectories."""

import json
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from idim_iv_ros.effects.registry import BY_NAME, EFFECTS
from tests.fuzz.case import Case, Good, Yaml, flipped, simulation, spelt, write_text
from tests.gap_files import gap_content

_NUMBERS = ("0", "-1", "1e300", "-1e300", "1e-300", "NaN", "Infinity", "1" + "0" * 400, "null",
            '"1"', "true", "[]", "{}", "0.5", "1e10")  # fmt: skip


def cases(seed: int) -> Iterator[Case]:
    """Whole documents, then each effect of the catalogue with numbers it cannot have."""
    for name, text in _DOCUMENTS.items():
        yield Case(f"gap-{name}", partial(_document, text))
    for effect in EFFECTS:
        for number in range(2):
            yield Case(f"effect-{effect}-{number}", partial(_effect, effect))
    for name, text in _TRAJECTORIES.items():
        yield Case(f"trajectory-{name}", partial(_trajectory, text))
    for number in range(4):
        yield Case(f"trajectory-flipped-{number}", _flipped_trajectory)


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
    "not-json": "{",
    "list": "[]",
    "null": "null",
    "number": "1e999",
    "not-text": "\udcff\udcfe",
    "nested": "[" * 100_000,
    "nested-objects": '{"a":' * 100_000,
    "huge-integer": '{"format": ' + "1" * 10_000 + "}",
    "other-format": '{"format": "idim_iv_ros/gap/2", "causes": []}',
    "result-json": '{"format": "idim_iv_ros/identification/1", "parameters": []}',
    "format-as-list": '{"format": ["idim_iv_ros/gap/1"]}',
    "no-causes": '{"format": "idim_iv_ros/gap/1"}',
    "causes-mapping": _gap(causes={}),
    "causes-numbers": _gap(causes=[1, 2]),
    "no-parameters": '{"format": "idim_iv_ros/gap/1", "causes": []}',
    "parameters-list": _gap(extended_parameters=[1]),
    "unknown-parameter": _gap({"[bold]X": 1}),
    "huge-parameter": _gap({"YY1": 1e308}),
    "huge-integer-parameter": _gap({"YY1": Yaml("1" + "0" * 400)}),
    "nan-parameter": _gap({"YY1": Yaml("NaN")}),
    "overflowing-parameter": _gap({"YY1": Yaml("1e999")}),
    "negative-inertia": _gap({"YY1": -9, "YY2": -9}),
    "zero-inertia": _gap(dict.fromkeys(("YY2", "Ia2", "MX2"), 0)),
    "negative-friction": _gap({"Fc1": -50, "Fv1": -500}),
    "huge-friction": _gap({"Fc1": 1e200, "Fv1": 1e200}),
    "text-value": _gap({"YY1": "1"}),
    "no-value": _gap(extended_parameters={"YY1": {}}),
    "effect-unknown": _one(effect="[red]magic"),
    "effect-number": _one(effect=3),
    "effect-missing": _one(effect=None),
    "joint-unknown": _one(joint="none"),
    "joint-missing": _one(joint=None),
    "joint-list": _one(joint=["joint_1"]),
    "parameters-of-another": _one(parameters={"stiffness": 1}),
    "many-causes": _gap(causes=json.loads(_one())["causes"] * 2000),
}  # fmt: skip


def _motion(
    time: Any = None, first: Any = None, second: Any = None, names: Any = ("joint_1", "joint_2")
) -> str:
    stamps = np.arange(201) / 200.0 if time is None else time
    wave = 0.1 * np.sin(6.0 * np.arange(len(stamps)) / 200.0)
    columns = [stamps, wave if first is None else first, wave if second is None else second]
    headings = ["time", *(f"{name}.position" for name in names)]
    rows = zip(*columns[: len(headings)], strict=True)
    return "\n".join([",".join(headings), *(",".join(map(str, row)) for row in rows)]) + "\n"


_STEPS = np.arange(201) / 200.0
_TRAJECTORIES = {
    "empty": "",
    "header-alone": "time,joint_1.position,joint_2.position\n",
    "two-samples": "\n".join(_motion().splitlines()[:3]),
    "three-samples": "\n".join(_motion().splitlines()[:4]),
    "six-samples": "\n".join(_motion().splitlines()[:7]),
    "no-time": _motion().replace("time", "t", 1),
    "other-joints": _motion(names=("a", "b")),
    "one-joint": _motion(names=("joint_1",)),
    "same-joint": _motion(names=("joint_1", "joint_1")),
    "nan": _motion().replace("0.0,0.0", "0.0,nan", 1),
    "text": _motion().replace("0.0,0.0", "0.0,x", 1),
    "huge-integer": _motion().replace("0.0,0.0", "0.0," + "1" * 6000, 1),
    "backward": _motion(time=1.0 - _STEPS),
    "constant-time": _motion(time=0.0 * _STEPS),
    "tiny-steps": _motion(time=_STEPS * 1e-300),
    "nanosecond-steps": _motion(time=_STEPS * 2e-7),
    "huge-steps": _motion(time=_STEPS * 1e300),
    "hour-steps": _motion(time=_STEPS * 7.2e5),
    "day-steps": _motion(time=_STEPS * 1.7e7),
    "huge-positions": _motion(first=np.full(201, 1e300)),
    "jumping": _motion(first=(-1.0) ** np.arange(201) * 1e3),
    "far": _motion(first=np.full(201, 1e6)),
    "outside-limits": _motion(first=np.full(201, 50.0)),
    "ragged": _motion().replace("\n", ",1\n", 3),
    "zeros": "\0" * 4000,
    "one-cell": _motion().replace("0.0,", '"0.0,', 1),
    "long-cell": "time,joint_1.position\n" + "1" * 200_000 + ",1\n",
    "not-text": "\udcff\udcfe,\n",
    "other-file": '{"format": "idim_iv_ros/gap/1"}',
}


def _flipped_trajectory(folder: Path, good: Good, random: np.random.Generator) -> list[str]:
    text = flipped(_motion().encode(), random, 5).decode("utf-8", "surrogateescape")
    return _trajectory(text, folder, good, None)


def _trajectory(text: str, folder: Path, good: Good, _: object) -> list[str]:
    trajectory = write_text(folder / "t.csv", text)
    return [*simulation(folder)[:-2], "--trajectory", str(trajectory)]
