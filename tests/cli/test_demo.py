"""The first command of the README: the demo of a fresh clone."""

import re

from bags.demo import demo


def test_demo_compares_the_estimates_with_the_truth_and_writes_a_report(tmp_path, capsys) -> None:
    demo(tmp_path / "demo")
    printed = capsys.readouterr().out
    within, count = map(
        int, re.search(r"(\d+) of (\d+) base parameters lie within", printed).groups()
    )
    assert within >= 0.95 * count > 40
    assert printed.count(" σ ") > 20  # rows of the table: how far off the truth
    assert (tmp_path / "demo" / "report.html").is_file()
