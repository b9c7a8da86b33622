"""Argument vectors: options drawn at random, with values that they should not have."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from tests.fuzz.case import (
    Build,
    Case,
    Good,
    command,
    excitation,
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
_SIMULATE = ("--duration", "--motion-seed", "--seed")
_WORDS = (
    "check", "identify", "diagnose", "excite", "simulate", "import", "record", "serve", "init",
    "--config", "--out", "--estimator", "--without", "--help", "--version", "--quiet", "--json",
    "--", "-", "-x", "--config=", "--seed", "--rate", "0", "\udcff", "[red]", "", "none.mcap",
    "stribeck", "idim-ls", "--force", "--verbose", "-o", "--install-completion",
)  # fmt: skip


def cases(seed: int) -> Iterator[Case]:
    """One option wrong at a time, then words at random."""
    for option in _EXCITE:
        for number in range(4):
            yield Case(f"excite{option}-{number}", _excite_with(option))
    for option in _SIMULATE:
        for number in range(5):
            yield Case(f"simulate{option}-{number}", _simulate_with(option))
    for duration in ("infinite", "nan", "1e300", "2000"):
        value = duration.replace("infinite", "inf")
        yield Case(f"simulate--duration-{duration}", _lasting(value))
    for name, arguments in _WRONG.items():
        yield Case(f"arguments-{name}", arguments)
    for number in range(25):
        yield Case(f"words-{number}", _any_words)


def _excite_with(option: str) -> Build:
    def build(folder: Path, good: Good, random: np.random.Generator) -> list[str]:
        config = write_configuration(folder)
        arguments = excitation(folder, config, **{option[2:]: str(random.choice(_NUMBERS))})
        for_diagnosis = random.uniform() < 0.15 or option == "--duration"
        return [*arguments, "--for", "diagnosis"] if for_diagnosis else arguments

    return build


def _simulate_with(option: str) -> Build:
    def build(folder: Path, good: Good, random: np.random.Generator) -> list[str]:
        arguments = simulation(folder)
        if option == "--duration":
            arguments = arguments[:-2]
        return [*arguments, option, str(random.choice(_NUMBERS))]

    return build


def _lasting(seconds: str) -> Build:
    return lambda folder, good, random: [*simulation(folder)[:-1], seconds]


def _identify_with(*options: str) -> Build:
    return lambda folder, good, random: [*command("identify", folder, [good.bag]), *options]


def _diagnose_with(*options: str) -> Build:
    return lambda folder, good, random: [*command("diagnose", folder, [good.bag]), *options]


_WRONG: dict[str, Build] = {
    "none": lambda folder, good, random: [],
    "repeats-of-400-digits": lambda folder, good, random: excitation(
        folder, write_configuration(folder), repeats="1" * 400
    ),
    "torque-noise-of-1e-300": lambda folder, good, random: [
        *excitation(folder, write_configuration(folder)), "--torque-noise", "1e-300",
    ],
    "time-limit-infinite": lambda folder, good, random: excitation(
        folder, write_configuration(folder), **{"time-limit": "inf"}
    ),
    "estimator": _identify_with("--estimator", "[bold]"),
    "estimator-long": _identify_with("--estimator", "x" * 20_000),
    "config-twice": _identify_with("--config", "/none.yaml"),
    "unknown-option": _identify_with("--colour", "[red]"),
    "missing-bag": _identify_with("none.mcap"),
    "without-unknown": _diagnose_with("--without", "[/]"),
    "without-everything": _diagnose_with(
        *(part for name in ("stribeck", "payload", "spring") for part in ("--without", name))
    ),
    "same-seed": lambda folder, good, random: [*simulation(folder), "--seed", "1", "--seed", "1"],
    "many-bags": lambda folder, good, random: command("check", folder, [good.bag] * 300),
    "empty-bag-name": lambda folder, good, random: [*command("check", folder, [good.bag]), ""],
    "empty-config": lambda folder, good, random: ["check", str(good.bag), "--config", ""],
    "empty-out": lambda folder, good, random: [*command("identify", folder, [good.bag])[:-1], ""],
    "record-without-config": lambda folder, good, random: ["record", "--out", str(folder / "o")],
    "record-wrong-config": lambda folder, good, random: [
        "record", "--config", str(folder / "none.yaml"), "--out", str(folder / "o")
    ],
    "serve-wrong-config": lambda folder, good, random: [
        "serve", "--config", str(folder), "--out", str(folder / "o")
    ],
}  # fmt: skip


def _any_words(folder: Path, good: Good, random: np.random.Generator) -> list[str]:
    words = [str(w) for w in random.choice(_WORDS, int(random.integers(1, 7)))]
    # With their configuration these two work until Ctrl-C.
    return [w for w in words if w not in ("--install-completion",)]
