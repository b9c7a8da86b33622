"""`init` with bags and URDFs of every kind: it meets both before anybody has looked at them."""

from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np

from tests.fuzz import bags, messages, robots
from tests.fuzz.case import CONFIG, Case, Good, write_text

_PAIRS = 40


def cases(seed: int) -> Iterator[Case]:
    """Every kind of bag or URDF beside a good one would be hundreds: each seed draws pairs."""
    for number in range(_PAIRS):
        yield Case(f"init-pair-{number}", partial(_pair, number))
    for name, arguments in _ARGUMENTS.items():
        build = partial(lambda arguments, folder, good, _: arguments(folder, good), arguments)
        yield Case(f"init-{name}", build, refused=True)


def _pair(number: int, folder: Path, good: Good, random: np.random.Generator) -> list[str]:
    """Good and bad, bad and good, bad and bad in turns."""
    states = messages.states(good)
    if number % 3 != 1:
        changes = bags.changes()
        states = changes[str(random.choice(list(changes)))](states, random)
    urdf = (CONFIG / "arm2.urdf").read_text(encoding="utf-8")
    if number % 3 != 0:
        texts = robots.texts()
        urdf = texts[str(random.choice(list(texts)))]
    raw = messages.raw(states)
    within = number % 4 == 3  # the URDF is in the bag, where it fits into a message
    if within:
        text = urdf.encode("utf-8", "surrogateescape").decode("utf-8", "replace")
        raw = [messages.text_message(text), *raw]
    messages.write_mcap(folder / "bag.mcap", raw)
    write_text(folder / "robot.urdf", urdf)
    return _init(folder, folder / "bag.mcap", None if within else folder / "robot.urdf")


def _init(folder: Path, bag: Path, urdf: Path | None, *, out: str = "arm.yaml") -> list[str]:
    description = [] if urdf is None else ["--urdf", str(urdf)]
    return ["init", str(bag), *description, "--out", str(folder / out)]


_GOOD_URDF = CONFIG / "arm2.urdf"
_ARGUMENTS = {
    "no-bag": lambda folder, good: ["init", "--out", str(folder / "arm.yaml")],
    "missing-bag": lambda folder, good: _init(folder, folder / "none.mcap", _GOOD_URDF),
    "missing-urdf": lambda folder, good: _init(folder, good.bag, folder / "none.urdf"),
    "urdf-is-the-bag": lambda folder, good: _init(folder, good.bag, good.bag),
    "missing-folder": lambda folder, good: _init(folder, good.bag, _GOOD_URDF, out="none/a.yaml"),
    "long-out": lambda folder, good: _init(folder, good.bag, _GOOD_URDF, out="x" * 300),
    "no-out": lambda folder, good: _init(folder, good.bag, _GOOD_URDF, out=""),
}
