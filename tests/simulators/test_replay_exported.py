"""Files of one export, replayed and read again: every effect once, and no other parameters."""

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from idim_iv_ros import replay_bags
from idim_iv_ros.configuration import Configuration, load_configuration
from idim_iv_ros.errors import UsageError
from idim_iv_ros.model import build_inverse_model
from idim_iv_ros.model.urdf_reader import read_urdf_file
from idim_iv_ros.simulator_files import Exported
from tests.cli.conftest import bag, record  # noqa: F401 (fixtures)
from tests.simulator_files.cases import CONFIG, Case, case, cause

NATIVE: list[dict[str, Any]] = [
    cause("nonlinear_viscous", "joint_1", coefficient=0.8, power=2.0),
    cause("spring", "joint_2", linear=1.5, quadratic=-0.2, cubic=0.3),
    cause("joint_coupling", "joint_1", direction=-1.0, coulomb=0.4, viscous=0.3, power=1.0)
    | {"other_joint": "joint_2"},
]


@pytest.fixture
def arm(tmp_path: Path) -> Case:
    return case(tmp_path, "arm2", NATIVE)


@pytest.fixture
def made(arm: Case, tmp_path: Path) -> Exported:
    return arm.export(tmp_path / "out")


def nominal(made: Exported, folder: Path, key: str, path: Path) -> Configuration:
    """The exported file as the nominal model, with the lines of changes.md."""
    section = re.search(r"```yaml\n(.*?)```", made.changes.read_text(encoding="utf-8"), re.S)
    assert section is not None
    text = (CONFIG / "arm2.yaml").read_text(encoding="utf-8")
    text = re.sub(r"simulator:\n  armature:.*\n", section[1], text, count=1)
    config = folder / f"{key}.yaml"
    config.write_text(text.replace("urdf: arm2.urdf", f"{key}: {path}"), encoding="utf-8")
    return load_configuration(config)


def test_native_effects_are_simulated_once(
    arm: Case,
    made: Exported,
    bag: Path,  # noqa: F811
    tmp_path: Path,
) -> None:
    """The same motion as with every effect at each step, in an XML that has none of them."""
    document = json.loads(made.effects.read_text(encoding="utf-8"))
    assert [effect["native"] for effect in document["effects"][:3]] == [True] * 3
    plain = case(tmp_path, "arm2").export(tmp_path / "plain")
    for effect in document["effects"]:
        effect["native"] = False
    callbacks = tmp_path / "callbacks.json"
    callbacks.write_text(json.dumps(document), encoding="utf-8")
    configuration = arm.configuration
    last = "with effects"
    native = replay_bags(
        bag, configuration, model=made.mjcf, effects=made.effects, stages=(last,)
    ).positions[last]
    # The friction of both is as stiff: constant torques act on both joints.
    at_each_step = replay_bags(
        bag, configuration, model=plain.mjcf, effects=callbacks, stages=(last,)
    ).positions[last]
    without = replay_bags(
        bag, configuration, model=plain.mjcf, effects=plain.effects, stages=("corrected",)
    ).positions["corrected"]

    def rms(values: np.ndarray) -> float:
        return float(np.sqrt(np.mean(np.square(values))))

    # Twice or not at all would be as far away as the effects move the arm.
    assert rms(without - at_each_step) > 1e-3
    assert rms(native - at_each_step) < 0.02 * rms(without - at_each_step)


def test_the_exported_mjcf_is_the_same_nominal_model_as_the_exported_urdf(arm, made, tmp_path):
    """Native effects are none of it, and a note says so."""
    given = []
    for key, path in (("urdf", made.urdf), ("mjcf", made.mjcf)):
        configuration = nominal(made, tmp_path, key, path)
        model = build_inverse_model(configuration, read_urdf_file(path), path.name)
        assert model.base.names == arm.model.base.names
        given.append(model.given)
    np.testing.assert_allclose(given[1], given[0], rtol=1e-9, atol=1e-12)
    text = read_urdf_file(made.mjcf)
    for words in (
        "spring of joint_2",
        "nonlinear_viscous of joint_1",
        "joint_coupling of joint_1_",
    ):
        assert words in text


def test_files_of_two_exports_are_refused(
    arm: Case,
    made: Exported,
    bag: Path,  # noqa: F811
    tmp_path: Path,
) -> None:
    plain = case(tmp_path, "arm2").export(tmp_path / "plain")
    for model, effects, words in (
        (plain.mjcf, made.effects, "nonlinear_viscous at joint_1 is native, and .* does not have"),
        (made.mjcf, case(tmp_path, "arm2", NATIVE).path, "has nonlinear_viscous at joint_1 as an"),
        (made.urdf, made.effects, "is no MJCF"),
        (made.effects, made.effects, "is no MJCF"),
        (made.mjcf, made.mjcf, "is XML, not effects"),
    ):
        with pytest.raises(UsageError, match=words) as refused:
            replay_bags(bag, arm.configuration, model=model, effects=effects)
        assert "\n" not in str(refused.value)


def test_constant_torques_of_an_export_are_parameters(
    bag: Path,  # noqa: F811
    tmp_path: Path,
) -> None:
    """effects.json holds nothing else: the corrected robot is the whole answer."""
    arm = case(tmp_path, "arm2")
    made = arm.export(tmp_path / "out")
    assert made.not_native == ("torque_offset at joint_1", "torque_offset at joint_2")
    result = replay_bags(bag, arm.configuration, model=made.mjcf, effects=made.effects)
    assert [stage.name for stage in result.stages] == ["nominal", "corrected"]
    (stage,) = replay_bags(
        bag, arm.configuration, model=made.mjcf, stages=("corrected",)
    ).stages  # without them
    assert stage.torque != result.stages[1].torque
