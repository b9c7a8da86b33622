"""Thresholds: none without a reader."""

from idim_iv_ros.diagnosis import settings


def test_every_setting_is_read_somewhere() -> None:
    assert [name for name, files in settings.readers().items() if not files] == []


def test_a_setting_is_a_number_and_keeps_what_it_says_at_another_value() -> None:
    tried = settings.LEAST_SUPPORT.times(0.5)
    assert tried == 0.5 * settings.LEAST_SUPPORT
    assert (tried.unit, tried.origin) == (settings.LEAST_SUPPORT.unit, settings.CHOSEN)
    assert isinstance(settings.WORDS_OF_SUMMARY.times(2.0), int)
    assert settings.FOLDS.times(0.01) == 1
