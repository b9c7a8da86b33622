"""Files that this program writes: never over those of others, in one encoding, after a schema."""

import json
import os
import subprocess
from pathlib import Path

import numpy as np
import pytest

from idim_iv_ros import UsageError, write_bag, write_report
from idim_iv_ros.encoding import SPELT, json_text, named, shell_command
from idim_iv_ros.files import require_replaceable, signed, written_by_program
from idim_iv_ros.recording.writing.growing_bag import GrowingMcap
from idim_iv_ros.recording.writing.write import JointTopic
from idim_iv_ros.schemas import schema_texts
from tests.report.sample_gap import sample_gap
from tests.report.sample_result import sample_result

TOPIC = JointTopic("/joint_states", ["a"], np.arange(30) / 10.0, np.ones((30, 1)))


def foreign_mcap(path: Path) -> None:
    """A bag of another program."""
    from mcap.writer import Writer

    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start(profile="ros2", library="rosbag2")
        writer.finish()


def test_reports_and_bags_of_this_program_are_its_own(tmp_path: Path) -> None:
    files = [*write_report(sample_result(1), tmp_path / "results")]
    files += write_report(sample_gap(2, "none"), tmp_path / "why")
    write_bag(tmp_path / "a.mcap", [TOPIC])
    (tmp_path / "arm.yaml").write_text(signed("robot: {}\n"))
    for path in (*files, tmp_path / "a.mcap", tmp_path / "arm.yaml"):
        assert written_by_program(path), path


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("result.json", '{"format": "somebody/else/1"}'),
        ("result.json", "not json"),
        ("result.json", "[" * 100_000),
        ("report.html", "<html><head><title>mine</title></head></html>"),
        ("a.mcap", "not a bag"),
        ("run.csv", "time,joint_1.position\n0,0\n"),
        ("arm.yaml", "robot:\n  joints: [a]\n"),
        ("arm.yaml", signed("robot: {}\n") + "# my change\n"),
        ("arm.yaml", signed("robot: {}\n").replace("robot", "Robot")),
        ("notes", "mine"),
    ],
)
def test_files_of_somebody_else_are_refused_unless_forced(tmp_path, name, text) -> None:
    path = tmp_path / name
    path.write_text(text)
    with pytest.raises(UsageError, match=r"--force") as refusal:
        require_replaceable([path])
    assert str(path) in str(refusal.value)
    require_replaceable([path], force=True)
    assert path.read_text() == text


def test_bags_of_other_programs_and_of_a_recorder_are_refused(tmp_path: Path) -> None:
    foreign_mcap(tmp_path / "rosbag2.mcap")
    GrowingMcap(tmp_path / "recorded.mcap").close()
    for path in tmp_path.iterdir():
        before = path.read_bytes()
        with pytest.raises(UsageError, match="--force"):
            write_bag(path, [TOPIC])
        assert path.read_bytes() == before


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (os.mkfifo, "is a device, a pipe or a socket"),
        (os.mkdir, "is a folder"),
        (lambda path: path.symlink_to("/dev/null"), "is a device, a pipe or a socket"),
        (lambda path: path.symlink_to("/nowhere/at/all"), "is a link that leads nowhere"),
        (lambda path: path.symlink_to(path.name), "cannot be written"),
    ],
)
@pytest.mark.parametrize("name", ["a.mcap", "result.json"])
def test_nothing_but_a_file_is_ever_replaced(tmp_path: Path, make, words: str, name: str) -> None:
    make(tmp_path / name)
    before = (tmp_path / name).lstat().st_ino
    for force in (False, True):
        with pytest.raises(UsageError, match=words):
            require_replaceable([tmp_path / name], force=force)
    with pytest.raises(UsageError, match=words):
        write_bag(tmp_path / name, [TOPIC], force=True)
    assert (tmp_path / name).lstat().st_ino == before


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


DOCS = Path(__file__).resolve().parents[1] / "docs" / "schemas"


@pytest.mark.parametrize("name", schema_texts())
def test_the_committed_schema_is_that_of_the_code(name: str) -> None:
    committed = (DOCS / name).read_text(encoding="utf-8")
    assert committed == schema_texts()[name], "python -m idim_iv_ros.schemas docs/schemas"
