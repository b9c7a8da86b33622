"""What the pages name is there."""

import os
import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import idim_iv_ros
from bags import simulated_arms
from idim_iv_ros import load_configuration, propose_configuration, write_configuration
from idim_iv_ros.recording.writing.write import write_bag
from tests.command_line import CommandLine, Outcome
from tests.documentation.code_blocks import PAGES, ROOT, CodeBlock, code_blocks, first_missing_line

THEORY = (ROOT / "docs" / "theory.md").read_text(encoding="utf-8")
ROWS = re.findall(r"^\| (.+?) \| (.+?) \| (.+?) \|$", THEORY, flags=re.MULTILINE)[1:]
FUNCTIONS = sorted({name for row in ROWS for name in re.findall(r"`([\w.]+)`", row[1])})
TESTS = sorted(set(re.findall(r"`(tests/[\w./]*)`", THEORY)))


def test_api_page_lists_every_public_name() -> None:
    listed = re.findall(r"^::: idim_iv_ros\.(\w+)$", (ROOT / "docs" / "api.md").read_text(), re.M)
    assert sorted(listed) == sorted(idim_iv_ros.__all__)


@pytest.mark.parametrize("name", FUNCTIONS)
def test_function_of_the_theory_is_in_its_folder(name: str) -> None:
    """The first part is a folder; the last is what it defines, or a file or folder in it."""
    folder, *_, last = name.split(".")
    base = ROOT / folder if folder == "benchmarks" else ROOT / "idim_iv_ros" / folder
    files = [base, *base.rglob("*")]
    defined = re.compile(rf"^\s*(def|class) {last}\b", flags=re.MULTILINE)
    assert base.is_dir()
    assert any(
        path.stem == last or (path.suffix == ".py" and defined.search(path.read_text("utf-8")))
        for path in files
    )


@pytest.mark.parametrize("path", TESTS)
def test_test_of_the_theory_is_there(path: str) -> None:
    assert (ROOT / path).exists()


def test_the_map_of_the_package_is_that_of_its_folders() -> None:
    pytest.importorskip("tomllib")  # Python 3.11
    from docs.package_map import PAGE, with_map

    page = PAGE.read_text(encoding="utf-8")
    assert with_map(page) == page


RUNS = {"bash", "python"}
IDIM_IV = re.compile(r"^idim-iv ((?:.*\\\n)*.*)$", flags=re.MULTILINE)
PATHS = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
SHELL = {**os.environ, "PATH": PATHS, "PYTHONPATH": str(ROOT)}
PATIENCE = 300.0  # s of computation
ARM2 = "config/arm2.yaml"
READ = {"text", "yaml", "json"}
# Blocks that need ROS, hardware, minutes or a new environment. One more is a decision.
LEFT_OUT = {"not run": 28, "slow": 12}


@pytest.fixture(scope="module")
def recordings(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The files that the pages name: recordings of a two-joint arm as bags and tables."""
    folder = tmp_path_factory.mktemp("recordings")
    for name in ("bags", "config"):
        (folder / name).symlink_to(ROOT / name)
    arm = simulated_arms.arm2(seconds=6.0, rate=500.0)
    urdf = (ROOT / "config" / "arm2.urdf").read_text(encoding="utf-8")
    (folder / "my_arm.urdf").write_text(urdf, encoding="utf-8")
    for seed in (1, 2, 3):
        record = simulated_arms.record(arm, seed)
        topics = simulated_arms.joint_topics(arm, record)
        write_bag(folder / f"run{seed}.mcap", topics, robot_description=urdf)
    table = np.column_stack([record.time, record.position, record.effort])
    header = "time,q1,q2,tau1,tau2"
    np.savetxt(folder / "run4.csv", table, delimiter=",", header=header, comments="")
    proposal = propose_configuration(folder / "run1.mcap", folder / "my_arm.urdf")
    write_configuration(proposal, folder / "my_arm.yaml")
    return folder


@pytest.fixture(scope="module")
def command_line(
    recordings: Path, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[CommandLine]:
    """`idim-iv` with all that the pages need loaded."""
    folder = tmp_path_factory.mktemp("first")
    line = CommandLine(tmp_path_factory.mktemp("logs"), columns=80)
    out, arm = ["--quiet", "--out", str(folder / "out")], ["--config", str(ROOT / ARM2)]
    try:
        assert line.warm_up(["identify", str(recordings / "run1.mcap"), *arm, *out]) == 0
        yield line
    finally:
        line.close()


def run(block: CodeBlock, folder: Path, line: CommandLine) -> None:
    """Run one block as a user would, in `folder`."""
    if block.language == "python":
        outcomes = [line.run_program(block.text, folder, seconds=PATIENCE)]
    else:
        outcomes = list(shell_outcomes(block.text, folder, line))
    place, printed = f"{block.page}:{block.line}", "".join(outcome.out for outcome in outcomes)
    for outcome in outcomes:
        assert outcome.status == 0, f"{place}\n{printed[-2000:]}\n{outcome.error[-2000:]}"
    missing = first_missing_line(block.printed, printed)
    assert missing is None, f"{place} does not print\n{missing}\nbut\n{printed}"


def shell_outcomes(text: str, folder: Path, line: CommandLine) -> Iterator[Outcome]:
    """Run `idim-iv` where its process has everything loaded, all other commands by bash."""
    for number, part in enumerate(IDIM_IV.split(text)):
        if number % 2:
            arguments = shlex.split(part.replace("\\\n", " "), comments=True)
            yield line.run(arguments, folder, seconds=PATIENCE)
        elif part.strip():
            call = ["bash", "-euo", "pipefail", "-c", part]
            ended = subprocess.run(call, cwd=folder, env=SHELL, capture_output=True, text=True)
            yield Outcome(ended.returncode, ended.stdout, ended.stderr, 0.0, 0)


def runs(page: str, *, slow: bool) -> list[CodeBlock]:
    """Blocks of a page that are run; the slow ones follow on what the others made."""
    marks = ("", "slow") if slow else ("",)
    return [b for b in code_blocks(page) if b.language in RUNS and b.mark in marks]


@pytest.fixture
def workplace(recordings: Path, tmp_path: Path) -> Path:
    """A folder with the files that the pages name."""
    shutil.copytree(recordings, tmp_path, symlinks=True, dirs_exist_ok=True)
    return tmp_path


@pytest.mark.parametrize("page", [page for page in PAGES if runs(page, slow=False)])
def test_blocks_of_a_page_run(page: str, workplace: Path, command_line: CommandLine) -> None:
    for block in runs(page, slow=False):
        run(block, workplace, command_line)


@pytest.mark.slow
@pytest.mark.parametrize(
    "page", [page for page in PAGES if runs(page, slow=True) != runs(page, slow=False)]
)
def test_slow_blocks_of_a_page_run(page: str, workplace: Path, command_line: CommandLine) -> None:
    for block in runs(page, slow=True):
        run(block, workplace, command_line)


def test_configurations_are_valid(workplace: Path) -> None:
    shown = [b for page in PAGES for b in code_blocks(page) if b.language == "yaml"]
    assert shown
    for block in shown:
        (workplace / "shown.yaml").write_text(block.text, encoding="utf-8")
        load_configuration(workplace / "shown.yaml")


@pytest.mark.parametrize("page", PAGES)
def test_every_block_is_run_or_says_why_not(page: str) -> None:
    for block in code_blocks(page):
        assert block.language in RUNS | READ, f"{page}:{block.line}"
        if block.language in RUNS and block.mark:
            assert len(block.reason.split()) >= 3, f"{page}:{block.line}"


def test_no_more_blocks_are_left_out() -> None:
    for mark, count in LEFT_OUT.items():
        left_out = [b for page in PAGES for b in code_blocks(page) if b.mark == mark]
        assert len(left_out) == count, [f"{b.page}:{b.line}" for b in left_out]


def test_what_was_not_printed_is_noticed() -> None:
    printed = "ZZ1  0.7638  kg m²\nFv1  2.695\n"
    assert first_missing_line("ZZ1 0.7641 kg m²\n…\nFv1 …", printed) is None
    assert first_missing_line("ZZ1 0.85 kg m²", printed) == "ZZ1 0.85 kg m²"
    assert first_missing_line("Fv1 2.695\nZZ1 0.7638 kg m²", printed) == "ZZ1 0.7638 kg m²"
