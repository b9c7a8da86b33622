"""Paths: long, odd, missing, of special files, and results that have no place."""

import os
import socket
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

from tests.fuzz import messages
from tests.fuzz.case import CONFIG, Case, Good, command, excitation, simulation, write_configuration

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
            for how in ("identify", "simulate", "import", "init", "excite"):
                # What is empty holds nothing that could be lost, but this program did not write it.
                build = partial(_over_what_is_there, make, how)
                yield Case(f"out-{how}-{what}", build, refused=how != "identify")
    for name, text in _NAMES.items():
        yield Case(f"name-{name}", partial(_named, text))
    for name, write in _OUTPUTS.items():
        build = partial(lambda write, folder, good, _: write(folder, good), write)
        yield Case(f"out-{name}", build, refused=name not in _FINE)


def _fifo(path: Path) -> None:
    os.mkfifo(path)


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
    "fifo": _fifo,
    "socket": _socket,
    "link-to-itself": lambda path: path.symlink_to(path.name),
    "link-to-nothing": _link_to("/nowhere/at/all"),
    "unreadable": _link_to("/proc/self/mem"),
    "endless-zeros": _link_to("/dev/zero"),
    "endless-noise": _link_to("/dev/urandom"),
    "null": _link_to("/dev/null"),
    "full": _link_to("/dev/full"),
    "terminal": _link_to("/dev/tty"),
}
# Never a link to a device or out of the folder: what is written would go there, for good.
_REPLACEABLE = ("folder", "empty", "fifo", "socket", "link-to-itself")


def _table(folder: Path, path: Path) -> list[str]:
    (folder / "good.csv").write_text("1,2\n2,3\n3,4\n5,6\n")
    good = str(folder / "good.csv")
    out = str(folder / "o.mcap")
    options = ["--effort", good, "--joints", "a,b", "--rate", "9"]
    return ["import", out, "--position", str(path), *options]


# Name of the special file, and the arguments that lead to it.
_INPUTS: dict[str, tuple[str, Callable[[Path, Path, Good], list[str]]]] = {
    "bag": ("b.mcap", lambda folder, path, good: command("check", folder, [path])),
    "database": ("b.db3", lambda folder, path, good: command("check", folder, [path])),
    "config": ("c.yaml", lambda folder, path, good: command("check", folder, [good.bag], path)),
    "urdf": ("r.urdf", lambda folder, path, good: _excite(folder / "m", folder, path)),
    "table": ("t.csv", lambda folder, path, good: _table(folder, path)),
    "npz": ("t.npz", lambda folder, path, good: _table(folder, path)),
    "mat": ("t.mat", lambda folder, path, good: _table(folder, path)),
    "npy": ("t.npy", lambda folder, path, good: _table(folder, path)),
    "effects": (
        "g.json",
        lambda folder, path, good: [*simulation(folder), "--effects", str(path)],
    ),
    "trajectory": (
        "t.csv",
        lambda folder, path, good: [*simulation(folder), "--trajectory", str(path)],
    ),
    "init-bag": (
        "b.mcap",
        lambda folder, path, good: _first(folder, path, CONFIG / "arm2.urdf"),
    ),
    "init-urdf": ("r.urdf", lambda folder, path, good: _first(folder, good.bag, path)),
    "description": (
        "r.urdf",
        lambda folder, path, good: [*_good_table(folder), "--urdf", str(path)],
    ),
}


def _first(folder: Path, bag: Path, urdf: Path) -> list[str]:
    return ["init", str(bag), "--urdf", str(urdf), "--out", str(folder / "a.yaml")]


def _good_table(folder: Path) -> list[str]:
    return _table(folder, folder / "good.csv")


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


def _over_what_is_there(make: Callable, how: str, folder: Path, good: Good, _: object) -> list[str]:
    path = folder / _RESULTS[how]
    make(path)
    return _writing(how, folder, good, path)


def _writing(how: str, folder: Path, good: Good, out: Path) -> list[str]:
    if how == "identify":
        return [*command("identify", folder, [good.bag])[:-1], str(out)]
    if how == "simulate":
        arguments = simulation(folder)
        arguments[arguments.index("--out") + 1] = str(out)
        return arguments
    if how == "init":
        return ["init", str(good.bag), "--urdf", str(CONFIG / "arm2.urdf"), "--out", str(out)]
    if how == "excite":
        return _excite(out, folder)
    arguments = _good_table(folder)
    arguments[1] = str(out)
    return arguments


_NAMES = {
    "long": _LONG + ".mcap",
    "very-long": _VERY_LONG + ".mcap",
    "markup": "[bold]a[/][red.mcap",
    "closing-markup": "[/].mcap",
    "link": "[link=http://x]a.mcap",
    "line-break": "a\nidim-iv: all is well\n.mcap",
    "escape": "\x1b[2J\x1b]0;x\x07.mcap",
    "surrogate": os.fsdecode(b"\xff\xfe.mcap"),
    "combining": "a" + "\u0301" * 100 + ".mcap",
    "right-to-left": "\u202ea.mcap",
    "empty": "",
    "space": " ",
    "dot": ".",
    "dots": "..",
    "root": "/",
    "home": "~",
    "dash": "-",
    "star": "*.mcap",
    "question": "a?b=c#d.db3",
    "percent": "%41%00.db3",
    "url": "http://example.com/a.mcap",
    "process": "/proc/self",
    "environment": "/proc/self/environ",
    "descriptor": "/proc/self/fd/0",
    "device": "/dev/stdin",
    "below-a-file": "robot.yaml/b.mcap",
}


def _named(text: str, folder: Path, good: Good, _: object) -> list[str]:
    """A bag of that name, where a file can have it; else the name alone."""
    arguments = command("check", folder, [good.bag])
    bag = folder / text
    odd = not text or text.startswith(("/", ".", " ", "~")) or "/" in text
    if not odd and len(os.fsencode(text)) < 250:
        if text.endswith(".db3"):
            messages.write_db3(bag, messages.raw(messages.states(good)))
        else:
            bag.write_bytes(good.bag.read_bytes())
    arguments[1] = text if text.startswith(("/", "-", "~")) or not text else str(bag)
    return arguments


def _out(text: str, how: str = "identify") -> Callable[[Path, Good], list[str]]:
    return lambda folder, good: _writing(how, folder, good, folder / text)


def _holding(*names: str, how: str = "identify") -> Callable[[Path, Good], list[str]]:
    """The folder for the results holds files that this program did not write."""

    def build(folder: Path, good: Good) -> list[str]:
        (folder / "out").mkdir()
        for name in names:
            if name.endswith("/"):
                (folder / "out" / name).mkdir()
            else:
                (folder / "out" / name).write_text("mine")
        return _writing(how, folder, good, folder / "out")

    return build


def _over_the_configuration(folder: Path, good: Good) -> list[str]:
    config = write_configuration(folder)
    return ["simulate", "--config", str(config), "--out", str(config), "--duration", "1"]


def _import_over_its_table(folder: Path, good: Good) -> list[str]:
    arguments = _good_table(folder)
    arguments[1] = arguments[3]
    return arguments


def _truth_is_a_folder(folder: Path, good: Good) -> list[str]:
    (folder / "o.truth.json").mkdir()
    return _writing("simulate", folder, good, folder / "o.mcap")


def _second_seed_is_a_folder(folder: Path, good: Good) -> list[str]:
    (folder / "o-2.mcap").mkdir()
    return [*_writing("simulate", folder, good, folder / "o.mcap"), "--seed", "1", "--seed", "2"]


def _excite(out: Path, folder: Path, urdf: Path = CONFIG / "arm2.urdf") -> list[str]:
    return excitation(folder, write_configuration(folder, urdf=str(urdf)), out)


def _one_of_three_is_a_folder(folder: Path, good: Good) -> list[str]:
    (folder / "m.json").mkdir()
    return _excite(folder / "m", folder)


# All inside the folder of the test: a device or a file of the system would be replaced for good.
_OUTPUTS: dict[str, Callable[[Path, Good], list[str]]] = {
    "long": _out(_LONG),
    "very-long": _out(_VERY_LONG),
    "below-a-file": _out("robot.yaml/out"),
    "no-name": lambda folder, good: _writing("simulate", folder, good, Path()),
    "long-bag": _out(_LONG + ".mcap", "simulate"),
    "bag-of-245-bytes": _out("x" * 245 + ".mcap", "simulate"),
    "missing-folder": _out("none/o.mcap", "simulate"),
    "long-import": _out(_LONG + ".mcap", "import"),
    "import-of-245-bytes": _out("x" * 245 + ".mcap", "import"),
    "missing-folder-of-import": _out("none/o.mcap", "import"),
    "import-elsewhere": _out("o.bag", "import"),
    "result-is-a-folder": _holding("result.json/"),
    "report-is-a-folder": _holding("report.html/"),
    "config-is-the-bag": _over_the_configuration,
    "table-is-the-bag": _import_over_its_table,
    "truth-is-a-folder": _truth_is_a_folder,
    "second-seed-is-a-folder": _second_seed_is_a_folder,
    "motion-long": lambda folder, good: _excite(folder / _LONG, folder),
    "motion-of-250-bytes": lambda folder, good: _excite(folder / ("x" * 250), folder),
    "motion-in-part-a-folder": _one_of_three_is_a_folder,
    "markup": _out("[bold]out[/"),
    "line-break": _out("a\nb"),
}
_FINE = {"markup", "line-break", "import-of-245-bytes", "motion-of-250-bytes"}
