"""Sections of a page: values that change, and transmissions."""

from dataclasses import replace

import numpy as np
import pytest

from idim_iv_ros.configuration import load_configuration
from idim_iv_ros.diagnosis.result import (
    EffectParameter,
    GapResult,
    Transmission,
    TransmissionSeries,
)
from idim_iv_ros.model import DynamicParameters
from idim_iv_ros.report.changes import changed_values
from idim_iv_ros.report.page import gap_report_html
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


def _diagnosis(values: np.ndarray, nominal: Nominal) -> GapResult:
    """A diagnosis of arm6 whose extended model has these base parameters."""
    assert nominal.model is not None
    base = nominal.model.base
    return replace(
        sample_gap(6, "parametric"),
        configuration=CONFIGURATION,
        causes=(),
        extended_parameters={
            name: EffectParameter(float(value), 1e-4, unit)
            for name, value, unit in zip(base.names, values, base.units, strict=True)
        },
    )


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
    assert "Ia1" in row.words and not row.key
    assert "simulator.armature[0]" not in [row.key for row in rows]


def test_without_a_nominal_model_new_values_stand_alone() -> None:
    result = sample_result(2)
    rows = changed_values(result, read_nominal({"robot": {"joints": ["a"]}}))
    assert len(rows) == len(result.parameters)
    gap = sample_gap(2, "none")
    assert all(row.given is None for row in changed_values(gap, read_nominal(gap.configuration)))


LOAD = np.linspace(-40.0, 40.0, 300)


def shown(*measured: Transmission) -> str:
    result = sample_gap(2)
    series = tuple(
        TransmissionSeries(one.joint, LOAD, LOAD / 2e4, np.sign(np.sin(LOAD)))
        for one in measured
        if one.time_offset is not None
    )
    page = gap_report_html(replace(result, transmissions=measured, twists=series))
    if 'id="transmissions"' not in page:
        return ""
    return page.split('id="transmissions"')[1].split("</section>")[0]


def test_measured_numbers_are_shown_with_their_intervals_and_units() -> None:
    text = shown(
        Transmission(
            joint="joint_1",
            stiffness=EffectParameter(2e4, 100.0, "N m/rad"),
            stiffness_at_least=1.98e4,
            backlash=EffectParameter(5e-4, 1e-5, "rad"),
            backlash_at_most=5.2e-4,
            time_offset=EffectParameter(0.003, 1e-5, "s"),
            elastic_share=0.9,
        )
    )
    assert "N m/rad" in text
    assert "0.500" in text
    assert "3.000" in text
    assert "no elasticity" in text
    assert "transmission-0" in text


def test_a_bound_and_the_reason_stand_where_nothing_is_measured() -> None:
    text = shown(
        Transmission(
            joint="joint_1",
            stiffness_at_least=3.2e5,
            time_offset=EffectParameter(0.0, 1e-5, "s"),
            reason="no twist follows the load",
        ),
        Transmission(joint="joint_2", reason="the encoder behind the gear stands still"),
    )
    assert "&gt; 320" in text
    assert "no twist follows the load" in text
    assert "stands still" in text
    assert "transmission-1" not in text


def test_without_encoders_there_is_no_section() -> None:
    assert shown() == ""
