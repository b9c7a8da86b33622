"""What pydantic finds wrong with a file, in words of the file: which key, what it needs."""

from collections.abc import Mapping

from pydantic import ValidationError
from pydantic_core import ErrorDetails

UNKNOWN = ("extra_forbidden", "unexpected_keyword_argument")
# What is needed, by the type of pydantic's error and what it knows of it.
_NEEDED = {
    "greater_than": "a number above {gt:g}",
    "greater_than_equal": "a number of at least {ge:g}",
    "less_than": "a number below {lt:g}",
    "less_than_equal": "a number of at most {le:g}",
    "finite_number": "a finite number",
    "too_short": "a list of at least {min_length}",
    "too_long": "a list of at most {max_length}",
    "string_too_short": "a text of at least {min_length}",
    "string_type": "a text (numbers and dates in quotes)",
    "literal_error": "{expected}",
    "enum": "{expected}",
    "path_type": "a path",
}
_KINDS = {
    **{"float": "a number", "int": "a whole number", "bool": "true or false", "none": "nothing"},
    **dict.fromkeys(("list", "tuple", "set", "frozen", "iterable"), "a list"),
    **dict.fromkeys(("dict", "model", "dataclass", "mapping"), "a mapping of keys"),
}


def first_problem(error: ValidationError) -> str:
    """Name the key and what is wrong with it, and how many others are wrong."""
    problems = error.errors(include_url=False)
    unknown = [problem for problem in problems if problem["type"] in UNKNOWN]
    first = (unknown or problems)[0]  # a key that is misspelled is missing, too
    more = len(problems) - 1
    return f"{_sentence(first)} (and {more} more)" if more else _sentence(first)


def _sentence(problem: ErrorDetails) -> str:
    key, kind = shortened(".".join(str(part) for part in problem["loc"])), problem["type"]
    if kind in UNKNOWN:
        return f"unknown key {key}"
    if kind == "missing":
        return f"key {key} is missing"
    where = f"{key}: " if key else ""
    if kind == "value_error":
        reason = shortened(problem["msg"].removeprefix("Value error, "))
        whole = not key or isinstance(problem["input"], Mapping | list)
        return f"{where}{reason}" if whole else f"{where}{reason}{_given(problem['input'])}"
    return f"{where}{_needed(problem)} is needed{_given(problem['input'])}"


def _needed(problem: ErrorDetails) -> str:
    words = _NEEDED.get(problem["type"]) or _KINDS.get(problem["type"].split("_")[0])
    return "another value" if words is None else words.format(**problem.get("ctx", {}))


def _given(value: object) -> str:
    """Say what was there instead; of what fills lines only its kind."""
    words = {None: "nothing", True: "true", False: "false"}
    if value is None or isinstance(value, bool):
        return f", not {words[value]}"
    if isinstance(value, str):
        return f", not '{shortened(value)}'"
    if isinstance(value, int | float):
        return f", not {shortened(str(value))}"
    if isinstance(value, Mapping):
        return ", not a mapping"
    return f", not {len(value)} values" if isinstance(value, list) else ""


def shortened(text: str) -> str:
    """Text of a file in one line that fits a message."""
    text = " ".join(text.split())
    return text if len(text) <= 120 else f"{text[:80]}…{text[-30:]}"
