"""Diagnose every cell with a command, two at a time, and go on where a run was stopped.

    python -m benchmarks.withheld_effects.run --out DIR [--command "idim-iv diagnose"]

The command is called as COMMAND BAG BAG BAG --config robot.yaml --out FOLDER [--without EFFECT].
The labels are not read; their hash is noted before the first cell is diagnosed.
"""

import argparse
import json
import os
import shlex
import shutil
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from benchmarks.withheld_effects.generate import OPTIONS, SEAL

COMMAND = f"{shlex.quote(str(Path(sys.executable).with_name('idim-iv')))} diagnose"


def run(out: Path, command: str = COMMAND, *, processes: int = 2, timeout: float = 600.0) -> int:
    """Diagnose the cells that have no verdict yet; how many of them ended without one.

    Raises
    ------
    ValueError
        The labels changed since the first verdict.
    """
    digest = (out / SEAL).read_text(encoding="utf-8").split()[0]
    started = out / "diagnosis.json"
    if not started.is_file():
        started.write_text(json.dumps({"labels_sha256": digest, "command": command}) + "\n")
    if json.loads(started.read_text())["labels_sha256"] != digest:
        raise ValueError(f"{out}: the labels are not those that the diagnosis started with")
    options: dict[str, list[str]] = json.loads((out / OPTIONS).read_text(encoding="utf-8"))
    (out / "verdicts").mkdir(exist_ok=True)
    names = sorted(folder.name for folder in (out / "cells").iterdir())
    waiting = [name for name in names if not (out / "verdicts" / name / "run.json").is_file()]
    with ThreadPoolExecutor(processes) as pool:
        ended = pool.map(
            lambda name: diagnose(out, name, command, options.get(name, []), timeout), waiting
        )
        return sum(not well for well in ended)


def diagnose(out: Path, name: str, command: str, options: list[str], timeout: float) -> bool:
    """Run the command on one cell; True when it left a gap.json.

    verdicts/NAME appears when the command has ended: gap.json, run.json with seconds and memory
    and, if it failed, failure.txt with what it said. A report is not kept.
    """
    folder = out / "verdicts" / name
    making = out / ".diagnosing" / name
    shutil.rmtree(making, ignore_errors=True)
    shutil.rmtree(folder, ignore_errors=True)
    making.mkdir(parents=True)
    cell = out / "cells" / name
    bags = sorted(str(bag) for bag in cell.glob("*.mcap"))
    call = [
        *shlex.split(command),
        *bags,
        "--config",
        str(cell / "robot.yaml"),
        "--out",
        str(making),
        *options,
    ]
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    began = time.perf_counter()
    with (making / "stderr.txt").open("w+", encoding="utf-8") as stderr:
        process = subprocess.Popen(call, stdout=subprocess.DEVNULL, stderr=stderr, env=environment)
        while True:
            ended, status, used = os.wait4(process.pid, os.WNOHANG)
            late = time.perf_counter() - began > timeout
            if ended or late:
                break
            time.sleep(0.05)
        if not ended:
            process.kill()
            _, status, used = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        stderr.seek(0)
        said = "" if process.returncode == 0 else stderr.read().strip() or "no message"
    said = said if ended else f"no end after {timeout:g} s"
    (making / "stderr.txt").unlink()
    seconds, spent = time.perf_counter() - began, used.ru_utime + used.ru_stime
    well = not said and (making / "gap.json").is_file()
    if not well:
        (making / "gap.json").unlink(missing_ok=True)
        (making / "failure.txt").write_text(said or "no gap.json", encoding="utf-8")
    (making / "report.html").unlink(missing_ok=True)
    (making / "run.json").write_text(
        json.dumps(
            {"seconds": seconds, "processor_seconds": spent, "peak_MB": used.ru_maxrss / 1024.0}
        )
        + "\n"
    )
    making.rename(folder)
    print(f"{name} {seconds:.1f} s{'' if well else ', no verdict'}", flush=True)
    return well


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--command", default=COMMAND)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--timeout", type=float, default=600.0, help="seconds a cell")
    arguments = parser.parse_args()
    failed = run(
        arguments.out,
        arguments.command,
        processes=arguments.processes,
        timeout=arguments.timeout,
    )
    if failed:
        print(f"{failed} cells without a verdict", file=sys.stderr)


if __name__ == "__main__":
    main()
