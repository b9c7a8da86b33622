"""`--picture`: one picture beside the report, refused before any work."""

from pathlib import Path

import pytest

from idim_iv_ros.errors import UsageError
from tests.cli.test_diagnose import StandIn


def test_identify_writes_the_picture_and_refuses_another_format(run, config, bag, tmp_path: Path):
    out, picture = tmp_path / "results", tmp_path / "summary.svg"
    done = run("identify", bag, "--config", config(), "--out", out, "--picture", picture, status=0)
    assert picture.read_text(encoding="utf-8").startswith("<svg")
    done = run(f"identify {bag} --config {config()} --out {out} --picture summary.pdf", status=2)
    assert ".svg or .png" in done.error


def test_diagnose_refuses_a_picture_before_the_work(diagnose, tmp_path: Path) -> None:
    stand_in, picture = StandIn("both"), tmp_path / "gap.svg"
    with pytest.raises(UsageError, match="--picture"):
        diagnose(stand_in, picture=tmp_path / "gap.gif")
    assert stand_in.calls == []
    diagnose(stand_in, picture=picture)
    assert "parametric and structural" in picture.read_text(encoding="utf-8")
