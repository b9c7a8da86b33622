"""Tables on narrow terminals."""

import io

import pytest
from rich.console import Console

from idim_iv_ros.cli.diagnosis_tables import print_diagnosis
from idim_iv_ros.cli.table import print_table, unbroken
from tests.report.sample_gap import sample_gap, with_first_joint_named

LONG = "shoulder_pan_joint_very_long"
COLUMNS = ["joint", ">torque", "what was found"]
ROWS = [
    (LONG, unbroken("12.5 N m"), "ZZ1 + Ia1 + YY2 + 0.0484·M3 grows with the speed"),
    ("elbow", unbroken("0.3 N m"), "nothing"),
]


def printed(width: int, rows=ROWS, **options) -> str:
    console = Console(file=io.StringIO(), width=width)
    print_table(console, "Joints", COLUMNS, rows, **options)
    return console.file.getvalue()


@pytest.mark.parametrize("width", range(12, 121, 6))
def test_no_word_and_no_number_with_its_unit_is_cut_at_any_width(width: int) -> None:
    text = printed(width)
    for whole in (LONG, "12.5 N m", "0.3 N m", "0.0484·M3", "elbow", "nothing", "speed"):
        assert whole in text
    assert "…" not in text


@pytest.mark.parametrize("width", [60, 80, 100])
def test_nothing_is_wider_than_the_terminal(width: int) -> None:
    assert max(len(line.rstrip()) for line in printed(width).splitlines()) <= width


def test_columns_that_do_not_fit_become_blocks() -> None:
    assert LONG in printed(80).splitlines()[2]
    narrow = printed(40).splitlines()
    assert narrow[1] == LONG
    assert narrow[2] == "  torque: 12.5 N m"


def test_a_column_that_says_nothing_is_left_out() -> None:
    rows = [("elbow", "–", "something"), ("wrist", "–", "")]
    text = printed(80, rows)
    assert "torque" not in text
    assert "what was found" in text


def test_a_long_table_says_how_many_rows_are_not_shown() -> None:
    rows = [(f"joint_{k}", "1", "") for k in range(30)]
    assert "… and 6 more" in printed(80, rows, whole=False)
    assert "more" not in printed(80, rows)


@pytest.mark.parametrize("width", [60, 80])
def test_a_diagnosis_fits_and_keeps_the_names_of_its_joints(width: int) -> None:
    console = Console(file=io.StringIO(), width=width)
    print_diagnosis(console, with_first_joint_named(sample_gap(6, "both"), LONG), whole=False)
    text = console.file.getvalue()
    assert max(len(line.rstrip()) for line in text.splitlines()) <= width
    assert LONG in text
    assert "0.041 kg" in text
