"""The JSON Schemas in docs/ are those of the code."""

from pathlib import Path

import pytest

from idim_iv_ros.schemas import schema_texts

DOCS = Path(__file__).resolve().parents[1] / "docs" / "schemas"


@pytest.mark.parametrize("name", schema_texts())
def test_the_committed_schema_is_that_of_the_code(name: str) -> None:
    committed = (DOCS / name).read_text(encoding="utf-8")
    assert committed == schema_texts()[name], "python -m idim_iv_ros.schemas docs/schemas"
