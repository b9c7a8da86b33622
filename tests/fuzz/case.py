"""What one bad input is, and the good input that all of them are made from."""

import json
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from ruamel.yaml import YAML

CONFIG = Path(__file__).resolve().parents[2] / "config"
JOINTS = ("joint_1", "joint_2")


@dataclass(frozen=True)
class Good:
    """A small recording that every command accepts, and its robot.

    Attributes
    ----------
    bag : Path
        Four seconds of two joints at 200 Hz, MCAP.
    time : (n,) s
    position, effort, reference : (n, 2)
        What the bag holds: rad, N m, rad.
    """

    bag: Path
    time: np.ndarray
    position: np.ndarray
    effort: np.ndarray
    reference: np.ndarray


Build = Callable[[Path, Good, np.random.Generator], list[str]]


@dataclass(frozen=True)
class Case:
    """One bad input.

    Attributes
    ----------
    name : str
        ``family-what``; the same name and seed give the same bytes.
    build : callable
        Writes the input into an empty folder and returns the arguments of ``idim-iv``; its random
        numbers are those of the case.
    refused : bool
        Whether nothing but a refusal (status 1 or 2) or a warning is right; else an answer in
        silence is right too.
    """

    name: str
    build: Build
    refused: bool = False


class Yaml(str):
    """A value as it is spelt in YAML, which JSON cannot write."""


def random_of(seed: int, name: str) -> np.random.Generator:
    """Random numbers of one case, whatever other cases there are."""
    return np.random.default_rng([seed, zlib.crc32(name.encode())])


def flipped(
    content: bytes, random: np.random.Generator, count: int, end: int | None = None
) -> bytes:
    """Change so many bits before `end`."""
    changed = bytearray(content)
    for place in random.integers(0, len(changed) if end is None else end, count):
        changed[int(place)] ^= 1 << int(random.integers(8))
    return bytes(changed)


def configuration() -> dict[str, Any]:
    """Return the configuration of the two-joint arm, recorded at 200 Hz."""
    document = YAML(typ="safe", pure=True).load((CONFIG / "arm2.yaml").read_text())
    document["robot"]["urdf"] = str(CONFIG / "arm2.urdf")
    document["simulated_robot"]["rate"] = 200.0
    return document


def write_configuration(folder: Path, document: dict[str, Any] | None = None, **robot: Any) -> Path:
    """Write a configuration; `robot` replaces keys of its first section."""
    document = configuration() if document is None else document
    if robot:
        document["robot"].update(robot)
    path = folder / "robot.yaml"
    path.write_text(spelt(document), encoding="utf-8")
    return path


def spelt(value: Any) -> str:
    """YAML in flow style."""
    if isinstance(value, Yaml):
        return str(value)
    if isinstance(value, dict):
        return "{" + ", ".join(f"{json.dumps(k)}: {spelt(v)}" for k, v in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(spelt, value)) + "]"
    return json.dumps(value)


def write_text(path: Path, text: str) -> Path:
    """Write a text that may hold bytes of no text (surrogates)."""
    path.write_bytes(text.encode("utf-8", "surrogateescape"))
    return path


def excitation(folder: Path, config: Path, out: Path | None = None, **options: str) -> list[str]:
    """Arguments of the shortest design of a motion; `options` replace its own."""
    short = {"rate": "100", **options}
    if options.get("for") != "diagnosis":
        short = {"period": "2", "repeats": "1", "time-limit": "0.2", **short}
    arguments = ["excite", "--config", str(config), "--out", str(out or folder / "m")]
    return arguments + [part for name, value in short.items() for part in (f"--{name}", value)]


def command(name: str, folder: Path, bags: list[Path], config: Path | None = None) -> list[str]:
    """Arguments of a command that reads files; its results would be in ``out``, if it has any."""
    if name == "init":
        return first_configuration(folder, bags[0], CONFIG / "arm2.urdf")
    config = config or write_configuration(folder)
    out = [] if name == "check" else ["--out", str(folder / "out")]
    return [name, *map(str, bags), "--config", str(config), *out]


def first_configuration(folder: Path, bag: Path, urdf: Path) -> list[str]:
    """Arguments of `init`."""
    return ["init", str(bag), "--urdf", str(urdf), "--out", str(folder / "arm.yaml")]


def simulation(folder: Path, config: Path | None = None) -> list[str]:
    """Arguments of the shortest simulation."""
    config = config or write_configuration(folder)
    return ["simulate", "--config", str(config), "--out", str(folder / "s.mcap"), "--duration", "1"]
