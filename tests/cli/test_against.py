"""`--against` on the command line; what is computed is made up here."""

from pathlib import Path

import pytest

from idim_iv_ros.cli.diagnose import separated_sets
from idim_iv_ros.report.advice import contrast_headline
from tests.cli.conftest import refused
from tests.report.sample_contrast import sample_contrast


@pytest.mark.parametrize(
    ("given", "read"),
    [
        ("a --against b c --out d", "a --against b --against c --out d"),
        ("--against b c -q", "--against b --against c -q"),
        ("--against b --against c", "--against b --against c"),
        ("--against b -- a c", "--against b -- a c"),
        ("a b --out d", "a b --out d"),
    ],
)
def test_names_behind_against_belong_to_it_up_to_the_next_option(given: str, read: str) -> None:
    assert list(separated_sets(given.split())) == read.split()


def test_what_changed_is_printed_before_the_reference_by_itself(diagnose, capsys) -> None:
    calls = []

    def stand_in(bags, configuration, *, without=(), against=(), progress=None):
        calls.append(tuple(against))
        return sample_contrast()

    sets = [Path("a.mcap")], [Path("b1.mcap"), Path("b2.mcap")]
    diagnose(stand_in, sets[0], against=sets[1])
    assert calls == [tuple(sets[1])]
    printed = " ".join(capsys.readouterr().out.split())
    result = sample_contrast()
    assert result.contrast is not None
    sentence = " ".join(" ".join(contrast_headline(result, result.contrast)).split())
    assert printed.count(sentence) == 1
    assert printed.index("Contrast:") < printed.index("Verdict:")
    assert "payload" in printed and "mass\xa0=\xa00.81" in printed.replace(" ", "\xa0")


def test_a_recording_in_both_sets_is_refused(run, bag: Path, config, tmp_path: Path) -> None:
    outcome = run(f"diagnose {bag} --against {bag} --config {config()} --out {tmp_path / 'why'}")
    refused(outcome, 2, "arm2.mcap")
    assert not (tmp_path / "why" / "gap.json").exists()
