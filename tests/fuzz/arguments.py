"""Argument vectors: options with values that they should not have."""

from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np

from tests.fuzz.case import (
    Build,
    Case,
    Good,
    command,
    excitation,
    first_configuration,
    simulation,
    write_configuration,
)

_NUMBERS = (
    "0", "-1", "1", "nan", "inf", "-inf", "1e300", "-1e300", "1e-300", "1e9999", "999999999999999",
    "1" * 400, "x", "", " ", "1,2", "0x10", "１", "1_0", "\udcff", "[bold]", "a\nb",
)  # fmt: skip
_EXCITE = (
    "--floor", "--margin", "--acceleration", "--start", "--rate", "--message-rate", "--seed",
    "--period", "--repeats", "--harmonics", "--torque-noise", "--time-limit", "--duration",
    "--criterion", "--for",
)  # fmt: skip


def cases(seed: int) -> Iterator[Case]:
    """One option wrong at a time."""
    for option in _EXCITE:
        for number in range(2):
            yield Case(f"excite{option}-{number}", partial(_excite_with, option))
    for option in ("--duration", "--motion-seed", "--seed"):
        for number in range(3):
            yield Case(f"simulate{option}-{number}", partial(_simulate_with, option))
    for name, seconds in (("infinite", "inf"), ("1e300", "1e300"), ("2000", "2000")):
        yield Case(f"simulate--duration-{name}", _lasting(seconds))
    for name, arguments in _WRONG.items():
        yield Case(f"arguments-{name}", arguments)


def _excite_with(option: str, folder: Path, good: Good, random: np.random.Generator) -> list[str]:
    config = write_configuration(folder)
    options = {option[2:]: str(random.choice(_NUMBERS))}
    if random.uniform() < 0.15 or option == "--duration":
        options["for"] = "diagnosis"
    return excitation(folder, config, **options)


def _excite(**options: str) -> Build:
    return lambda folder, good, random: excitation(folder, write_configuration(folder), **options)


def _simulate_with(option: str, folder: Path, good: Good, random: np.random.Generator) -> list[str]:
    arguments = simulation(folder)
    if option == "--duration":
        arguments = arguments[:-2]
    return [*arguments, option, str(random.choice(_NUMBERS))]


def _lasting(seconds: str) -> Build:
    return lambda folder, good, random: [*simulation(folder)[:-1], seconds]


def _with(name: str, *options: str) -> Build:
    return lambda folder, good, random: [*command(name, folder, [good.bag]), *options]


_WRONG: dict[str, Build] = {
    "none": lambda folder, good, random: [],
    "repeats-of-400-digits": _excite(repeats="1" * 400),
    "torque-noise-of-1e-300": _excite(**{"torque-noise": "1e-300"}),
    "time-limit-infinite": _excite(**{"time-limit": "inf"}),
    "estimator": _with("identify", "--estimator", "[bold]"),
    "estimator-long": _with("identify", "--estimator", "x" * 20_000),
    "config-twice": _with("identify", "--config", "/none.yaml"),
    "unknown-option": _with("identify", "--colour", "[red]"),
    "missing-bag": _with("identify", "none.mcap"),
    "without-unknown": _with("diagnose", "--without", "[/]"),
    "many-bags": lambda folder, good, random: command("check", folder, [good.bag] * 300),
    "empty-bag-name": _with("check", ""),
    "empty-out": lambda folder, good, random: [*command("identify", folder, [good.bag])[:-1], ""],
    "init-no-bag": lambda folder, good, random: ["init", "--out", str(folder / "arm.yaml")],
    "init-missing-urdf": lambda folder, good, random: first_configuration(
        folder, good.bag, folder / "none.urdf"
    ),
    "record-without-config": lambda folder, good, random: ["record", "--out", str(folder / "o")],
    "serve-wrong-config": lambda folder, good, random: [
        "serve", "--config", str(folder), "--out", str(folder / "o")
    ],
}  # fmt: skip
