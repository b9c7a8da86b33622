"""What pydantic finds is said in words of the file."""

from typing import Literal

import pytest
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from idim_iv_ros.validation import first_problem


class _Part(BaseModel):
    size: int = Field(default=1, ge=1)


class _File(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True)
    rate: float = Field(default=1.0, gt=0.0, allow_inf_nan=False)
    kind: Literal["pd", "cascade"] = "pd"
    limits: list[float] = Field(default=[1.0], min_length=1, max_length=2)
    name: str = "a"
    on: bool = True
    part: _Part = _Part()


@pytest.mark.parametrize(
    ("key", "value", "needed", "given"),
    [
        ("rate", "1", "a number", "'1'"),
        ("rate", 0.0, "above 0", "0.0"),
        ("rate", float("nan"), "a finite number", "nan"),
        ("kind", "pid", "'pd' or 'cascade'", "'pid'"),
        ("limits", [], "at least 1", "0 values"),
        ("limits", [1.0, 2.0, 3.0], "at most 2", "3 values"),
        ("limits", 3, "a list", "3"),
        ("name", 5, "a text", "5"),
        ("on", 1, "true or false", "1"),
        ("part", None, "a mapping", "nothing"),
        ("part", {"size": 0}, "at least 1", "0"),
    ],
)
def test_a_wrong_value_is_named_with_its_key_and_what_is_needed(
    key: str, value: object, needed: str, given: str
) -> None:
    with pytest.raises(ValidationError) as caught:
        _File.model_validate({key: value})
    said = first_problem(caught.value)
    assert said.startswith(key)
    assert needed in said and said.endswith(f"is needed, not {given}")
    for raw in ("Input", "valid", "http", "instance", "<"):
        assert raw not in said


def test_an_unknown_key_comes_first_and_the_others_are_counted() -> None:
    with pytest.raises(ValidationError) as caught:
        _File.model_validate({"rat": 1.0, "name": 5})
    assert first_problem(caught.value) == "unknown key rat (and 1 more)"
