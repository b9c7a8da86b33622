"""The diagnosis on the fast subset of the blind benchmark: about five minutes on two cores.

Thresholds are what was measured (benchmarks/results/withheld_effects.md), with the room that 42
cells need: a share of 12 cells moves by 8 % with one of them.
"""

from pathlib import Path

import pytest

from benchmarks.withheld_effects.generate import generate
from benchmarks.withheld_effects.run import run
from benchmarks.withheld_effects.score import score
from benchmarks.withheld_effects.tables import page_lines
from benchmarks.withheld_effects.verdict import Judged


@pytest.fixture(scope="module")
def judged(tmp_path_factory: pytest.TempPathFactory) -> list[Judged]:
    out: Path = tmp_path_factory.mktemp("withheld")
    generate(out, "fast")
    assert run(out) == 0
    scored = score(out)
    print("\n" + "\n".join(page_lines(scored)))
    assert not scored.missing
    return list(scored.judged.values())


def of_group(judged: list[Judged], *groups: str) -> list[Judged]:
    return [cell for cell in judged if cell.label["group"] in groups]


def test_nothing_is_found_where_nothing_is(judged: list[Judged]) -> None:
    quiet = [cell for cell in of_group(judged, "none") if not cell.label["without"]]
    assert len(quiet) == 12
    assert sum(bool(cell.false_alarms) for cell in quiet) <= 1


def test_right_effect_at_the_right_joint_comes_first(judged: list[Judged]) -> None:
    single = of_group(judged, "single")
    assert len(single) == 16
    assert sum(cell.first for cell in single) >= 14
    sizes = [cell.set_size for cell in single if cell.set_size]
    assert sum(sizes) / len(sizes) <= 1.5


def test_both_of_a_pair_are_found(judged: list[Judged]) -> None:
    pairs = of_group(judged, "pair")
    assert len(pairs) == 2
    assert sum(sum(cell.found) for cell in pairs) >= 3


def test_wrong_numbers_are_found(judged: list[Judged]) -> None:
    assert all(cell.first for cell in of_group(judged, "parametric"))


def test_what_is_not_in_the_catalogue_is_not_misnamed(judged: list[Judged]) -> None:
    outside = of_group(judged, "outside")
    assert len(outside) == 4
    assert sum(bool(cell.false_alarms) for cell in outside) <= 1
