"""A benchmark of the diagnosis that is as hostile as the world.

    python -m benchmarks.hostile generate --seed N --cells M --out DIR
    python -m benchmarks.hostile run --out DIR [--processes P] [--command "idim-iv diagnose"]
    python -m benchmarks.hostile score --out DIR [--page NAME]
    python -m benchmarks.hostile compare DIR OTHER

The first two go on where they were stopped. OTHER has the same cells, diagnosed by another version
of the code. Labels are sealed by their SHA-256 before the first diagnosis.
"""

import argparse
import json
import sys
from pathlib import Path

from benchmarks.hostile.comparison import comparison_lines
from benchmarks.hostile.judge import Answer, judge
from benchmarks.hostile.page import cell_rows, page_lines
from benchmarks.measurement import RESULTS, write_page
from benchmarks.withheld_effects.run import COMMAND, run
from benchmarks.withheld_effects.score import open_labels


def score(out: Path) -> tuple[dict[str, Answer], dict[str, str]]:
    """Judge every cell; those without an answer with the reason.

    Raises
    ------
    ValueError
        The labels are not those that were sealed before the diagnosis.
    """
    answers, missing = {}, {}
    for name, label in open_labels(out).items():
        folder = out / "verdicts" / name
        if not (folder / "gap.json").is_file():
            log = folder / "failure.txt"
            said = log.read_text(encoding="utf-8").strip() if log.is_file() else "not run"
            missing[name] = said.splitlines()[-1]
            continue
        timing = json.loads((folder / "run.json").read_text(encoding="utf-8"))
        document = json.loads((folder / "gap.json").read_text(encoding="utf-8"))
        answers[name] = judge(
            label, document, timing["processor_seconds"], timing.get("peak_MB", float("nan"))
        )
    return answers, missing


def main() -> None:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    verbs = parser.add_subparsers(dest="verb", required=True)
    making = verbs.add_parser("generate", help="write cells, seal their labels")
    making.add_argument("--seed", type=int, required=True)
    making.add_argument("--cells", type=int, required=True)
    running = verbs.add_parser("run", help="diagnose every cell")
    running.add_argument("--command", default=COMMAND)
    running.add_argument("--timeout", type=float, default=1800.0, help="seconds a cell")
    scoring = verbs.add_parser("score", help="judge the answers")
    scoring.add_argument("--page", help="name of a page in benchmarks/results")
    comparing = verbs.add_parser("compare", help="two versions of the code on the same cells")
    comparing.add_argument("first", type=Path)
    comparing.add_argument("second", type=Path)
    for command in (making, running, scoring):
        command.add_argument("--out", type=Path, required=True)
    for command in (making, running):
        command.add_argument("--processes", type=int, default=1)
    given = parser.parse_args()
    if given.verb == "generate":
        # What makes the robots needs MuJoCo and compiled code; scoring does not.
        from benchmarks.hostile.generate import generate

        generate(given.out, given.cells, given.seed, given.processes)
    elif given.verb == "run":
        failed = run(given.out, given.command, processes=given.processes, timeout=given.timeout)
        if failed:
            sys.exit(f"{failed} cells without an answer")
    elif given.verb == "compare":
        print("\n".join(comparison_lines(score(given.first)[0], score(given.second)[0])))
    else:
        answers, missing = score(given.out)
        lines = page_lines(answers, missing)
        if given.page:
            write_page(given.page, "Hostile benchmark", lines)
            rows = ",\n".join(json.dumps(row, ensure_ascii=False) for row in cell_rows(answers))
            (RESULTS / f"{given.page}_cells.json").write_text(f"[\n{rows}\n]\n", encoding="utf-8")
        else:
            print("\n".join(lines))


if __name__ == "__main__":
    main()
