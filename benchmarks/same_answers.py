"""Whether a change of the code changes an answer: the same cases before and after.

    python -m benchmarks.same_answers make CASES
    python -m benchmarks.same_answers run CASES ANSWERS [--only NAME]… [--command "idim-iv"]
    python -m benchmarks.same_answers compare BEFORE AFTER

`make` writes the cases: the 42 cells of the fast subset of `benchmarks.withheld_effects`, the
six-joint arm of the demo, a simulated seven-joint arm, and the real recordings that lie beside the
project. `run` identifies and diagnoses each; `compare` prints every number, word and length that
differs by more than 1e-6 of itself. Answers are not expected values: they show what a rebuilt part
does otherwise, and each difference wants an explanation.
"""

import argparse
import json
import os
import shlex
import shutil
import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
DATA = ROOT.parent / "shared" / "data"
COMMAND = shlex.quote(str(Path(sys.executable).with_name("idim-iv")))
# What may differ from run to run.
VOLATILE = ("timing", "software", "configuration", "bags", "session")
RELATIVE, ABSOLUTE = 1e-6, 1e-12


def make(cases: Path) -> None:
    """Write CASES/NAME/{*.mcap or *.db3, robot.yaml} for every case."""
    from benchmarks.withheld_effects.generate import generate

    generate(cases / "withheld", "fast")
    for cell in sorted((cases / "withheld" / "cells").iterdir()):
        _case(cases, f"cell_{cell.name}", cell / "robot.yaml", *sorted(cell.glob("*.mcap")))
    _case(cases, "arm6", ROOT / "config" / "arm6.yaml", ROOT / "bags" / "arm6.mcap")
    seven = cases / "withheld" / "arm7.mcap"
    subprocess.run(
        [
            *shlex.split(COMMAND),
            "simulate",
            "--config",
            str(ROOT / "config" / "arm7.yaml"),
            "--out",
            str(seven),
            "--duration",
            "20",
            "--force",
        ],
        check=True,
    )
    _case(cases, "arm7", ROOT / "config" / "arm7.yaml", seven)
    if DATA.is_dir():
        from tests.real.recordings import TX40, double_pendulum_bag, emps_bag, tx40_bag

        bags = cases / "withheld"
        _case(cases, "emps", ROOT / "config" / "emps.yaml", emps_bag(DATA, bags / "emps.mcap"))
        pendulum = double_pendulum_bag(DATA, bags / "pendulum.mcap")
        _case(cases, "double_pendulum", ROOT / "config" / "double_pendulum.yaml", pendulum)
        ur10 = DATA / "unisa_ur10" / "ur10_exciting_trajectory.db3"
        _case(cases, "ur10", ROOT / "config" / "ur10.yaml", ur10)
        yaml = bags / "tx40.yaml"
        yaml.write_text(TX40.format(urdf=DATA / "staubli_tx40" / "tx40_mdh_modified.urdf"))
        _case(cases, "tx40", yaml, tx40_bag(DATA, bags / "tx40.mcap"))


def _case(cases: Path, name: str, configuration: Path, *bags: Path) -> None:
    folder = cases / "cases" / name
    folder.mkdir(parents=True, exist_ok=True)
    call = {"config": str(configuration.resolve()), "bags": [str(bag.resolve()) for bag in bags]}
    (folder / "case.json").write_text(json.dumps(call, indent=1) + "\n")


def run(cases: Path, answers: Path, command: str, only: list[str], processes: int) -> None:
    """Identify and diagnose each case that has no answer yet."""
    names = sorted(only or (folder.name for folder in (cases / "cases").iterdir()))
    calls = [(name, verb) for name in names for verb in ("identify", "diagnose")]
    with ThreadPoolExecutor(processes) as pool:
        for _ in pool.map(lambda call: _answer(cases, answers, command, *call), calls):
            pass


def _answer(cases: Path, answers: Path, command: str, name: str, verb: str) -> None:
    folder = answers / name / verb
    if (folder / "ended.txt").is_file():
        return
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    case = json.loads((cases / "cases" / name / "case.json").read_text())
    call = [*shlex.split(command), verb, *case["bags"], "--config", case["config"]]
    one = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    ended = subprocess.run(
        [*call, "--out", str(folder)], capture_output=True, text=True, env=one, check=False
    )
    (folder / "ended.txt").write_text(f"{ended.returncode}\n{ended.stderr[-2000:]}")
    (folder / "report.html").unlink(missing_ok=True)
    print(name, verb, ended.returncode, flush=True)


def compare(before: Path, after: Path, only: list[str]) -> int:
    """Print what differs; how many answers do."""
    names = sorted(only or (folder.name for folder in before.iterdir()))
    different = 0
    for name in names:
        for verb, file in (("identify", "result.json"), ("diagnose", "gap.json")):
            old, new = before / name / verb, after / name / verb
            if not (old / "ended.txt").is_file() or not (new / "ended.txt").is_file():
                print(f"{name} {verb}: not run")
                different += 1
                continue
            lines = list(differences(_document(old / file), _document(new / file)))
            different += bool(lines)
            for line in lines[:12]:
                print(f"{name} {verb}: {line}")
            if len(lines) > 12:
                print(f"{name} {verb}: and {len(lines) - 12} more")
    print(f"{different} of {2 * len(names)} answers differ")
    return different


def _document(path: Path) -> object:
    if not path.is_file():
        return (path.parent / "ended.txt").read_text()
    document = json.loads(path.read_text())
    return {key: value for key, value in document.items() if key not in VOLATILE}


def differences(old: object, new: object, place: str = "") -> Iterator[str]:
    """Lines that say what differs between two documents."""
    if isinstance(old, dict) and isinstance(new, dict):
        for key in (*old, *(key for key in new if key not in old)):
            if key not in old or key not in new:
                yield f"{place}.{key} {'appeared' if key in new else 'is gone'}"
            else:
                yield from differences(old[key], new[key], f"{place}.{key}")
    elif isinstance(old, list) and isinstance(new, list) and len(old) == len(new):
        for k, (first, second) in enumerate(zip(old, new, strict=True)):
            yield from differences(first, second, f"{place}[{k}]")
    elif isinstance(old, float | int) and isinstance(new, float | int):
        if abs(old - new) > RELATIVE * max(abs(old), abs(new)) + ABSOLUTE:
            yield f"{place}: {old!r} → {new!r}"
    elif old != new:
        yield f"{place}: {str(old)[:160]} → {str(new)[:160]}"


def main() -> None:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("verb", choices=("make", "run", "compare"))
    parser.add_argument("folders", nargs="+", type=Path)
    parser.add_argument("--only", action="append", default=[])
    parser.add_argument("--command", default=COMMAND)
    parser.add_argument("--processes", type=int, default=2)
    given = parser.parse_args()
    if given.verb == "make":
        make(given.folders[0])
    elif given.verb == "run":
        run(*given.folders, given.command, given.only, given.processes)
    else:
        sys.exit(compare(*given.folders, given.only) > 0)


if __name__ == "__main__":
    main()
