"""Sections of a page: values that change, and transmissions."""

import math
import sys
from dataclasses import replace

import numpy as np
import pytest

from idim_iv_ros.configuration import load_configuration
from idim_iv_ros.diagnosis.result.document import GapResult
from idim_iv_ros.diagnosis.result.recordings import Transmission, TransmissionSeries
from idim_iv_ros.effects.cause import EffectParameter
from idim_iv_ros.identification.result import JointSeries
from idim_iv_ros.model import DynamicParameters
from idim_iv_ros.recording.recording import SessionPart
from idim_iv_ros.report import numerals
from idim_iv_ros.report.numerals import MISSING, count, exact, measured, number, p_value, percent
from idim_iv_ros.report.page import gap_report_html
from idim_iv_ros.report.section import Nominal, read_nominal
from idim_iv_ros.report.sections.parameters import changed_values
from idim_iv_ros.report.time_axis import Curves, SessionAxis, curves
from tests.report.sample_gap import sample_gap
from tests.report.sample_result import sample_result

CONFIGURATION = load_configuration("config/arm6.yaml").model_dump(mode="json", exclude_none=True)


@pytest.fixture(scope="module")
def nominal() -> Nominal:
    return read_nominal(CONFIGURATION)


def _of(robot: DynamicParameters, nominal: Nominal) -> np.ndarray:
    return nominal.model.base.from_standard(nominal.model.regressor.layout.vector(robot))


def _diagnosis(values: np.ndarray, nominal: Nominal) -> GapResult:
    """A diagnosis of arm6 whose extended model has these base parameters."""
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
    for part in ("N m/rad", "0.500", "3.000", "no elasticity", "transmission-0"):
        assert part in text


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


T = "\N{NARROW NO-BREAK SPACE}"


@pytest.mark.parametrize(
    ("value", "std", "text", "half"),
    [
        (1.248637, 0.01625, "1.249", f"±{T}0.032"),
        (-0.0213456, 0.00427, "−0.0213", f"±{T}0.0084"),
        (95.10887, 0.05, "95.109", f"±{T}0.098"),
        (12345.6, 510.0, f"12{T}300", f"±{T}1000"),
        (0.0499, 0.0508, "0.05", f"±{T}0.10"),
        (2.34e-6, 1.1e-7, "2.34·10⁻⁶", f"±{T}0.22·10⁻⁶"),
        (3.2e7, 4e5, "3.200·10⁷", f"±{T}0.078·10⁷"),
        (0.00001, 0.5, "0.00", f"±{T}0.98"),
        (1.23456, 0.0, "1.235", ""),
        (1.23456, None, "1.235", ""),
        (float("nan"), 1.0, MISSING, ""),
    ],
)
def test_two_digits_of_the_interval_set_the_digits_of_the_value(value, std, text, half) -> None:
    assert measured(value, std) == (text, half)


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0, "0"),
        (3.14159, "3.14"),
        (-2.0, "−2.00"),
        (187.34, "187"),
        (9.999, "10.0"),
        (43210.0, f"43{T}200"),
        (1.5e9, "1.50·10⁹"),
        (2.4e-7, "2.40·10⁻⁷"),
        (9.9996e-7, "1.00·10⁻⁶"),
        (None, MISSING),
        (float("inf"), MISSING),
    ],
)
def test_a_number_has_three_digits(value: float | None, text: str) -> None:
    assert number(value) == text


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (count(4761), "4761"),  # grouped from five digits on
        (count(90001), f"90{T}001"),
        (exact(50.0, "Hz"), f"50{T}Hz"),  # the digits that a setting was given with
        (exact(166.6666667, "Hz"), f"166.667{T}Hz"),
        (p_value(3e-88), "<\N{NO-BREAK SPACE}0.0001"),
        (p_value(0.0314), "0.031"),
        (p_value(None), MISSING),
        (percent(132.4), f"132{T}%"),
        (percent(5e4), f"> 1000{T}%"),
    ],
)
def test_counts_settings_p_values_and_shares_in_figures(text: str, expected: str) -> None:
    assert text == expected


ALONE = SessionAxis()


def _thin(series: JointSeries, session: SessionAxis) -> Curves:
    """Measured, predicted and residual."""
    residual = series.measured - series.predicted
    values = (series.measured, series.predicted, residual)
    return curves(series.time, values, session, peaks_of=(series.measured, residual), buckets=700)


def _long(seconds: float = 3600.0, rate: float = 40.0) -> JointSeries:
    time = np.arange(int(seconds * rate)) / rate
    measured = np.sin(time)
    measured[77777] = 5.0
    return JointSeries("joint_1", time, measured, np.sin(time))


def test_an_hour_becomes_a_few_thousand_points_that_keep_the_peak() -> None:
    thinned = _thin(_long(), ALONE)
    assert len(thinned.time) < 3000
    assert np.nanmax(thinned.values[0]) == 5.0
    assert np.nanmax(thinned.values[2]) > 3.9
    assert (thinned.time[0], thinned.time[-1]) == (0.0, _long().time[-1])


def test_lines_are_interrupted_where_samples_do_not_count() -> None:
    time = np.array([0.0, 0.1, 0.2, 0.6, 0.7])
    thinned = _thin(JointSeries("joint_1", time, np.arange(5.0), np.zeros(5)), ALONE)
    np.testing.assert_array_equal(thinned.gaps, [[0.2, 0.6]])
    np.testing.assert_array_equal(thinned.values[0], [0.0, 1.0, 2.0, np.nan, 3.0, 4.0])


TWO = SessionAxis((SessionPart("run1", 0.0, 1.0), SessionPart("run2", 1.01, 1.0)))


def test_no_line_runs_from_one_recording_to_the_next() -> None:
    """A hundred rows a second in two recordings, with no row left out in between."""
    time = np.arange(202) / 100.0
    thinned = _thin(JointSeries("joint_1", time, np.sin(time), np.zeros(202)), TWO)
    assert list(np.flatnonzero(np.isnan(thinned.values[0]))) == [101]
    assert np.isnan(thinned.values[1][101])
    assert len(thinned.gaps) == 0  # nothing was left out between the two


_SIZES = [
    *(0.0, 5e-324, sys.float_info.min, 1e-300, 1.1e-16, 1e-9, 0.00123, 0.05, 0.0999, 0.5),
    *(1 - 2**-53, 1.0, 9.995, 99.95, 123.456, 999.5, 12345.6789, 1e7, 2.0**53 + 2, 1e22, 1e300),
    *(sys.float_info.max, math.inf, math.nan),
]
_NUMBERS = [None, *_SIZES, *(-size for size in _SIZES)]


@pytest.mark.parametrize("value", _NUMBERS)
def test_every_number_can_be_written_beside_any_uncertainty(value: float | None) -> None:
    units = [write(value, "N m") for write in (numerals.with_unit, exact)]
    alone = [*units, number(value), percent(value), p_value(value)]
    for std in _NUMBERS:
        texts = [*measured(value, std), numerals.with_digits_of(value, std), *alone]
        assert (texts[0] == MISSING) is not (value is not None and math.isfinite(value))
        assert all("nan" not in text and "inf" not in text and len(text) < 60 for text in texts)
