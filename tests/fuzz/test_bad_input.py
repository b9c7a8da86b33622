"""Whatever a user gives: an answer or one line, soon, within memory, and no half-written file."""

import zlib
from pathlib import Path

import pytest

from tests.command_line import CommandLine
from tests.fuzz import arguments, bags, places, tables, texts
from tests.fuzz.case import Case, Good, random_of
from tests.fuzz.runs import answer_faults, faults, file_faults, files_of

_FAMILIES = (bags, texts, tables, places, arguments)
_SEEDS = range(1, 11)
_ANSWERS = ((), (), ("--quiet",), ("--json",))
_WITH_ANSWERS = {"check", "identify", "diagnose", "excite", "simulate", "import", "init", "replay",
                 "export"}  # fmt: skip

# Inputs that broke the program before this was tested, whatever the draw below says.
_ALWAYS = (
    "db3-data-NULL", "db3-timestamp-text", "db3-recursive-view", "name-long", "yaml-brackets",
    "table-junk.npz", "table-claims-1e12.npy", "import-rate-1e-300", "table-nan", "table-complex",
    "content-huge-efforts", "content-simulated-then-epoch", "gap-huge-integer-parameter",
    "file-config-fifo", "file-urdf-fifo", "file-init-urdf-fifo", "out-simulate-fifo",
    "out-import-fifo", "out-no-name", "table-nothing.mat", "table-flipped-5",
    "table-csv-same-header", "import-surrogate-joint", "content-same-joints",
    "arguments-repeats-of-400-digits", "arguments-torque-noise-of-1e-300",
    "arguments-time-limit-infinite", "torn-and-three-gigabytes-of-nothing",
    "trajectory-hour-steps", "simulate--duration-infinite", "file-trajectory-endless-zeros",
)  # fmt: skip


def _cases(seed: int) -> list[Case]:
    return [case for family in _FAMILIES for case in family.cases(seed)]


def _drawn() -> list[Case]:
    """All tables, databases and damaged bytes, and every sixth other input by its name."""
    return [
        case
        for case in _cases(1)
        if case.name in _ALWAYS
        or case.name.startswith(("table-", "db3-", "flipped-"))
        or zlib.crc32(case.name.encode()) % 6 == 0
    ]


def _seen(case: Case, seed: int, folder: Path, fuzzed: tuple[CommandLine, Good]) -> list[str]:
    """What is wrong with the answer to an input, which --quiet or --json may ask for."""
    line, good = fuzzed
    random = random_of(seed, case.name)
    words = case.build(folder, good, random)
    if words and words[0] in _WITH_ANSWERS and not case.name.startswith("arguments-"):
        words = [*words, *_ANSWERS[int(random.integers(len(_ANSWERS)))]]
    before = files_of(folder)
    outcome = line.run(words, folder)
    defects = faults(outcome, refused=case.refused)
    defects += file_faults(words, outcome.status, folder, before)
    defects += answer_faults(words, outcome.status, outcome.out)
    return [*defects, outcome.error[-2000:]] if defects else []


def test_there_are_hundreds_of_inputs_of_different_names() -> None:
    names = [case.name for case in _cases(1)]
    assert len(_drawn()) >= 200
    assert len(set(names)) == len(names)
    assert set(_ALWAYS) <= set(names)


@pytest.mark.parametrize("case", _drawn(), ids=lambda case: case.name)
def test_bad_input_ends_in_an_answer_or_one_line(
    case: Case, tmp_path: Path, fuzzed: tuple[CommandLine, Good]
) -> None:
    assert _seen(case, 1, tmp_path, fuzzed) == []


@pytest.mark.slow
@pytest.mark.parametrize("seed", _SEEDS)
def test_all_bad_input_of_ten_seeds_ends_in_an_answer_or_one_line(
    seed: int, tmp_path: Path, fuzzed: tuple[CommandLine, Good]
) -> None:
    wrong = {}
    for number, case in enumerate(_cases(seed)):
        folder = tmp_path / str(number)
        folder.mkdir()
        if defects := _seen(case, seed, folder, fuzzed):
            wrong[case.name] = defects
    assert wrong == {}
