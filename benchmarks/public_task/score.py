"""Score answers to the task; the standard library of Python is all that it needs.

    python score.py answers.csv labels.csv

answers.csv: recording, effect, joint, probability (0 to 1, may be empty), value, low, high (of the
mass of a payload in kg; may be empty). One row a cause, the likeliest first; a recording without
rows is said to have nothing wrong. `joint` is empty where a cause belongs to none.

labels.csv: recording, group, joints, kind, effect, joint, other_joint, shown, mass. `kind` is
``asked`` (a cause to be found), ``true`` (right, and not asked for; an empty joint stands for any)
or ``none``. `shown` is by how much the effect stands out of the recording, in standard deviations
of its noise: asked for from 1 on.
"""

import csv
import sys
from collections import defaultdict
from collections.abc import Iterable, Mapping
from itertools import pairwise
from pathlib import Path

Row = Mapping[str, str]
ANYWHERE = ("payload", "gravity_direction")  # have no joint of their own
EDGES = (0.0, 0.5, 0.7, 0.9, 1.01)


def rows_by_recording(path: Path) -> dict[str, list[Row]]:
    """Rows of a CSV file by their recording, in their order."""
    made: dict[str, list[Row]] = defaultdict(list)
    with path.open(newline="", encoding="utf-8") as file:
        for row in csv.DictReader(file):
            made[row["recording"]].append(row)
    return made


def is_right(answer: Row, label: Row) -> bool:
    """Whether a cause is that of a label, at its joint."""
    if answer["effect"] != label["effect"]:
        return False
    anywhere = answer["effect"] in ANYWHERE or (label["kind"] == "true" and not label["joint"])
    return anywhere or answer["joint"] in (label["joint"], label["other_joint"] or label["joint"])


def scores(answers: Mapping[str, list[Row]], labels: Mapping[str, list[Row]]) -> dict[str, str]:
    """Figures of the task, as text."""
    count: dict[str, list[int]] = defaultdict(lambda: [0, 0])
    claims: list[tuple[float, bool]] = []

    def add(name: str, yes: bool) -> None:
        count[name][0] += yes
        count[name][1] += 1

    false_names = 0
    for recording, rows in labels.items():
        said = answers.get(recording, [])
        asked = [row for row in rows if row["kind"] == "asked"]
        group = rows[0]["group"]
        wrong = [a for a in said if not any(is_right(a, row) for row in rows)]
        false_names += len(wrong)
        for answer in said:
            asked_for = any(is_right(answer, row) for row in asked)
            if answer.get("probability") and (asked_for or answer in wrong):
                claims.append((float(answer["probability"]), asked_for))
        hits = [any(is_right(a, row) for a in said) for row in asked]
        if group == "none":
            add("nothing wrong, a cause named", bool(wrong))
        if group == "outside":
            add("outside the catalogue, misnamed", bool(wrong))
        if asked and all(float(row["shown"] or 0.0) >= 1.0 for row in asked):
            add(f"{_GROUPS.get(group, group)}: all found", all(hits))
            add("first cause right", bool(said) and any(is_right(said[0], row) for row in asked))
        for row in asked:
            mass = row.get("mass")
            payload = next((a for a in said if is_right(a, row) and a.get("low")), None)
            if mass and payload is not None:
                inside = float(payload["low"]) <= float(mass) <= float(payload["high"])
                add("mass of a payload inside its interval", inside)
    made = {name: _share(*pair) for name, pair in sorted(count.items())}
    made["false causes a recording"] = f"{false_names / max(len(labels), 1):.2f}"
    made |= _reliability(claims)
    return made


_GROUPS = {"single": "one effect", "parametric": "one wrong number", "pair": "two effects",
           "payload": "payload and friction"}  # fmt: skip


def _share(yes: int, of: int) -> str:
    return f"{yes}/{of} = {100 * yes / of:.0f} %"


def _reliability(claims: Iterable[tuple[float, bool]]) -> dict[str, str]:
    """Brier score of the probabilities, and how much was true of what was said with them."""
    claims = list(claims)
    if not claims:
        return {"Brier score": "no probabilities"}
    made = {"Brier score": f"{sum((p - right) ** 2 for p, right in claims) / len(claims):.3f}"}
    for low, high in pairwise(EDGES):
        inside = [right for p, right in claims if low <= p < high]
        if inside:
            name = f"said with {100 * low:.0f} to {100 * min(high, 1.0):.0f} %, true"
            made[name] = _share(sum(inside), len(inside))
    return made


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit("python score.py answers.csv labels.csv")
    given, truth = (rows_by_recording(Path(name)) for name in sys.argv[1:])
    unknown = sorted(set(given) - set(truth))
    if unknown:
        sys.exit(
            f"{sys.argv[1]}: no recording {unknown[0]}; there are {', '.join(list(truth)[:3])} …"
        )
    for what, figure in scores(given, truth).items():
        print(f"{what:45s} {figure}")
