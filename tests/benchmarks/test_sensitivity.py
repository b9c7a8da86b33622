"""Settings at other values, and the page that says what the answer then is."""

import pytest

from benchmarks import sensitivity
from idim_iv_ros.diagnosis import settings


def test_settings_are_halved_and_doubled_and_large_shares_by_their_distance_from_one() -> None:
    assert [float(value) for value in sensitivity.variants("LEAST_SUPPORT")] == [4.0, 16.0]
    assert sensitivity.variants("MEASURED_BELOW") == pytest.approx([0.8, 0.2])
    assert sensitivity.variants("FOLDS") == (2, 8)


def test_a_setting_is_changed_for_a_while_and_what_came_before_it_is_kept() -> None:
    before = settings.LEAST_SUPPORT
    with sensitivity.changed("LEAST_SUPPORT", 2.0 * before):
        assert 2.0 * before == settings.LEAST_SUPPORT
    assert settings.LEAST_SUPPORT is before
    assert sensitivity.first_step("MEASURED_BELOW") == "refit"
    assert sensitivity.first_step("WORDS_OF_SUMMARY") == "conclusion"


def test_the_page_lists_first_what_changes_most() -> None:
    plain = {"verdict": "none", "causes": []}
    other = {"verdict": "structural", "causes": ["stribeck[joint_1]"]}
    of_cell = {"": plain, "FOLDS=2": plain, "LEAST_SUPPORT=4": other}
    rows = sensitivity.what_changes({"0123456789ab": of_cell})[2:]
    assert "| `LEAST_SUPPORT` | 8 | 4 | 1 | 1 | 1 | 1 | 0123: structural" in rows[0]
    assert rows[1].startswith("| `FOLDS` | 4 | 2 | 1 | 0 | 0 | 0 |")


def test_every_setting_is_read_somewhere() -> None:
    assert [name for name, files in sensitivity.readers().items() if not files] == []
