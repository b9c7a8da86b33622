"""Pages of results."""

from pathlib import Path

import pytest

from benchmarks import measurement


def test_what_was_argued_by_hand_outlives_new_figures(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(measurement, "RESULTS", tmp_path)
    measurement.write_page("speed", "Speed", ["first figures"])
    page = tmp_path / "speed.md"
    with page.open("a") as file:
        file.write(f"\n{measurement.BY_HAND}\n\n## Reasons\n\nBecause.\n")
    for figures in ("second figures", "third figures"):
        measurement.write_page("speed", "Speed", [figures])
        text = page.read_text()
        assert figures in text and "first" not in text
        assert text.endswith("## Reasons\n\nBecause.\n") and text.count("Because") == 1
        assert "read again" in capsys.readouterr().out
