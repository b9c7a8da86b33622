"""A wrong configuration is one line that names the file and the key."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from idim_iv_ros.configuration import Configuration, Section, load_configuration
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
        (GOOD.replace("kp: [1.0, 1.0]", "kp: [1.0, 0]"), "controller.kp.1: .*, not 0"),
        (GOOD.replace("kd: [0.1, 0.1]", "kd: [0.1, -2]"), "controller.kd.1: .*, not -2"),
        (GOOD + "  ki: [-1, 0]\n", "controller.ki.0: .*, not -1"),
        (GOOD + "  period: -0.001\n", "controller.period: .*, not -0.001"),
        (GOOD + "  period: 1.0e-300\n", "controller.period"),
        (GOOD + "simulator: {armature: [-1, -1]}\n", "simulator.armature.0: .*, not -1"),
        (GOOD + "signals: {effort_scale: [1, 0]}\n", "signals.effort_scale.1: must not be zero"),
        (GOOD + "signals: {link_states: /joint_states}\n", "link_states is /joint_states"),
        (GOOD + "signals: {joint_states: ~/joint_states}\n", r"signals\.joint_states"),
        (GOOD + "processing: {trim: [-1, 0]}\n", "processing.trim.0: .*, not -1"),
        (GOOD + "simulated_robot: {rate: -5}\n", "simulated_robot.rate: .*, not -5"),
        (GOOD + "simulated_robot: {parameters: {ZZ1: .nan}}\n", "simulated_robot.parameters.ZZ1"),
        (
            GOOD + "  period: 0.001\nsimulated_robot: {plant_step: 1.0e-6}\n",
            "plant_step is 1e-06 s: between controller.period, 0.001 s",
        ),
        (GOOD.replace("[a, b]", "[1, 2]"), "robot.joints.0: .* quotes"),
        (GOOD + "identification: {max_iterations: 1000000}\n", "identification.max_iterations"),
        (GOOD.replace("[a, b]", "[a, b]\n  couplings: [{joints: [a, a]}]"), "a with itself"),
        (
            GOOD.replace("[a, b]", "[a, b]\n  couplings: [{joints: [a, b]}, {joints: [a, b]}]"),
            "couples the motor of b twice",
        ),
        (GOOD.replace("robot:\n  joints: [a, b]", "robot: {}"), "key robot.joints is missing"),
        (GOOD.replace("[a, b]", "[a, b]\n  urdf: no.urdf"), "no file .*no.urdf"),
        ("robot: [", "line"),
        ("just words", "mapping"),
        (
            GOOD.replace("[a, b]", "[a, b]\n  motor_to_joint: [[1, 0]]"),
            "motor_to_joint must be 2 by 2",
        ),
        (GOOD.replace("[a, b]", "[a, b]\n  couplings: [{joints: [a, c]}]"), "couplings names c"),
    ],
)
def test_wrong_file_names_the_key(tmp_path: Path, text: str, words: str) -> None:
    path = write(tmp_path, text)
    with pytest.raises(UsageError, match=words) as caught:
        load_configuration(path)
    said = str(caught.value)
    assert said.startswith(str(path))
    assert not any(raw in said for raw in ("\n", "Input should", "pydantic", "http"))


def keys(section: type[Section], path: tuple[str, ...] = ()) -> Iterator[tuple[str, ...]]:
    """Every key of a configuration that is no section."""
    for name, field in section.model_fields.items():
        annotation = field.annotation
        if isinstance(annotation, type) and issubclass(annotation, Section):
            yield from keys(annotation, (*path, name))
        elif not field.exclude:
            yield (*path, name)


KEYS = [".".join(path) for path in keys(Configuration)]
NO_VALUE = [
    "2001-99-99",
    "!!binary aGVsbG8=",
    "!!python/object:os.system {}",
    "{a: [b]}",
    "1" * 5000,
]
NUMBERS = [
    *("controller.period", "controller.delay", "simulated_robot.rate", "simulated_robot.delay"),
    *("simulated_robot.disturbance_bandwidth", "simulated_robot.stamp_jitter"),
    *("simulated_robot.plant_step", "processing.position_cutoff", "processing.position_order"),
    *("processing.decimation_cutoff", "processing.decimation_edge", "processing.reversal_margin"),
    *("identification.tolerance", "identification.max_iterations", "identification.significance"),
]
NO_NUMBER = [".nan", ".inf", "-.inf", "1e300", "-1e300", "1" * 400, "text", "true", "[[text]]"]


def with_key(path: str, value: str) -> str:
    section, key = path.split(".")
    other = "" if section == "robot" else "robot:\n  joints: [a, b]\n"
    joints = "  joints: [a, b]\n" if section == "robot" and key != "joints" else ""
    law = "  kp: [1.0, 1.0]\n  kd: [1.0, 1.0]\n" if path == "controller.type" else ""
    return f"{other}{section}:\n{joints}{law}  {key}: {value}\n"


@pytest.mark.parametrize("key", KEYS)
def test_no_value_of_any_key_is_more_than_a_line(tmp_path: Path, key: str) -> None:
    values = [*NO_VALUE, *NO_NUMBER, "-1", "[]", "[-1, -1]", "[.nan, 1]", "[1e300, 1]", "null"]
    for value in [*values, "x" * 10_000, "[" + "1, " * 300 + "1]", '"a\\nb\\0"']:
        path = write(tmp_path, with_key(key, value))
        try:
            load_configuration(path)
        except UsageError as error:
            assert str(error).startswith(str(path))
            assert len(str(error)) < len(str(path)) + 500
        else:
            assert value not in NO_VALUE
            assert key not in NUMBERS or value not in NO_NUMBER


BOMB = "a: &a [x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"{new}: &{new} [{', '.join([f'*{old}'] * 9)}]\n"
    for old, new in zip("abcdefgh", "bcdefghi", strict=True)
)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[" * 5000, "nested more than 20 deep"),
        ("- " * 5000, "nested more than 20 deep"),
        (BOMB, "an alias within an anchor"),
        ("robot: &r {joints: *r}", "an alias within an anchor"),
        ("- robot", "a mapping"),
        ("---\na: 1\n---\nb: 2\n", "line 3"),
        ("robot: {joints: [a]}\nrobot: {joints: [b]}", "line 2"),
        ("? [1, 2]\n: 3", "key robot is missing"),
        ("robot: *nowhere", "line 1"),
        ("x" * 100_001, "larger than 0.1 MB"),
        (r'robot: {joints: ["\ud800"]}', r"line 1: '\\ud800' is not text"),
        ("\ufeff" + GOOD + "colour: red", "unknown key colour"),
        (f"{'k' * 1000}: 1", "unknown key k"),
    ],
    ids=[str(k) for k in range(13)],
)
def test_text_that_is_no_configuration_is_one_line(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "robot.yaml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(UsageError, match=words) as caught:
        load_configuration(path)
    assert str(caught.value).startswith(str(path))
    assert len(str(caught.value)) < len(str(path)) + 500


def test_an_anchor_may_be_used_for_two_keys(tmp_path: Path) -> None:
    text = GOOD.replace("kp: [1.0, 1.0]", "kp: &same [1.0, 1.0]").replace("[0.1, 0.1]", "*same")
    assert load_configuration(write(tmp_path, text)).controller.kd == [1.0, 1.0]
