import json
import re
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest

from idim_iv_ros.identification.result import IdentificationResult, JointSeries
from idim_iv_ros.report import report_html
from tests.report.sample_result import sample_result, with_joint_name

NASTY = """<script>alert(1)</script>&'"<b>"""
CASES = ("white", "coloured", "rejected", "untested")


class Page(HTMLParser):
    """Elements, text outside scripts, and whether every element is closed."""

    VOID = frozenset({"meta", "input", "br", "wbr"})

    def __init__(self, page: str) -> None:
        super().__init__()
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.words: list[str] = []
        self.scripts: list[str] = []
        self.open: list[str] = []
        self.feed(page)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self.open and self.open[-1] == "script":
            self.scripts.append(data)
        elif not (self.open and self.open[-1] == "style"):
            self.words.append(data)

    @property
    def text(self) -> str:
        return " ".join("".join(self.words).split())

    @property
    def figures(self) -> list[dict]:
        kinds = [attrs.get("type") for name, attrs in self.elements if name == "script"]
        pairs = zip(kinds, self.scripts, strict=True)
        return [json.loads(script) for kind, script in pairs if kind == "application/json"]


@pytest.mark.parametrize("joints", [1, 2, 6, 7])
@pytest.mark.parametrize("case", CASES)
def test_every_result_becomes_a_well_formed_page(joints: int, case: str) -> None:
    result = sample_result(joints, case)
    page = Page(report_html(result))
    assert page.open == []
    assert len(page.figures) == 3 * joints
    assert result.verdict.sentence in page.text
    anchors = [attrs["id"] for _, attrs in page.elements if "id" in attrs]
    assert len(anchors) == len(set(anchors))


def test_the_page_loads_nothing_from_anywhere() -> None:
    text = report_html(sample_result(2))
    for name, attributes in Page(text).elements:
        assert name not in {"link", "iframe", "img", "base", "object", "embed"}
        assert "src" not in attributes
        assert (attributes.get("href") or "#").startswith("#")
    styles = re.findall(r"<style>(.*?)</style>", text, re.DOTALL)
    assert not any("url(" in style or "@import" in style for style in styles)
    assert len(text.encode()) < 3_000_000


def test_every_link_of_the_page_has_its_target() -> None:
    elements = Page(report_html(sample_result(1))).elements
    anchors = {attributes.get("id") for _, attributes in elements}
    targets = [attributes["href"] for name, attributes in elements if name == "a"]
    assert targets
    assert all(target is not None and target[1:] in anchors for target in targets)


@pytest.mark.parametrize("case", CASES)
def test_a_joint_named_like_a_script_is_only_text(case: str) -> None:
    plain = Page(report_html(sample_result(2, case)))
    page = Page(report_html(with_joint_name(sample_result(2, case), NASTY)))
    names = [name for name, _ in page.elements]
    assert names.count("script") == [name for name, _ in plain.elements].count("script")
    assert "b" in names
    assert NASTY in page.text
    assert page.open == []


def test_the_verdict_comes_first_and_rejected_joints_carry_a_warning() -> None:
    text = Page(report_html(sample_result(3, "rejected"))).text
    assert text.index("misspecified") < text.index("Relative error")
    assert "Do not rely on all of these values" in text
    assert "Do not rely" not in Page(report_html(sample_result(3, "white"))).text


def test_estimates_that_whitening_moves_beyond_noise_are_named() -> None:
    result = sample_result(2, "coloured")
    assert result.refined is not None
    assert "Whitening moves" not in Page(report_html(result)).text
    result = replace(result, refined=replace(result.refined, moved=("Fv2",)))
    assert "Fv2: refined and unrefined estimate differ" in Page(report_html(result)).text


def test_a_test_that_was_not_run_is_shown_with_its_reason() -> None:
    text = Page(report_html(sample_result(2, "untested"))).text
    assert "not tested because IDIM-LS uses no instruments" in text
    text = Page(report_html(sample_result(2, "white"))).text
    assert "because the instruments reproduce the regressor, which is exogenous" in text


def test_no_number_is_shown_with_more_digits_than_it_has() -> None:
    for case in CASES:
        for words in Page(report_html(sample_result(6, case))).words:
            assert not re.search(r"\d\.\d{6,}|\b(nan|inf|None)\b", words)


def test_no_name_of_a_field_is_shown() -> None:
    result = sample_result(2, "coloured")
    text = Page(report_html(result)).text
    for field in (*vars(result), *vars(result.fit), *vars(result.processing)):
        if "_" in field:
            assert field not in text


def _bare(result: IdentificationResult) -> IdentificationResult:
    """Everything that may be missing is missing."""
    parameters = tuple(
        replace(
            each,
            value=0.0,
            std=np.nan,
            essential=False,
            essential_value=None,
            essential_std=None,
            given_value=None,
            expression="",
        )
        for each in result.parameters
    )
    return replace(
        result,
        parameters=parameters,
        refined=None,
        bags=(),
        software={},
        configuration={},
        controller=(),
        timing={},
        instruments=replace(
            result.instruments,
            accepted=None,
            failures=(),
            notes=(),
            tests=(),
        ),
        exogeneity=replace(result.exogeneity, tests=()),
        specification=replace(result.specification, tests=()),
        residuals=tuple(
            replace(each, relative_percent=None, white=None) for each in result.residuals
        ),
        fit=replace(
            result.fit,
            relative_error_percent=np.nan,
            condition_number=np.inf,
            essential_p_value=np.nan,
            samples=0,
        ),
        processing=replace(
            result.processing, reasons=(), minimum_speed=(), decimation_factors=(1,)
        ),
    )


@pytest.mark.parametrize("joints", [1, 6])
def test_missing_parts_never_raise(joints: int) -> None:
    page = Page(report_html(_bare(sample_result(joints, "untested"))))
    assert page.open == []
    assert not re.search(r"\b(nan|inf|None)\b", page.text)


@pytest.mark.parametrize("rows", [0, 1, 2])
def test_a_joint_with_hardly_a_row_never_raises(rows: int) -> None:
    result = sample_result(1, "coloured")
    few = np.arange(rows) / 50.0
    series = (JointSeries("joint_1", few, np.ones(rows), np.zeros(rows)),)
    assert Page(report_html(replace(result, series=series))).figures


def test_residuals_that_are_exactly_zero_never_raise() -> None:
    result = sample_result(1, "white")
    series = (replace(result.series[0], predicted=result.series[0].measured),)
    assert Page(report_html(replace(result, series=series))).figures
