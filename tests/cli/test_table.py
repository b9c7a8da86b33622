"""Tables on narrow terminals."""

import io

import pytest
from rich.console import Console

from idim_iv_ros.cli.diagnosis_tables import print_diagnosis
from idim_iv_ros.cli.output import print_table
from tests.report.sample_gap import sample_gap

LONG = "shoulder_pan_joint_very_long"
COLUMNS = ["joint", ">torque", "what was found"]
ROWS = [
    (LONG, "12.5 N m", "ZZ1 + Ia1 + YY2 + 0.0484·M3 grows with the speed"),
    ("elbow", "0.3 N m", "nothing"),
]


def printed(width: int, rows=ROWS, **options) -> str:
    console = Console(file=io.StringIO(), width=width)
    print_table(console, "Joints", COLUMNS, rows, **options)
    return console.file.getvalue()


@pytest.mark.parametrize("width", [12, 40, 60, 120])
def test_no_name_and_no_number_with_its_unit_is_cut(width: int) -> None:
    text = printed(width)
    assert all(whole in text for whole in (LONG, "12.5 N m", "0.3 N m", "elbow"))


def test_columns_that_say_nothing_and_rows_beyond_24_are_left_out() -> None:
    rows = [(f"joint_{k}", "–", "said") for k in range(30)]
    text = printed(80, rows, most=24)
    assert "torque" not in text
    assert text.count("said") == 24
    assert printed(80, rows).count("said") == 30


@pytest.mark.parametrize("width", [80, 110])
def test_a_diagnosis_fits_and_keeps_the_names_of_its_joints(width: int) -> None:
    console = Console(file=io.StringIO(), width=width)
    print_diagnosis(console, sample_gap(6, "both", first=LONG))
    text = console.file.getvalue()
    assert max(len(line.rstrip()) for line in text.splitlines()) <= width
    assert len(text.splitlines()) <= 50
    assert LONG in text
