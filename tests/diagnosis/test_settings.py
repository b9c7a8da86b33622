"""Thresholds: none without a reader."""

from benchmarks import sensitivity


def test_every_setting_is_read_somewhere() -> None:
    assert [name for name, files in sensitivity.readers().items() if not files] == []
