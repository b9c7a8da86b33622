"""The task from cells of `benchmarks.hostile`, and our answers to it.

    python -m benchmarks.public_task publish CELLS OUT [--count 100]
    python -m benchmarks.public_task answers CELLS OUT [--count 100]
    python -m benchmarks.public_task baseline OUT

CELLS was made by `python -m benchmarks.hostile generate`. `publish` copies the recordings with
their digests into OUT and writes labels.csv beside them; `answers` turns what `benchmarks.hostile
run` left in CELLS into OUT/answers.csv; `baseline` diagnoses OUT by least squares and one ripple.
"""

import argparse
import csv
import hashlib
import json
import shutil
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from benchmarks.withheld_effects.score import open_labels

LABELS = ("recording", "group", "joints", "kind", "effect", "joint", "other_joint", "shown", "mass")
ANSWERS = ("recording", "effect", "joint", "probability", "value", "low", "high")
NORMAL_95 = 1.96


def label_rows(name: str, label: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    """Rows of labels.csv of one recording."""
    common = {"recording": name, "group": label["group"], "joints": label["joints"]}
    rows = []
    for effect in label["effects"]:
        if effect["kind"] == "outside" or effect["strength"] == 0.0:
            continue
        others = [joint for joint in effect["joints"] if joint != effect["joint"]]
        rows.append(
            {
                **common,
                "kind": "asked",
                "effect": effect["effect"],
                "joint": effect["joint"],
                "other_joint": others[0] if others else None,
                "shown": effect["rho_recorded"],
                "mass": effect["mass"],
            }
        )
    for true in label["also_true"]:
        rows.append({**common, "kind": "true", "effect": true["effect"], "joint": true["joint"]})
    yield from rows or [{**common, "kind": "none"}]


def publish(cells: Path, out: Path, count: int) -> None:
    """Copy the first recordings, and write their digests and labels.

    Raises
    ------
    ValueError
        The labels are not those that were sealed.
    """
    labels = dict(sorted(open_labels(cells).items())[:count])
    out.mkdir(parents=True, exist_ok=True)
    with (out / "sha256.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(("file", "sha256"))
        for name in labels:
            shutil.copytree(cells / "cells" / name, out / "recordings" / name, dirs_exist_ok=True)
            for path in sorted((out / "recordings" / name).iterdir()):
                digest = hashlib.sha256(path.read_bytes()).hexdigest()
                writer.writerow((path.relative_to(out).as_posix(), digest))
    _write(
        out / "labels.csv", LABELS, [r for n, label in labels.items() for r in label_rows(n, label)]
    )


def our_rows(name: str, document: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    """Rows of answers.csv from a gap.json."""
    for cause in document["causes"]:
        mass = cause["parameters"].get("mass") if cause["effect"] == "payload" else None
        row = {
            "recording": name,
            "effect": cause["effect"],
            "joint": cause["joint"],
            "probability": cause.get("probability"),
        }
        if mass is not None and mass["std"] is not None:
            half = NORMAL_95 * mass["std"]
            row |= {
                "value": mass["value"],
                "low": mass["value"] - half,
                "high": mass["value"] + half,
            }
        yield row


def answers(cells: Path, out: Path, count: int) -> None:
    """Write what the diagnosis said."""
    rows = []
    for name in sorted(open_labels(cells))[:count]:
        document = cells / "verdicts" / name / "gap.json"
        if document.is_file():
            rows += list(our_rows(name, json.loads(document.read_text(encoding="utf-8"))))
    _write(out / "answers.csv", ANSWERS, rows)


def _write(path: Path, names: Sequence[str], rows: Sequence[Mapping[str, Any]]) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, names)
        writer.writeheader()
        writer.writerows(rows)


def main() -> None:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    verbs = parser.add_subparsers(dest="verb", required=True)
    for verb in ("publish", "answers"):
        chosen = verbs.add_parser(verb)
        chosen.add_argument("cells", type=Path)
        chosen.add_argument("out", type=Path)
        chosen.add_argument("--count", type=int, default=100)
    verbs.add_parser("baseline").add_argument("out", type=Path)
    given = parser.parse_args()
    if given.verb == "publish":
        publish(given.cells, given.out, given.count)
    elif given.verb == "answers":
        answers(given.cells, given.out, given.count)
    else:
        from benchmarks.public_task.baseline import baseline_rows

        rows = [
            row
            for folder in sorted((given.out / "recordings").iterdir())
            for row in baseline_rows(folder)
        ]
        _write(given.out / "baseline.csv", ANSWERS, rows)


if __name__ == "__main__":
    main()
