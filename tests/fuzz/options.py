"""Options that change how a command answers, and not what is wrong."""

import json
import re
from dataclasses import replace
from pathlib import Path

from tests.fuzz.case import Case, Good, random_of

_ANSWERS = ((), (), ("--quiet",), ("--json",))
_TO_ALL = {"check", "identify", "diagnose", "excite", "simulate", "import", "init", "replay",
           "export"}  # fmt: skip
_WITHOUT_FORCE = {"check"}
# With --force these replace what somebody else wrote, as they were asked to.
_NEVER_FORCED = re.compile(r"out-config-is-the-bag|out-\w+-empty")
# These choose their options themselves.
_AS_THEY_ARE = ("words-", "arguments-")


def with_options(case: Case, seed: int) -> Case:
    """The same input, answered as --quiet or --json say; now and then with --force."""

    def build(folder: Path, good: Good, _: object) -> list[str]:
        arguments = case.build(folder, good, random_of(seed, case.name))
        random = random_of(seed, f"options of {case.name}")
        answer = _ANSWERS[int(random.integers(len(_ANSWERS)))]
        force = random.uniform() < 0.25
        command = arguments[0] if arguments else ""
        if command not in _TO_ALL or case.name.startswith(_AS_THEY_ARE):
            return arguments
        if force and command not in _WITHOUT_FORCE and not _NEVER_FORCED.match(case.name):
            answer = (*answer, "--force")
        return [*arguments, *answer]

    return replace(case, build=build)


def answer_faults(arguments: list[str], status: int, out: str) -> list[str]:
    """What is on stdout although --quiet or --json was asked for."""
    options = arguments[-2:]
    if "Usage: idim-iv" in out:
        return []
    if "--quiet" in options and out:
        return [f"on stdout in spite of --quiet: {out[:200]}"]
    if "--json" not in options or (status and not out):
        return []
    try:
        json.loads(out, parse_constant=_refuse)
    except ValueError as error:
        return [f"stdout is not JSON: {error}"]
    return []


def _refuse(constant: str) -> None:
    raise ValueError(constant)
