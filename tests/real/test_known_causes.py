"""Causes that are known to be in real recordings."""

from pathlib import Path

import pytest

from benchmarks.real_causes import CASES
from idim_iv_ros import load_configuration
from idim_iv_ros.diagnosis.controller import LawCheck, check_law
from idim_iv_ros.diagnosis.refit.refit import refitted
from idim_iv_ros.identification.check import check
from idim_iv_ros.identification.prepare import read_configured
from tests.real.recordings import (
    DUTY_PER_GAIN,
    PULSES,
    SERVO_URDF,
    emps_with_pulses,
    servo_bags,
    servo_configuration,
)


def law_check(bags: list[Path], configuration: Path) -> LawCheck:
    loaded = load_configuration(configuration)
    return check_law(refitted(read_configured(bags, loaded), loaded, ()).data)


@pytest.fixture(scope="module")
def servo(data: Path, tmp_path_factory: pytest.TempPathFactory):
    def checked(recorded: int, law: int) -> LawCheck:
        folder = tmp_path_factory.mktemp("servo")
        (folder / "xl330.urdf").write_text(SERVO_URDF)
        path = folder / "xl330.yaml"
        path.write_text(servo_configuration(law, folder / "xl330.urdf"))
        return law_check(servo_bags(data, folder, recorded), path)

    return checked


@pytest.mark.parametrize("gain", [100, 200, 400])
def test_recordings_of_a_gain_agree_with_the_law_of_that_gain(servo, gain) -> None:
    answer = servo(gain, gain)
    assert answer.causes == ()
    assert answer.beyond == ()


@pytest.mark.parametrize(("gain", "law"), [(100, 200), (400, 100)])
def test_recordings_of_a_gain_are_not_those_of_another_law(servo, gain, law) -> None:
    """The gain that the robot used instead is found: the unit of the command is V."""
    (finding,) = servo(gain, law).causes
    volts = DUTY_PER_GAIN * gain * 7.3 / 885.0
    assert finding.parameters["kp"].value == pytest.approx(volts, rel=0.03)


def test_pulses_in_the_command_are_said_with_size_joint_and_times(data, config, tmp_path) -> None:
    """35.15 N/V (shared/data/README.md)."""
    bag = emps_with_pulses(data, tmp_path / "emps.mcap")
    (sentence,) = law_check([bag], config / "emps.yaml").beyond
    assert sentence.startswith("the commands of axis hold")
    assert "more times" not in sentence
    for begin, end, volts in PULSES:
        said = [part for part in sentence.split(", ") if f" {begin:.0f}." in part or
                f"from {begin:.1f}" in part]  # fmt: skip
        numbers = _numbers(said)
        assert numbers[0] == pytest.approx(35.15 * volts, rel=0.05)
        assert numbers[1] == pytest.approx(begin, abs=0.03)
        assert numbers[2] == pytest.approx(end, abs=0.03)


def _numbers(parts: list[str]) -> tuple[float, float, float]:
    """Size, begin and end of the one part that tells of a pulse."""
    (part,) = [text for text in parts if " N from " in text]
    size, _, rest = part.partition(" N from ")
    begin, _, rest = rest.partition(" to ")
    return float(size.split()[-1]), float(begin), float(rest.split()[0])


@pytest.mark.parametrize(
    ("name", "compensations"),
    [
        ("ur10", []),
        ("design A0 with its own model", []),
        ("pendubot, everything in the effort", []),
        ("pendubot, disturbance missing", ["elbow"]),
    ],
)
def test_only_a_friction_compensation_is_no_torque(name, compensations, data, tmp_path) -> None:
    """The command of the pendubot's elbow is that of its friction compensation, nothing else."""
    (case,) = [one for one in CASES if one.name == name]
    bags, configuration = case.make(data, tmp_path)
    report = check(bags, load_configuration(configuration))
    assert [one.where for one in report.findings if one.level == "unusable"] == compensations
