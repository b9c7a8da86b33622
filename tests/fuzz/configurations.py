"""Every key of the configuration with what it must not hold; the keys are those of the model."""

from collections.abc import Iterator
from functools import partial
from itertools import pairwise
from pathlib import Path

from pydantic import BaseModel

from idim_iv_ros.configuration import Configuration
from tests.fuzz.case import (
    Case,
    Good,
    Yaml,
    command,
    configuration,
    random_of,
    simulation,
    write_configuration,
    write_text,
)

_VALUES = {
    "nothing": "null",
    "nan": ".nan",
    "infinite": ".inf",
    "minus-one": "-1",
    "minus-ones": "[-1.0, -1.0]",
    "zeros": "[0, 0]",
    "tiny": "1.0e-300",
    "huge": "1.0e+300",
    "huge-integer": "1" + "0" * 400,
    "largest": "[1.7976931348623157e+308, 1.7976931348623157e+308]",
    "three": "[1.0, 2.0, 3.0]",
    "huge-matrix": "[[1.0e+300, 0], [1.0e-300, 1.0e+300]]",
    "empty-list": "[]",
    "text": "text",
    "half-character": r'"\ud800"',
    "line-break": '"a\\nb\\e[2J"',
    "mapping-of-huge": "{YY1: 1.0e+300, MX1: -1.0e+300}",
    "negative-inertia": "{YY1: -5.0, YY2: -5.0}",
    "yes": "true",
    "set": "!!set {a, b}",
    "many": "[" + ", ".join(["1.0"] * 2000) + "]",
}
_DRAWN = 2  # values for each key and seed
_WITH_SIMULATION = ("simulator", "simulated_robot", "controller")
_WITH_IDENTIFICATION = ("identification",)


def keys(model: type[BaseModel] = Configuration, before: tuple[str, ...] = ()) -> list[tuple]:
    """Paths of all keys, sections too; `source` is no key of the file."""
    paths = []
    for name, field in model.model_fields.items():
        if field.exclude:
            continue
        paths.append((*before, name))
        if isinstance(field.annotation, type) and issubclass(field.annotation, BaseModel):
            paths += keys(field.annotation, (*before, name))
    return paths


def cases(seed: int) -> Iterator[Case]:
    """Draw values for each key; every seed draws others."""
    for key in keys():
        random = random_of(seed, ".".join(key))
        for name in random.choice(list(_VALUES), size=_DRAWN, replace=False):
            build = partial(_value, key, str(name), int(random.integers(8)))
            yield Case(f"key-{'.'.join(key)}-{name}", build)
    for name, text in _TEXTS.items():
        yield Case(f"yaml-{name}", partial(_text, text))


def _value(
    key: tuple[str, ...], name: str, draw: int, folder: Path, good: Good, _: object
) -> list[str]:
    document = configuration()
    place = document
    for part in key[:-1]:
        place = place.setdefault(part, {})
    place[key[-1]] = Yaml(_VALUES[name])
    path = write_configuration(folder, document)
    if key[0] in _WITH_SIMULATION and draw % 4:
        return simulation(folder, path)
    heavy = key[0] in _WITH_IDENTIFICATION or draw in (0, 1)
    return command("identify" if heavy else "check", folder, [good.bag], path)


def _text(text: str, folder: Path, good: Good, _: object) -> list[str]:
    path = write_text(folder / "robot.yaml", text)
    return command("check", folder, [good.bag], path)


# More of them: tests/test_configuration.py.
_TEXTS = {
    "empty": "",
    "brackets": "[" * 5000,
    "nested-blocks": "".join(" " * k + "a:\n" for k in range(1500)),
    "aliases": "a: &a [1,1,1,1,1,1,1,1,1,1]\n"
    + "".join(f"{b}: &{b} [{','.join(['*' + a] * 10)}]\n" for a, b in pairwise("abcdefghi"))
    + "robot: *i\n",
    "merge-itself": "robot: &r {<<: *r}",
    "not-text": "\udcff\udcfe",
    "null-byte": "robot: \x00",
    "object": "!!python/object/apply:os.system ['true']",
    "million-keys": "{" + ",".join(f"k{n}: {n}" for n in range(20_000)) + "}",
}
