"""Judge the verdicts of a diagnosis against the sealed labels.

    python -m benchmarks.withheld_effects.score --out DIR [--page NAME]

DIR as `generate` and `run` leave it: verdicts/NAME/gap.json for each cell.
"""

import argparse
import hashlib
import json
from pathlib import Path
from typing import Any

from benchmarks.measurement import write_page
from benchmarks.withheld_effects.generate import LABELS, SEAL
from benchmarks.withheld_effects.tables import page_lines
from benchmarks.withheld_effects.verdict import Scored, Verdict, judge


def open_labels(out: Path) -> dict[str, Any]:
    """Labels by cell.

    Raises
    ------
    ValueError
        The labels are not those whose hash was written before the diagnosis.
    """
    text = (out / LABELS).read_text(encoding="utf-8")
    sealed = (out / SEAL).read_text(encoding="utf-8").split()[0]
    if hashlib.sha256(text.encode()).hexdigest() != sealed:
        raise ValueError(f"{out / LABELS} is not what was sealed")
    started = out / "diagnosis.json"
    if started.is_file() and json.loads(started.read_text())["labels_sha256"] != sealed:
        raise ValueError(f"{out}: the diagnosis was made of cells with other labels")
    cells: dict[str, Any] = json.loads(text)["cells"]
    return cells


def score(out: Path) -> Scored:
    """Read every verdict and judge it (ValueError: see `open_labels`)."""
    cells, missing = {}, {}
    for name, label in open_labels(out).items():
        folder = out / "verdicts" / name
        path = folder / "gap.json"
        if not path.is_file():
            log = folder / "failure.txt"
            missing[name] = log.read_text(encoding="utf-8").strip() if log.is_file() else "not run"
            continue
        seconds = json.loads((folder / "run.json").read_text())["seconds"]
        document = json.loads(path.read_text(encoding="utf-8"))
        cells[name] = judge(label, Verdict.read(document), seconds)
    return Scored(cells, missing)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--page", help="name of a page in benchmarks/results")
    arguments = parser.parse_args()
    lines = page_lines(score(arguments.out))
    if arguments.page:
        write_page(arguments.page, "Blind benchmark: withheld effects", lines)
    else:
        print("\n".join(lines))


if __name__ == "__main__":
    main()
