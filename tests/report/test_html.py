"""Every result becomes one page that is well formed and loads nothing."""

import json
import re
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest

from idim_iv_ros.diagnosis.result.document import GapResult
from idim_iv_ros.identification.result import IdentificationResult
from idim_iv_ros.report.page import gap_report_html, report_html
from tests.report.sample_gap import CASES as DIAGNOSES
from tests.report.sample_gap import sample_gap
from tests.report.sample_result import sample_result

NASTY = """<script>alert(1)</script>&'"<b>"""
CASES = ("white", "coloured", "rejected", "untested")
EVERY = (*CASES, *DIAGNOSES)


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


def sample(case: str, joints: int, first: str = "joint_1") -> IdentificationResult | GapResult:
    if case in CASES:
        return sample_result(joints, case, first=first)
    return sample_gap(joints, case, first=first)


def page_of(result: IdentificationResult | GapResult) -> str:
    return (
        report_html(result) if isinstance(result, IdentificationResult) else gap_report_html(result)
    )


@pytest.mark.parametrize("joints", [1, 2, 7])
@pytest.mark.parametrize("case", EVERY)
def test_every_result_becomes_a_well_formed_page_that_loads_nothing(joints: int, case: str) -> None:
    result = sample(case, joints)
    text = page_of(result)
    page = Page(text)
    assert page.open == []
    assert len(page.figures) == (2 if case in CASES else 4) * joints
    answer = result.verdict.sentence if case in CASES else result.summary
    assert answer in page.text
    anchors = [attributes["id"] for _, attributes in page.elements if "id" in attributes]
    assert len(anchors) == len(set(anchors))
    for name, attributes in page.elements:
        assert name not in {"link", "iframe", "img", "base", "object", "embed"}
        assert "src" not in attributes
        if name == "a":
            assert attributes["href"][0] == "#" and attributes["href"][1:] in anchors
    styles = re.findall(r"<style>(.*?)</style>", text, re.DOTALL)
    assert not any("url(" in style or "@import" in style for style in styles)
    for words in page.words:
        assert not re.search(r"\d\.\d{6,}|\b(nan|inf|None)\b", words)
    parts = (
        [result.fit, result.processing]
        if case in CASES
        else [*result.causes, *result.where.regimes]
    )
    for field in {name for part in (result, *parts) for name in vars(part) if "_" in name}:
        assert field not in page.text


@pytest.mark.parametrize("case", EVERY)
def test_a_joint_named_like_a_script_is_only_text(case: str) -> None:
    plain, page = Page(page_of(sample(case, 2))), Page(page_of(sample(case, 2, NASTY)))
    scripts = [[name for name, _ in one.elements].count("script") for one in (plain, page)]
    assert scripts[0] == scripts[1]
    assert NASTY in page.text
    assert page.open == []


def test_the_verdict_comes_first_and_rejected_joints_carry_a_warning() -> None:
    text = Page(report_html(sample_result(3, "rejected"))).text
    assert text.index("misspecified") < text.index("Relative error")
    assert "Do not rely" in text
    assert "Do not rely" not in Page(report_html(sample_result(3, "white"))).text
    for case in ("untested", "white"):
        result = sample_result(2, case)
        assert result.exogeneity.tests[-1].reason in Page(report_html(result)).text


def _bare(result: IdentificationResult) -> IdentificationResult:
    """Everything that may be missing is missing."""
    nothing = dict.fromkeys(("essential_value", "essential_std", "given_value"))
    nothing |= {"value": 0.0, "std": np.nan, "essential": False, "expression": ""}
    none = {"accepted": None, "failures": (), "notes": (), "tests": ()}
    fit = dict.fromkeys(("relative_error_percent", "essential_p_value"), np.nan)
    residuals = [replace(one, relative_percent=None, white=None) for one in result.residuals]
    steps = {"reasons": (), "minimum_speed": (), "decimation_factors": (1,)}
    return replace(
        result,
        parameters=tuple(replace(parameter, **nothing) for parameter in result.parameters),
        instruments=replace(result.instruments, **none),
        exogeneity=replace(result.exogeneity, tests=()),
        specification=replace(result.specification, tests=()),
        residuals=tuple(residuals),
        fit=replace(result.fit, **fit, condition_number=np.inf, samples=0),
        processing=replace(result.processing, **steps),
        **{"refined": None, "bags": (), "controller": ()},
        **{key: {} for key in ("software", "configuration", "timing")},
    )


@pytest.mark.parametrize("joints", [1, 6])
def test_missing_parts_never_raise(joints: int) -> None:
    page = Page(report_html(_bare(sample_result(joints, "untested"))))
    assert page.open == []
    assert not re.search(r"\b(nan|inf|None)\b", page.text)
