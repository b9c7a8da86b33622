"""The section on transmissions, from results made without a recording."""

from dataclasses import replace

import numpy as np

from idim_iv_ros.diagnosis.result import EffectParameter, Transmission, TransmissionSeries
from idim_iv_ros.report.page import gap_report_html
from tests.report.sample_gap import sample_gap

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
