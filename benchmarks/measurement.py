"""Time and peak memory of one case in a process of its own, and the page that keeps them."""

import datetime
import json
import os
import platform
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

RESULTS = Path(__file__).parent / "results"
# What follows this line in a page is argument, and stays when the figures are measured again.
BY_HAND = "<!-- Written by hand: kept when the figures above are measured again. -->"


@dataclass(frozen=True)
class Measurement:
    """Seconds of the measured part and peak resident memory (bytes) of the whole process."""

    seconds: float
    peak: int
    detail: dict[str, float]


def measure(module: str, case: str, runs: int = 3) -> Measurement:
    """Run ``python -m module case`` in fresh processes; the run with the median time counts."""
    measurements = []
    for _ in range(runs):
        completed = subprocess.run(
            [sys.executable, "-m", module, case],
            check=True,
            capture_output=True,
            text=True,
            env={**os.environ, "OMP_NUM_THREADS": "2", "OPENBLAS_NUM_THREADS": "2"},
        )
        document = json.loads(completed.stdout.splitlines()[-1])
        measurements.append(Measurement(document.pop("seconds"), document.pop("peak"), document))
    return sorted(measurements, key=lambda measurement: measurement.seconds)[len(measurements) // 2]


def measure_pair(
    module: str, case: str, other: str, runs: int = 3
) -> tuple[Measurement, Measurement, float]:
    """Run two cases in turn; the medians of each, and the median of the ratios pair by pair.

    The speed of a shared machine drifts, and a pair drifts together.
    """
    pairs = [(measure(module, case, 1), measure(module, other, 1)) for _ in range(runs)]
    ratios = sorted(first.seconds / second.seconds for first, second in pairs)
    middle = runs // 2
    first = sorted((pair[0] for pair in pairs), key=lambda measurement: measurement.seconds)
    second = sorted((pair[1] for pair in pairs), key=lambda measurement: measurement.seconds)
    return first[middle], second[middle], ratios[middle]


def report_case(seconds: float, **detail: float) -> None:
    """Print what `measure` reads: the last line of a case's output."""
    status = Path("/proc/self/status").read_text()
    peak = next(line for line in status.splitlines() if line.startswith("VmHWM"))
    document = {"seconds": seconds, "peak": int(peak.split()[1]) * 1024, **detail}
    print(json.dumps(document))


def write_page(name: str, title: str, lines: list[str]) -> None:
    """Print the figures and keep them with machine, date and command."""
    cpu = next(
        (
            line.split(":", 1)[1].strip()
            for line in Path("/proc/cpuinfo").read_text().splitlines()
            if line.startswith("model name")
        ),
        platform.processor(),
    )
    head = [
        f"# {title}",
        "",
        f"- machine: {cpu}, {os.cpu_count()} cores, Python {platform.python_version()}",
        f"- date: {datetime.date.today().isoformat()}",
        f"- command: `python -m benchmarks.{name}`",
        "",
    ]
    text = "\n".join([*head, *lines, ""])
    RESULTS.mkdir(exist_ok=True)
    path = RESULTS / f"{name}.md"
    path.write_text(text + written_by_hand(path), encoding="utf-8")
    print(text)


def written_by_hand(path: Path) -> str:
    """Return what somebody wrote below the figures of a page, with a line to look at it again."""
    if not path.exists():
        return ""
    _, marker, argued = path.read_text(encoding="utf-8").partition(BY_HAND)
    if marker:
        print(f"{path.name}: read again what is written by hand, the figures above it are new")
    return f"\n{marker}{argued}" if marker else ""
