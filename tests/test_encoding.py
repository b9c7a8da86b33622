"""Names that are no text, and encodings that lack what is printed."""

import json
import subprocess

import pytest

from idim_iv_ros.encoding import SPELT, json_text, named, shell_command

LATIN = "b\udce9.mcap"  # as Python decodes b"b\xe9.mcap"


@pytest.mark.parametrize(
    ("text", "encoding", "expected"),
    [
        ("kg m², σ ≤ 10 %", "ascii", b"kg m2, sigma <= 10 %"),
        ("kg m², σ", "latin-1", "kg m², sigma".encode("latin-1")),
        ("wör…", "ascii", rb"w\xf6r..."),
        (LATIN, "utf-8", rb"b\xe9.mcap"),
        (LATIN, "ascii", rb"b\xe9.mcap"),
        ("n\udcc3\udcb6", "utf-8", "nö".encode()),  # decoded where the locale had no UTF-8
        ("\ud800", "utf-8", rb"\ud800"),
    ],
)
def test_what_an_encoding_lacks_is_spelt(text: str, encoding: str, expected: bytes) -> None:
    assert text.encode(encoding, SPELT) == expected


@pytest.mark.parametrize("encoding", ["utf-8", "ascii", "latin-1"])
def test_a_document_is_the_same_in_every_encoding(encoding: str) -> None:
    document = {"unit": "kg m²", "σ": [1.5, None], "name": LATIN, "clef": "𝄞"}
    read = json.loads(json_text(document, encoding=encoding).encode(encoding).decode(encoding))
    assert read == {**document, "name": r"b\xe9.mcap"}
    assert named(LATIN) == r"b\xe9.mcap"


def test_a_shell_takes_the_words_of_a_command_apart_again() -> None:
    words = ("plain", "two words", "it's", "d\udce9'\\1/wör", "x\ny")
    command = shell_command("printf", "%s\\0", *words)
    said = subprocess.run(["bash", "-c", command], capture_output=True, check=True).stdout
    assert said.split(b"\0")[:-1] == [word.encode("utf-8", "surrogateescape") for word in words]
