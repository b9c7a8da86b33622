"""An identified model in the place of the URDF's values, and files that are of another robot."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bags.simulated_arms import arm2, joint_topics, record
from idim_iv_ros import diagnose, identify
from idim_iv_ros.diagnosis.nominal import read_nominal_model, with_nominal
from idim_iv_ros.diagnosis.refit.baseline import Baseline, baseline
from idim_iv_ros.diagnosis.result import EffectParameter, NominalModel
from idim_iv_ros.effects.registry import STRUCTURAL
from idim_iv_ros.errors import UsageError
from idim_iv_ros.recording import write_bag
from tests.estimation.test_simulated_arms import recorded

ARM = arm2(seconds=6.0)
CONFIGURATION = ARM.configuration


@pytest.fixture(scope="module")
def data() -> Baseline:
    return baseline([recorded(ARM, 1)], CONFIGURATION)


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("nominal") / "arm2.mcap"
    write_bag(path, joint_topics(ARM, record(ARM, 1)))
    return path


@pytest.fixture(scope="module")
def result(bag: Path) -> Path:
    path = bag.parent / "result.json"
    identify([bag], CONFIGURATION).write(path)
    return path


def model_of(data: Baseline, values: np.ndarray) -> NominalModel:
    base = data.prepared.model.base
    numbers = zip(base.names, base.units, values, strict=True)
    parameters = {name: EffectParameter(float(value), 0.1, unit) for name, unit, value in numbers}
    return NominalModel("result.json", "arm2", (), parameters)


def test_the_nominal_model_has_the_identified_base_parameters(data: Baseline) -> None:
    given = data.prepared.model.given
    values = given * np.random.default_rng(1).uniform(0.7, 1.3, len(given))
    changed = with_nominal(data, model_of(data, values)).prepared
    assert changed.given == pytest.approx(values, rel=1e-9, abs=1e-12)
    assert not changed.armature_missing


def test_parameters_that_are_the_urdfs_change_nothing(data: Baseline) -> None:
    model = data.prepared.model
    same = with_nominal(data, model_of(data, model.given)).prepared.model
    assert same.robot.given.inertial == pytest.approx(model.robot.given.inertial, abs=1e-12)
    assert same.robot.given.coulomb == pytest.approx(model.robot.given.coulomb, abs=1e-12)


def test_with_its_own_identified_model_a_robot_has_no_parameter_error(bag, result) -> None:
    everything = [effect.name for effect in STRUCTURAL]
    wrong = diagnose([bag], CONFIGURATION, without=everything)
    right = diagnose([bag], CONFIGURATION, without=everything, nominal=result)
    assert wrong.verdict == "parametric"
    assert right.verdict == "none"
    assert right.nominal is not None and right.nominal.file == str(result)
    assert right.joint_gaps[0].rms < 0.2 * wrong.joint_gaps[0].rms


def test_effects_of_a_diagnosis_are_listed_as_left_out(bag: Path, tmp_path: Path) -> None:
    diagnosis = diagnose([bag], CONFIGURATION, without=[effect.name for effect in STRUCTURAL])
    path = tmp_path / "gap.json"
    diagnosis.write(path)
    read = read_nominal_model(path, CONFIGURATION)
    assert set(read.parameters) == set(diagnosis.extended_parameters)
    assert read.left_out == ()
    assert read.kinematics == diagnosis.kinematics


Change = Callable[[dict[str, Any]], object]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda d: d.update(joints=["a", "b"]), "it is of the joints a, b"),
        (lambda d: d["configuration"]["robot"].update(gravity=[0.0, 0.0, 9.81]), "robot.gravity"),
        (lambda d: d.update(format="idim_iv_ros/check/1"), "not an identification"),
        (lambda d: d["parameters"].pop(0), "it lacks"),
        (lambda d: d["parameters"][0].update(name="ZZ9"), "has no ZZ9"),
        (lambda d: d["parameters"][0].update(unit="kg"), "is in kg"),
        (lambda d: d.update(kinematics="0" * 64), "the geometry is another"),
    ],
)
def test_a_result_of_another_robot_is_refused_in_one_line(data, result, tmp_path, change, words):
    document = json.loads(result.read_text())
    change(document)
    path = tmp_path / "other.json"
    path.write_text(json.dumps(document))
    with pytest.raises(UsageError, match=words) as refused:
        with_nominal(data, read_nominal_model(path, CONFIGURATION))
    assert "\n" not in str(refused.value)
    assert str(path) in str(refused.value)


def test_a_number_that_is_none_is_refused(data: Baseline) -> None:
    model = model_of(data, data.prepared.model.given)
    name = data.prepared.model.base.names[0]
    parameters = {**model.parameters, name: EffectParameter(np.nan, None, "kg m²")}
    broken = replace(model, parameters=parameters)
    with pytest.raises(UsageError, match="no finite number"):
        with_nominal(data, broken)
