"""KUKA KR300 with second encoders: the published stiffness, and a time offset that is none.

Published with the recordings: 4.58, 7.52 and 4.10 · 10⁶ N m/rad for axes 1 to 3, in the model of
the gears; the two encoder channels are 2.6 to 3.2 ms apart (shared/data/README.md). Axis 1 turns
about the vertical: gravity does not load it, and its acceleration twists it by less than its
encoder errs over the position. Its stiffness comes out twice the published one.
"""

from pathlib import Path

import pytest

from idim_iv_ros.diagnosis.refit.refit import refitted
from idim_iv_ros.diagnosis.result.recordings import Transmission
from idim_iv_ros.diagnosis.transmission import measured_transmissions
from idim_iv_ros.identification.check import check
from idim_iv_ros.identification.prepare import read_configured
from tests.real.recordings import kuka_bags, kuka_configuration

PUBLISHED = {"j2": 7.5189e6, "j3": 4.0999e6}


def measured(data: Path, folder: Path, link: str) -> dict[str, Transmission]:
    configuration = kuka_configuration(data, folder)
    recordings = read_configured(kuka_bags(data, folder, link=link), configuration)
    refit = refitted(recordings, configuration, ())
    joints = measured_transmissions(refit.data)
    return {joint.result.joint: joint.result for joint in joints}


@pytest.fixture(scope="module")
def encoders(data: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Transmission]:
    return measured(data, tmp_path_factory.mktemp("encoders"), "encoders")


def test_only_axes_with_a_second_encoder_are_measured(encoders) -> None:
    assert list(encoders) == ["j1", "j2", "j3"]


@pytest.mark.parametrize("joint", PUBLISHED)
def test_stiffness_of_axes_that_carry_gravity_is_the_published_one_within_20_percent(
    encoders, joint
) -> None:
    stiffness = encoders[joint].stiffness
    assert stiffness.value == pytest.approx(PUBLISHED[joint], rel=0.2)
    assert abs(stiffness.value - PUBLISHED[joint]) < 1.96 * stiffness.std


@pytest.mark.parametrize("joint", ["j1", "j2", "j3"])
def test_time_offset_of_the_channels_is_found_beside_the_twist(encoders, joint) -> None:
    offset = encoders[joint].time_offset
    assert 2.6e-3 < offset.value < 3.2e-3
    assert offset.std < 1e-4


def test_a_time_offset_alone_is_no_elasticity(data, tmp_path_factory) -> None:
    """The motor's own encoder, 3 ms late and with noise, in place of the one behind the gear."""
    for gear in measured(data, tmp_path_factory.mktemp("late"), "late").values():
        assert gear.stiffness is None
        assert gear.backlash is None
        assert abs(gear.time_offset.value - 3e-3) < 3.5 * gear.time_offset.std
        assert gear.stiffness_at_least > 1e7


def test_check_says_what_the_second_encoders_hold(data: Path, tmp_path: Path) -> None:
    """0.7 mrad rms between motor and link (shared/data/README.md)."""
    report = check(kuka_bags(data, tmp_path), kuka_configuration(data, tmp_path))
    said = {one.where: one.sentence for one in report.findings if "behind" in one.sentence}
    assert set(said) == {"j1", "j2", "j3"}
    assert report.usable
    assert all("0.6" in sentence and "mrad rms" in sentence for sentence in said.values())
