"""Processor time of a diagnosis by stage, and peak memory; beside another version of the code.

    python -m benchmarks.diagnosis_speed [--against CHECKOUT] [--pairs N] [--config YAML BAG…]

By default of 60 s of the six-joint and of the seven-joint arm at 1 kHz, simulated. Both versions
run in turn, each in a process of its own with one thread, and processor time counts: the speed of a
shared machine drifts, and a pair drifts together. Compiled kernels are in the cache (a run before
puts them there).
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from statistics import median

from benchmarks.measurement import write_page

ROOT = Path(__file__).resolve().parents[1]
SECONDS = 60
# Also run by the code before, so that it asks for what is public and nothing else.
CASE = """
import json, sys, time
from pathlib import Path
clock = time.process_time
marks = [("imports", 0.0)]
from idim_iv_ros import diagnose, load_configuration
result = diagnose(sys.argv[2:], load_configuration(sys.argv[1]),
                  progress=lambda stage, share: marks.append((stage, clock())))
ends = [*marks[1:], ("", clock())]
spent = {}
stage = "imports"
for (name, begin), (_, end) in zip(marks, ends):
    stage = name if name in result.timing else stage
    spent[stage] = spent.get(stage, 0.0) + end - begin
status = Path("/proc/self/status").read_text()
peak = next(line for line in status.splitlines() if line.startswith("VmHWM"))
causes = [f"{cause.effect} {cause.joint}" for cause in result.causes]
print(json.dumps({"spent": spent, "peak": int(peak.split()[1]) / 1024, "causes": causes}))
"""


def run(checkout: Path, configuration: Path, bags: Sequence[Path]) -> dict[str, object]:
    """Diagnose once with the code of a checkout: seconds by stage, MB, causes in their order."""
    one = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "PYTHONPATH": str(checkout)}
    ended = subprocess.run(
        [sys.executable, "-c", CASE, str(configuration), *map(str, bags)],
        check=True,
        capture_output=True,
        text=True,
        cwd=checkout,
        env={**os.environ, **one},
    )
    measured: dict[str, object] = json.loads(ended.stdout.splitlines()[-1])
    return measured


def compared(
    checkouts: Sequence[Path], configuration: Path, bags: Sequence[Path], pairs: int
) -> list[str]:
    """Lines of a table: stages, their median seconds with each version, and the median ratio."""
    for checkout in checkouts:
        run(checkout, configuration, bags)
    runs = [[run(checkout, configuration, bags) for checkout in checkouts] for _ in range(pairs)]
    stages = list(dict.fromkeys(stage for measured in runs[0] for stage in measured["spent"]))  # type: ignore[attr-defined]
    rows = {
        stage: [[measured["spent"].get(stage, 0.0) for measured in pair] for pair in runs]  # type: ignore[attr-defined]
        for stage in stages
    }
    rows["all, s"] = [[sum(measured["spent"].values()) for measured in pair] for pair in runs]  # type: ignore[attr-defined]
    rows["peak memory, MB"] = [[float(str(measured["peak"])) for measured in pair] for pair in runs]
    names = ["this version", "the other", "ratio"][: 1 if len(checkouts) == 1 else 3]
    lines = ["", f"| {configuration.stem}: stage, s | {' | '.join(names)} |"]
    lines.append("|---|" + "---|" * len(names))
    for stage, values in rows.items():
        cells = [f"{median(pair[k] for pair in values):.4g}" for k in range(len(checkouts))]
        if len(checkouts) == 2:
            cells.append(f"{median(pair[1] / max(pair[0], 1e-9) for pair in values):.2f}")
        lines.append(f"| {stage} | {' | '.join(cells)} |")
    if len(checkouts) == 2:
        same = runs[0][0]["causes"] == runs[0][1]["causes"]
        lines += ["", f"The causes and their order are {'the same' if same else 'NOT the same'}."]
    return lines


def simulated(configuration: Path, folder: Path) -> Path:
    """Record `SECONDS` of the nominal arm."""
    bag = folder / f"{configuration.stem}.mcap"
    call = [str(Path(sys.executable).with_name("idim-iv")), "simulate", "--config"]
    call += [str(configuration), "--out", str(bag), "--duration", str(SECONDS), "--force"]
    path = {"PYTHONPATH": str(ROOT)}
    subprocess.run(call, check=True, capture_output=True, env={**os.environ, **path})
    return bag


def main() -> None:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("bags", nargs="*", type=Path)
    parser.add_argument("--config", type=Path)
    parser.add_argument("--against", type=Path, help="checkout of another version")
    parser.add_argument("--pairs", type=int, default=3)
    given = parser.parse_args()
    checkouts = [ROOT, *([given.against.resolve()] if given.against else [])]
    lines = []
    with tempfile.TemporaryDirectory() as folder:
        cases = [(given.config, [bag.resolve() for bag in given.bags])] if given.config else []
        for name in () if cases else ("arm6", "arm7"):
            configuration = ROOT / "config" / f"{name}.yaml"
            cases.append((configuration, [simulated(configuration, Path(folder))]))
        for configuration, bags in cases:
            lines += compared(checkouts, configuration.resolve(), bags, given.pairs)
    print("\n".join(lines))
    if not given.config:
        write_page("diagnosis_speed", f"Diagnosis of {SECONDS} s at 1 kHz, one core", lines)


if __name__ == "__main__":
    main()
