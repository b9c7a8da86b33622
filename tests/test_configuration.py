"""A wrong configuration is one line that names the file and the key."""

from pathlib import Path

import pytest

from idim_iv_ros.configuration import load_configuration
from idim_iv_ros.errors import UsageError

GOOD = """
robot:
  joints: [a, b]
controller:
  type: pd
  kp: [1.0, 1.0]
  kd: [0.1, 0.1]
"""


def write(folder: Path, text: str) -> Path:
    path = folder / "robot.yaml"
    path.write_text(text)
    return path


def test_good_file_is_read(tmp_path: Path) -> None:
    configuration = load_configuration(write(tmp_path, GOOD))
    assert configuration.robot.joints == ["a", "b"]
    assert configuration.controller.kp == [1.0, 1.0]


@pytest.mark.parametrize("path", sorted((Path(__file__).parents[1] / "config").glob("*.yaml")))
def test_shipped_configurations_are_right(path: Path) -> None:
    assert load_configuration(path).robot.joints


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (GOOD + "colour: red\n", "unknown key colour"),
        (GOOD.replace("kp:", "Kp:"), "unknown key controller.Kp"),
        (GOOD.replace("kd: [0.1, 0.1]", "kd: [0.1]"), "controller.kd has 1 values for 2 joints"),
        (GOOD.replace("kd: [0.1, 0.1]", ""), "type pd needs kd"),
        (GOOD.replace("type: pd", "type: pid"), "controller.type"),
        (GOOD.replace("[a, b]", "[a, a]"), "names a joint twice"),
        (GOOD.replace("kp: [1.0, 1.0]", "kp: [1.0, fast]"), "controller.kp.1"),
        (GOOD.replace("kp: [1.0, 1.0]", "kp: [1.0, .inf]"), "controller.kp.1"),
        (GOOD.replace("robot:\n  joints: [a, b]", "robot: {}"), "key robot.joints is missing"),
        (GOOD.replace("[a, b]", "[a, b]\n  urdf: no.urdf"), "no file .*no.urdf"),
        ("robot: [", "line"),
        ("just words", "mapping"),
        ("", "mapping"),
        (GOOD + "processing: {position_cutoff: -3}\n", "processing.position_cutoff"),
        (
            GOOD.replace("[a, b]", "[a, b]\n  motor_to_joint: [[1, 0]]"),
            "motor_to_joint must be 2 by 2",
        ),
        (
            GOOD.replace("[a, b]", "[a, b]\n  couplings: [{joints: [a, c]}]"),
            "couplings names c",
        ),
    ],
)
def test_wrong_file_names_the_key(tmp_path: Path, text: str, words: str) -> None:
    path = write(tmp_path, text)
    with pytest.raises(UsageError, match=words) as caught:
        load_configuration(path)
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)


def test_missing_and_binary_files_are_named(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"none\.yaml: cannot read"):
        load_configuration(tmp_path / "none.yaml")
    (tmp_path / "binary.yaml").write_bytes(b"\xff\xfe\x00\x80")
    with pytest.raises(UsageError, match=r"binary\.yaml"):
        load_configuration(tmp_path / "binary.yaml")
