"""Paths: long, odd, missing, of special files, and results that have no place."""

import os
import socket
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

from tests.fuzz import tables
from tests.fuzz.case import (
    CONFIG,
    Case,
    Good,
    command,
    excitation,
    first_configuration,
    simulation,
    write_configuration,
)

_LONG = "x" * 300
_VERY_LONG = "/".join(["y" * 200] * 40)


def cases(seed: int) -> Iterator[Case]:
    """Every special file in every place; every odd name; then places for results."""
    for what, make in _SPECIAL.items():
        for place, (file, arguments) in _INPUTS.items():
            # An empty URDF on /robot_description is for others to judge.
            build = partial(_with_input, make, file, arguments)
            yield Case(f"file-{place}-{what}", build, refused=place != "description")
        if what in _REPLACEABLE:
            for how, name in _RESULTS.items():
                # What is empty holds nothing that could be lost, but this program did not write it.
                build = partial(_over_what_is_there, make, how, name)
                yield Case(f"out-{how}-{what}", build, refused=how != "identify")
    for name, text in _NAMES.items():
        yield Case(f"name-{name}", partial(_named, text))
    for name, (how, text) in _OUTPUTS.items():
        build = partial(lambda how, text, folder, good, _: _writing(how, folder, good, text),
                        how, text)  # fmt: skip
        yield Case(f"out-{name}", build, refused=name not in _FINE)


def _socket(path: Path) -> None:
    # The path of a socket may have 107 bytes; that of a test folder has more.
    here = os.open(path.parent, os.O_RDONLY)
    with socket.socket(socket.AF_UNIX) as server:
        server.bind(f"/proc/self/fd/{here}/{path.name}")
    os.close(here)


def _link_to(target: str) -> Callable[[Path], None]:
    return lambda path: path.symlink_to(target)


_SPECIAL: dict[str, Callable[[Path], None]] = {
    "folder": Path.mkdir,
    "empty": Path.touch,
    "fifo": os.mkfifo,
    "socket": _socket,
    "link-to-itself": lambda path: path.symlink_to(path.name),
    "unreadable": _link_to("/proc/self/mem"),
    "endless-zeros": _link_to("/dev/zero"),
    "endless-noise": _link_to("/dev/urandom"),
}
# Never a link to a device or out of the folder: what is written would go there, for good.
_REPLACEABLE = ("folder", "fifo", "socket", "link-to-itself")


def _table(folder: Path, path: Path) -> list[str]:
    (folder / "good.csv").write_text("1,2\n2,3\n3,4\n5,6\n")
    return tables.table(folder, path.name)


def _excite(out: Path, folder: Path, urdf: Path = CONFIG / "arm2.urdf") -> list[str]:
    return excitation(folder, write_configuration(folder, urdf=str(urdf)), out)


# Name of the special file, and the arguments that lead to it.
_INPUTS: dict[str, tuple[str, Callable[[Path, Path, Good], list[str]]]] = {
    "bag": ("b.mcap", lambda folder, path, good: command("check", folder, [path])),
    "database": ("b.db3", lambda folder, path, good: command("check", folder, [path])),
    "config": ("c.yaml", lambda folder, path, good: command("check", folder, [good.bag], path)),
    "urdf": ("r.urdf", lambda folder, path, good: _excite(folder / "m", folder, path)),
    "table": ("t.csv", lambda folder, path, good: _table(folder, path)),
    "npz": ("t.npz", lambda folder, path, good: _table(folder, path)),
    "effects": ("g.json", lambda folder, path, good: [*simulation(folder), "--effects", str(path)]),
    "trajectory": (
        "t.csv",
        lambda folder, path, good: [*simulation(folder), "--trajectory", str(path)],
    ),
    "init-urdf": ("r.urdf", lambda folder, path, good: first_configuration(folder, good.bag, path)),
    "description": (
        "r.urdf",
        lambda folder, path, good: [*_table(folder, folder / "good.csv"), "--urdf", str(path)],
    ),
}


def _with_input(
    make: Callable, file: str, arguments: Callable, folder: Path, good: Good, _: object
) -> list[str]:
    make(folder / file)
    return arguments(folder, folder / file, good)


_RESULTS = {
    "identify": "out",
    "simulate": "o.mcap",
    "import": "o.mcap",
    "init": "arm.yaml",
    "excite": "m.csv",
}


def _over_what_is_there(
    make: Callable, how: str, name: str, folder: Path, good: Good, _: object
) -> list[str]:
    make(folder / name)
    return _writing(how, folder, good, name)


def _writing(how: str, folder: Path, good: Good, name: str | None) -> list[str]:
    """Arguments with the results at a place in the folder; None is the empty name."""
    out = Path() if name is None else folder / name
    if how == "identify":
        return [*command("identify", folder, [good.bag])[:-1], str(out)]
    if how == "simulate":
        arguments = simulation(folder)
        arguments[arguments.index("--out") + 1] = str(out)
        return arguments
    if how == "init":
        return [*command("init", folder, [good.bag])[:-1], str(out)]
    if how == "excite":
        return _excite(out, folder)
    arguments = _table(folder, folder / "good.csv")
    arguments[1] = str(out)
    return arguments


_NAMES = {
    "long": _LONG + ".mcap",
    "very-long": _VERY_LONG + ".mcap",
    "markup": "[bold]a[/][red.mcap",
    "line-break": "a\nidim-iv: all is well\n.mcap",
    "escape": "\x1b[2J\x1b]0;x\x07.mcap",
    "surrogate": os.fsdecode(b"\xff\xfe.mcap"),
    "empty": "",
    "root": "/",
    "home": "~",
    "dash": "-",
    "star": "*.mcap",
    "percent": "%41%00.db3",
    "url": "http://example.com/a.mcap",
    "environment": "/proc/self/environ",
    "device": "/dev/stdin",
    "below-a-file": "robot.yaml/b.mcap",
}


def _named(text: str, folder: Path, good: Good, _: object) -> list[str]:
    """A bag of that name, where a file can have it; else the name alone."""
    arguments = command("check", folder, [good.bag])
    if text and "/" not in text and text not in ("~", "-") and len(os.fsencode(text)) < 250:
        (folder / text).write_bytes(good.bag.read_bytes())
    arguments[1] = text if text.startswith(("/", "-", "~")) or not text else str(folder / text)
    return arguments


# All inside the folder of the test: a device or a file of the system would be replaced for good.
_OUTPUTS: dict[str, tuple[str, str | None]] = {
    "long": ("identify", _LONG),
    "very-long": ("identify", _VERY_LONG),
    "below-a-file": ("identify", "robot.yaml/out"),
    "config-is-the-bag": ("simulate", "robot.yaml"),
    "no-name": ("simulate", None),
    "missing-folder": ("simulate", "none/o.mcap"),
    "long-import": ("import", _LONG + ".mcap"),
    "table-is-the-bag": ("import", "good.csv"),
    "import-of-245-bytes": ("import", "x" * 245 + ".mcap"),
    "import-elsewhere": ("import", "o.bag"),
    "motion-long": ("excite", _LONG),
    "init-long": ("init", _LONG),
    "markup": ("identify", "[bold]out[/"),
    "line-break": ("identify", "a\nb"),
}
_FINE = {"markup", "line-break", "import-of-245-bytes"}
