"""`--against` and `--nominal` on the command line; what is computed is made up here."""

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

    def stand_in(bags, configuration, *, without=(), against=(), nominal=None, progress=None):
        calls.append((tuple(against), nominal))
        return sample_contrast()

    sets = [Path("a.mcap")], [Path("b1.mcap"), Path("b2.mcap")]
    diagnose(stand_in, sets[0], against=sets[1], nominal=Path("result.json"))
    assert calls == [(tuple(sets[1]), Path("result.json"))]
    printed = " ".join(capsys.readouterr().out.split())
    result = sample_contrast()
    assert result.contrast is not None
    sentence = " ".join(" ".join(contrast_headline(result, result.contrast)).split())
    assert printed.count(sentence) == 1
    assert printed.index("Contrast:") < printed.index("Verdict:")
    assert "payload" in printed and "mass\xa0=\xa00.81" in printed.replace(" ", "\xa0")


@pytest.mark.parametrize(
    ("option", "word"), [("--against BAG", "arm2.mcap"), ("--nominal WRONG", "wrong.json")]
)
def test_a_recording_in_both_sets_and_a_file_that_is_no_result_are_refused(
    run, bag: Path, config, tmp_path: Path, option: str, word: str
) -> None:
    wrong = tmp_path / "wrong.json"
    wrong.write_text("{}")
    option = option.replace("BAG", str(bag)).replace("WRONG", str(wrong))
    outcome = run(f"diagnose {bag} {option} --config {config()} --out {tmp_path / 'why'}")
    refused(outcome, 2, word)
    assert not (tmp_path / "why" / "gap.json").exists()
