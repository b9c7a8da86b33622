"""Robots that cannot be are refused by every command; strange ones are warned of."""

from pathlib import Path

import pytest

from tests.cli.conftest import CONFIG, refused, said

URDF = (CONFIG / "arm2.urdf").read_text()
COMMANDS = {
    "check": ("check", "BAG"),
    "identify": ("identify", "BAG", "--out", "OUT"),
    "diagnose": ("diagnose", "BAG", "--out", "OUT"),
    "simulate": ("simulate", "--out", "OUT.mcap"),
    "excite": ("excite", "--out", "OUT"),
}


@pytest.fixture
def with_urdf(config, tmp_path: Path):
    """A configuration of the two-joint arm with another URDF."""

    def write(*replacements: tuple[str, str]) -> Path:
        text = URDF
        for old, new in replacements:
            assert old in text, old
            text = text.replace(old, new, 1)
        (tmp_path / "odd.urdf").write_text(text)
        return config((str(CONFIG / "arm2.urdf"), str(tmp_path / "odd.urdf")))

    return write


def arguments(command: str, bag: Path, folder: Path) -> list[str]:
    places = {"BAG": str(bag), "OUT": str(folder / "out"), "OUT.mcap": str(folder / "out.mcap")}
    return [places.get(word, word) for word in COMMANDS[command]]


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('mass value="4.2"', 'mass value="-4"', ("link link_1", "mass -4 kg is negative")),
        ('iyy="0.0581263"', 'iyy="9"', ("link link_1", "triangle inequality")),
        ('axis xyz="0 1 0"', 'axis xyz="0 0 0"', ("joint joint_1", "its axis is zero")),
        ('lower="-2.8"', 'lower="99"', ("joint joint_1", "lower limit 99 is above")),
    ],
)
def test_robot_that_cannot_be_is_refused_by_every_command(
    run, bag, with_urdf, tmp_path: Path, command, old, new, words
) -> None:
    configuration = with_urdf((old, new))
    outcome = run(*arguments(command, bag, tmp_path), "--config", configuration)
    refused(outcome, 2, "odd.urdf", *words)
    assert not (tmp_path / "out").exists()
    assert not (tmp_path / "out.mcap").exists()


@pytest.mark.parametrize("command", ["check", "simulate"])
def test_strange_link_is_warned_of(run, bag, with_urdf, tmp_path: Path, command) -> None:
    configuration = with_urdf(('mass value="4.2"', 'mass value="0"'))
    outcome = run(*arguments(command, bag, tmp_path), "--config", configuration, status=0)
    assert "link link_1:" in outcome.out
    assert said(outcome.error) == []


def test_check_says_that_the_armature_was_not_given(run, bag, config) -> None:
    armature = "simulator:\n  armature: [0.25, 0.1]   # kg m², joint side\n"
    said = run("check", bag, "--config", config((armature, "")))
    assert "simulator.armature" in said.out
    assert "simulator.armature" not in run("check", bag, "--config", config()).out
