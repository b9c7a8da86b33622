"""A result is used for the robot and configuration that it was made with, and for no other."""

import json
from dataclasses import replace

import numpy as np
import pytest

from idim_iv_ros.errors import UsageError
from idim_iv_ros.model import build_inverse_model
from idim_iv_ros.prediction import LivePrediction, identified_model
from tests.inputs import changed
from tests.prediction.arm6 import play, samples, urdf_of


@pytest.mark.parametrize(
    ("section", "values", "words"),
    [
        ("robot", {"gravity": [0.0, 0.0, 9.81]}, "another robot.gravity"),
        ("robot", {"joints": [f"joint_{k}" for k in (2, 1, 3, 4, 5, 6)]}, "another robot"),
        ("signals", {"effort_scale": [2.0] * 6}, "another signals.effort_scale"),
        ("signals", {"effort_unit": "A"}, "another signals.effort_unit"),
        ("robot", {"motor_to_joint": np.eye(6).tolist()}, "another robot.motor_to_joint"),
        ("identification", {"friction": ["viscous"]}, "another identification.friction"),
    ],
)
def test_a_result_of_another_configuration_is_refused_in_one_line(
    result, configuration, identified, section, values, words
) -> None:
    other = changed(configuration, section, **values)
    with pytest.raises(UsageError, match=words) as refusal:
        identified_model(result, other, identified.model, "arm6.urdf")
    assert "\n" not in str(refusal.value)


def test_a_result_of_another_urdf_is_refused(result, configuration) -> None:
    text, source = urdf_of(configuration)
    place = text.index("<origin", text.index('<joint name="joint_2"'))
    end = text.index("/>", place)
    longer = text[:place] + '<origin xyz="0.1 0.2 0.3" rpy="0 0 0"' + text[end:]
    model = build_inverse_model(configuration, longer, source)
    with pytest.raises(UsageError, match="placed or turned"):
        identified_model(result, configuration, model, source)


@pytest.mark.parametrize("processing", [{"colour": 1}, {"decimation_edge": -1.0}, 5])
def test_a_result_of_unknown_processing_is_refused(
    tmp_path, result, configuration, identified, processing
) -> None:
    document = json.loads(result.read_text())
    document["configuration"]["processing"] = processing
    path = tmp_path / "result.json"
    path.write_text(json.dumps(document))
    with pytest.raises(UsageError) as refusal:
        identified_model(path, configuration, identified.model, "arm6.urdf")
    assert "\n" not in str(refusal.value)


def test_units_follow_the_joint_and_the_effort(identified) -> None:
    types = ("prismatic", *identified.result.joint_types[1:])
    sliding = replace(identified, result=replace(identified.result, joint_types=types))
    assert sliding.units == ("N", *["N m"] * 5)
    assert sliding.turning == (False, *[True] * 5)
    current = replace(identified, result=replace(identified.result, effort_unit="A"))
    assert set(current.units) == {"A"}


def test_signals_of_motors_are_brought_to_the_joints(identified, recording) -> None:
    """Gears of a hundred and efforts in quarters: the same robot, the same predictions."""
    ratio, scale = 100.0, 0.25
    transform = replace(
        identified.transform,
        to_joint=np.eye(6) / ratio,
        to_torque=np.eye(6) * ratio * scale,
    )
    motors = replace(identified, transform=transform)
    positions, efforts = samples(recording, slice(0, 2))
    expected = play(LivePrediction(identified), positions, efforts)[-1]
    prediction = play(
        LivePrediction(motors),
        replace(positions, values=positions.values * ratio),
        replace(efforts, values=efforts.values / ratio / scale),
    )[-1]
    assert prediction.measured == pytest.approx(expected.measured, abs=1e-6)
    assert prediction.predicted == pytest.approx(expected.predicted, abs=1e-6, nan_ok=True)
