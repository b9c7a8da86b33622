"""Settings at other values, and the page that says what the answer then is."""

from benchmarks import sensitivity
from idim_iv_ros.diagnosis import settings


def test_a_setting_is_changed_for_a_while_and_what_came_before_it_is_kept() -> None:
    before = settings.LEAST_SUPPORT
    with sensitivity.changed("LEAST_SUPPORT", 2.0 * before):
        assert 2.0 * before == settings.LEAST_SUPPORT
    assert settings.LEAST_SUPPORT is before
    assert sensitivity.first_step("MEASURED_BELOW") == "refit"
    assert sensitivity.first_step("WORDS_OF_SUMMARY") == "conclusion"


def test_every_setting_is_read_somewhere() -> None:
    assert [name for name, files in sensitivity.readers().items() if not files] == []
