"""What the commands print: tables, one document, or nothing; and what they refuse to replace."""

import json
from pathlib import Path

import numpy as np
import pytest

import idim_iv_ros
from bags import simulated_arms
from idim_iv_ros.cli import output
from tests.cli.conftest import refused, write_arm


def test_json_is_all_that_is_on_stdout(run, config, bag, columns, tmp_path: Path) -> None:
    out, simulated = tmp_path / "results", tmp_path / "simulated.mcap"
    requests = {
        "identification": ("identify", bag, "--config", config(), "--out", out),
        "check": ("check", bag, "--config", config()),
        "import": ("import", tmp_path / "a.mcap", "--columns", columns),
        "simulation": ("simulate", "--config", config(), "--out", simulated, "--duration", 2),
    }
    for name, arguments in requests.items():
        done = run(*arguments, "--json", status=0)
        assert json.loads(done.out)["format"] == f"idim_iv_ros/{name}/1"
    written = json.loads((out / "result.json").read_text())
    printed = json.loads(run("identify", bag, "--config", config(), "--json").out)
    assert printed.keys() == written.keys()
    assert printed["parameters"] == written["parameters"]


def test_unusable_recording_is_a_document_with_status_one(run, config, record, tmp_path) -> None:
    position = np.column_stack([record.position[:, 0], np.full(len(record.time), 0.4)])
    still = write_arm(tmp_path / "one.mcap", record, position=position)
    done = run("check", still, "--config", config(), "--json", status=1)
    assert json.loads(done.out)["usable"] is False
    quiet = run("check", still, "--config", config(), "--quiet")
    refused(quiet, 1, "not usable", "Fv2")
    assert quiet.out == ""


def test_result_needs_somewhere_to_go(run, config, bag) -> None:
    refused(run("identify", bag, "--config", config()), 2, "--out", "--json")


def test_quiet_prints_nothing(run, config, bag, tmp_path: Path) -> None:
    done = run("identify", bag, "--config", config(), "--out", tmp_path / "r", "--quiet")
    assert (done.status, done.out, done.error) == (0, "", "")
    assert (tmp_path / "r" / "report.html").is_file()
    checked = run("check", bag, "--config", config(), "-q")
    assert (checked.status, checked.out, checked.error) == (0, "", "")


def test_progress_is_lines_where_stderr_is_no_terminal(capsys, monkeypatch) -> None:
    with output.shown_progress() as report:
        report("reading", 0.1)
        monkeypatch.setattr(output, "INTERVAL", 0.0)
        report("filtering", 0.25)
    assert capsys.readouterr().err == "0 s: filtering, 25 %\n"
    with output.shown_progress(quiet=True) as report:
        report("filtering", 0.25)
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize("width", [60, 80])
def test_tables_of_a_check_fit_the_terminal(run, config, bag, width: int) -> None:
    done = run("check", bag, "--config", config(), columns=width)
    lines = [line.rstrip() for line in done.out.splitlines()]
    assert max(map(len, lines[:-1])) <= width
    assert lines[-1].startswith("Next: idim-iv identify ")  # to be pasted: not broken


@pytest.mark.parametrize(
    ("place", "arguments"),
    [
        ("results/report.html", "identify no.mcap --out results --config arm2.yaml"),
        ("a.mcap", "simulate --out a.mcap --duration 1 --config arm2.yaml"),
        ("run.csv", "excite --out run --config arm2.yaml"),
        ("my_arm.yaml", "init no.mcap --out my_arm.yaml"),
        ("b.mcap", "import b.mcap --columns no.yaml"),
    ],
)
def test_no_command_replaces_what_it_did_not_write(
    run, config, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, place: str, arguments: str
) -> None:
    """It is refused before anything is read or computed: the inputs do not even exist."""
    monkeypatch.chdir(tmp_path)
    config()
    path = tmp_path / place
    path.parent.mkdir(exist_ok=True)
    path.write_text("mine")
    refused(run(*arguments.split()), 2, path.name, "--force")
    assert path.read_text() == "mine"


def test_edited_motion_is_kept_and_an_untouched_one_replaced(run, config, tmp_path: Path) -> None:
    design = ("excite", "--config", config(), "--out", tmp_path / "run", "--time-limit", 0.001)
    quick = ("--rate", 100, "--period", 6, "--harmonics", 3, "--repeats", 2)
    for _ in range(2):
        run(*design, *quick, status=0)
    with (tmp_path / "run.csv").open("a") as file:
        file.write("\n")
    refused(run(*design, *quick), 2, "run.csv", "--force")
    assert run(*design, *quick, "--force").status == 0


def test_functions_take_text_paths_and_one_or_many_bags(bag) -> None:
    path = simulated_arms.CONFIG / "arm2.yaml"
    configuration = idim_iv_ros.load_configuration(str(path))
    assert configuration == idim_iv_ros.load_configuration(path)
    options = {"joints": configuration.robot.joints, "reference": "/joint_reference"}
    (one,) = idim_iv_ros.read_recordings(str(bag), **options)
    (same,) = idim_iv_ros.read_recordings([bag], **options)
    np.testing.assert_array_equal(one.position.values, same.position.values)
    assert idim_iv_ros.check(str(bag), configuration) == idim_iv_ros.check((bag,), configuration)
    ours = {"estimator": "idim-ls"}
    results = [idim_iv_ros.identify(given, configuration, **ours) for given in (bag, iter([bag]))]
    results.append(idim_iv_ros.identify_recordings(one, configuration, **ours))
    assert len({tuple(number.value for number in result.parameters) for result in results}) == 1
    with pytest.raises(idim_iv_ros.UsageError, match="no bag"):
        idim_iv_ros.check([], configuration)
