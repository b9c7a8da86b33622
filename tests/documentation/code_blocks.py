"""Fenced blocks of a page: what is run, what is not and why, what is said to be printed."""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PAGES = sorted(
    path.relative_to(ROOT).as_posix()
    for path in [*ROOT.glob("*.md"), *ROOT.glob("docs/*.md"), *ROOT.glob("bags/*.md")]
)
BLOCK = re.compile(r"^```(\S*)\n(.*?)^```$", flags=re.MULTILINE | re.DOTALL)
MARK = re.compile(r"<!-- (not run|slow): ([^>]+) -->\s*\Z")
NUMBER = re.compile(r"[-−]?\d+(?:\.\d+)?(?:e[-+]?\d+)?")


@dataclass(frozen=True)
class CodeBlock:
    """A block of a page.

    Attributes
    ----------
    page : str
        Relative to the repository.
    line : int
        Of the fence.
    language : str
    text : str
    mark : str
        "not run", "slow" or empty, from the comment right before the block.
    reason : str
        Of the mark.
    printed : str
        What the page says that it prints: a block of text right behind it; empty without one.
    """

    page: str
    line: int
    language: str
    text: str
    mark: str
    reason: str
    printed: str


def code_blocks(page: str) -> Iterator[CodeBlock]:
    """All fenced blocks of a page, in their order."""
    text = (ROOT / page).read_text(encoding="utf-8")
    blocks = list(BLOCK.finditer(text))
    for number, block in enumerate(blocks):
        mark = MARK.search(text[: block.start()])
        follows = blocks[number + 1] if number + 1 < len(blocks) else None
        printed = ""
        if follows and follows[1] == "text" and not text[block.end() : follows.start()].strip():
            printed = follows[2]
        yield CodeBlock(
            page=page,
            line=text.count("\n", 0, block.start()) + 1,
            language=block[1],
            text=block[2],
            mark=mark[1] if mark else "",
            reason=mark[2] if mark else "",
            printed=printed,
        )


def first_missing_line(documented: str, printed: str) -> str | None:
    """The first documented line that was not printed, or not in this order.

    An ellipsis stands for any lines, or at the end of a line for its rest. Numbers may differ by
    2 %: the last digits that are printed depend on the machine.
    """
    lines = iter(printed.splitlines())
    for wanted in documented.splitlines():
        if wanted.strip(" …") and not any(_agree(wanted, line) for line in lines):
            return wanted
    return None


def _agree(documented: str, printed: str) -> bool:
    wanted, line = (" ".join(NUMBER.sub("#", line).split()) for line in (documented, printed))
    rest = wanted.endswith("…")
    if not (line.startswith(wanted.rstrip(" …")) if rest else line == wanted):
        return False
    numbers = [
        [float(number.replace("−", "-")) for number in NUMBER.findall(line)]
        for line in (documented, printed)
    ]
    pairs = zip(*numbers, strict=not rest)
    return all(abs(a - b) <= 0.02 * max(abs(a), abs(b)) for a, b in pairs)
