"""Given and new values: the rows that can be written into a file, and those that cannot."""

from dataclasses import replace

import numpy as np
import pytest

from idim_iv_ros.configuration import load_configuration
from idim_iv_ros.diagnosis.result import Cause, EffectParameter, GapResult
from idim_iv_ros.model import DynamicParameters
from idim_iv_ros.report.changes import RECORDING, SUM, ChangedValue, changed_values
from idim_iv_ros.report.section import Nominal, read_nominal
from tests.report.sample_gap import sample_gap
from tests.report.sample_result import sample_result

CONFIGURATION = load_configuration("config/arm6.yaml").model_dump(mode="json", exclude_none=True)


@pytest.fixture(scope="module")
def nominal() -> Nominal:
    return read_nominal(CONFIGURATION)


def _of(robot: DynamicParameters, nominal: Nominal) -> np.ndarray:
    assert nominal.model is not None
    return nominal.model.base.from_standard(nominal.model.regressor.layout.vector(robot))


def _diagnosis(values: np.ndarray, nominal: Nominal, *causes: Cause) -> GapResult:
    """A diagnosis of arm6 whose extended model has these base parameters."""
    assert nominal.model is not None
    base = nominal.model.base
    return replace(
        sample_gap(6, "parametric"),
        configuration=CONFIGURATION,
        causes=causes,
        extended_parameters={
            name: EffectParameter(float(value), 1e-4, unit)
            for name, value, unit in zip(base.names, values, base.units, strict=True)
        },
    )


def _cause(effect: str, joint: str | None, **parameters: EffectParameter) -> Cause:
    first = sample_gap(2, "parametric").causes[0]
    return replace(first, effect=effect, joint=joint, parameters=parameters)


def _by_key(rows: list[ChangedValue]) -> dict[str, ChangedValue]:
    return {row.key: row for row in rows if row.key}


def test_a_changed_element_is_the_only_significant_row_of_its_kind(nominal: Nominal) -> None:
    assert nominal.model is not None
    given = nominal.model.robot.given
    coulomb, inertia = given.coulomb.copy(), given.drive_inertia.copy()
    coulomb[3] += 0.3
    inertia[4] -= 0.02
    robot = replace(given, coulomb=coulomb, drive_inertia=inertia)
    rows = changed_values(_diagnosis(_of(robot, nominal), nominal), nominal)
    changed = {row.key: row.new for row in rows if row.significant}
    assert changed == {
        "joint_4/dynamics@friction": pytest.approx(coulomb[3]),
        "simulator.armature[4]": pytest.approx(inertia[4]),
    }


def test_what_is_grouped_with_another_parameter_is_only_a_sum(nominal: Nominal) -> None:
    assert nominal.model is not None
    given = nominal.model.robot.given
    inertia = given.drive_inertia.copy()
    inertia[0] += 0.5  # Ia1 cannot be separated from ZZ1
    moved = _of(replace(given, drive_inertia=inertia), nominal)
    rows = changed_values(_diagnosis(moved, nominal), nominal)
    (row,) = [row for row in rows if row.significant]
    assert (row.source, row.key) == (SUM, "")
    assert "Ia1" in row.words
    assert "simulator.armature[0]" not in _by_key(rows)
    assert all(row.source != SUM for row in rows if row.key)


def test_a_cause_says_which_part_of_a_sum_changed(nominal: Nominal) -> None:
    assert nominal.model is not None
    change = EffectParameter(0.5, 0.02, "kg m²")
    cause = _cause("drive_inertia", "joint_1", change_of_drive_inertia=change)
    rows = changed_values(_diagnosis(nominal.model.given, nominal, cause), nominal)
    row = _by_key(rows)["simulator.armature[0]"]
    assert (row.given, row.new, row.std) == pytest.approx((0.9, 1.4, 0.02))
    assert row.source == "cause: drive inertia at joint_1"
    assert rows[0] is row


def test_one_key_has_one_value_though_a_cause_and_the_refit_know_it(nominal: Nominal) -> None:
    assert nominal.model is not None
    cause = _cause(
        "friction_level",
        "joint_2",
        change_of_viscous=EffectParameter(0.4, 0.01, "N m s/rad"),
        change_of_coulomb=EffectParameter(-1.0, 0.02, "N m"),
    )
    rows = changed_values(_diagnosis(nominal.model.given, nominal, cause), nominal)
    keys = [row.key for row in rows if row.key]
    assert len(keys) == len(set(keys))
    by_key = _by_key(rows)
    given = nominal.model.robot.given
    assert by_key["joint_2/dynamics@damping"].new == pytest.approx(given.viscous[1] + 0.4)
    assert by_key["joint_2/dynamics@friction"].new == pytest.approx(given.coulomb[1] - 1.0)
    assert by_key["joint_3/dynamics@damping"].source == RECORDING


def test_the_centre_of_a_payload_has_an_interval_for_any_correlation(nominal: Nominal) -> None:
    assert nominal.model is not None
    mass, moment = EffectParameter(2.0, 0.1, "kg"), EffectParameter(0.3, 0.02, "kg m")
    cause = _cause("payload", "joint_6", mass=mass, moment_z=moment)
    rows = changed_values(_diagnosis(nominal.model.given, nominal, cause), nominal)
    centre = next(row for row in rows if row.key.endswith("(z)"))
    assert centre.new == pytest.approx(0.15)
    # d(m z / m) for errors of one σ that act in the same direction.
    worst = max(
        abs((0.3 + a * 0.02 * h) / (2.0 + b * 0.1 * h) - 0.15) / h
        for a in (-1, 1)
        for b in (-1, 1)
        for h in (1e-6,)
    )
    assert centre.std == pytest.approx(worst, rel=1e-4)


def test_without_a_nominal_model_new_values_stand_alone() -> None:
    result = sample_result(2)
    rows = changed_values(result, read_nominal({"robot": {"joints": ["a"]}}))
    assert len(rows) == len(result.parameters)
    gap = sample_gap(2, "none")
    assert all(row.given is None for row in changed_values(gap, read_nominal(gap.configuration)))
