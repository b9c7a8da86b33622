"""The table behind the probability of a cause: a logistic regression on simulated recordings.

    python -m benchmarks.calibration collect DIR --out FEATURES.json [--processes 2]
    python -m benchmarks.calibration fit FEATURES.json [...] [--anew EFFECT ...] [--write]
    python -m benchmarks.calibration check DIR [--page NAME]

DIR holds cells of `benchmarks.hostile`; `collect` goes on where it was stopped. `fit` draws the
weights to those of the table in the package, but for features that this does not have, and for
effects that the search treats otherwise now (--anew); it prints how the table does on cells that it
was not fitted to, beside the one in the package if that has the features, and with --write puts it
there.
`check` reads the answers of cells that were diagnosed with the package: what was said, and how
much was true.
"""

import argparse
import json
import sys
from concurrent.futures import ProcessPoolExecutor
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.hostile.__main__ import score
from benchmarks.hostile.judge import is_also_true, is_named, truths_of
from benchmarks.measurement import write_page
from benchmarks.withheld_effects.score import open_labels

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
PENALTY = 1.0  # of the squared weights
GROUPS = 10
EDGES = (0.0, 0.3, 0.6, 0.7, 0.8, 0.9, 0.96, 1.001)


def collect(folder: Path) -> list[dict[str, Any]]:
    """Features of every term that the search selects on one cell, and its effect and joint."""
    from idim_iv_ros.compilation import one_thread
    from idim_iv_ros.configuration import load_configuration
    from idim_iv_ros.diagnosis.diagnose import compared
    from idim_iv_ros.diagnosis.refit.refit import refitted
    from idim_iv_ros.errors import DataError
    from idim_iv_ros.identification.prepare import read_configured

    configuration = load_configuration(folder / "robot.yaml")
    bags = sorted(str(bag) for bag in folder.glob("*.mcap"))
    with one_thread():
        try:
            refit = refitted(read_configured(bags, configuration), configuration, ())
        except DataError:
            return []
        comparison = compared(refit, ())
    joints = refit.data.joints
    return [
        {
            "effect": candidate.term.key.effect,
            "joint": None if candidate.term.key.joint is None else joints[candidate.term.key.joint],
            "features": candidate.features.tolist(),
        }
        for candidate in (*comparison.effects, *comparison.numbers, *comparison.doubtful)
        if len(candidate.features) > 0
    ]


def with_truth(terms: list[dict[str, Any]], label: dict[str, Any]) -> list[dict[str, Any]]:
    """Terms that the label judges, each with whether it is true."""
    truths, also = truths_of(label), [(e["effect"], e["joint"]) for e in label["also_true"]]
    made = []
    for term in terms:
        name = (term["effect"], term["joint"])
        true = is_named(name, truths)
        if true or not is_also_true(name, also):
            made.append({**term, "true": true})
    return made


def fitted(
    x: FloatArray,
    effects: BoolArray,
    y: FloatArray,
    before: FloatArray,
    terms: int,
    anew: BoolArray,
) -> FloatArray:
    """Intercept and weights of features and of effects (1 + f + e,) of a logistic regression.

    What was learnt `before` (1 + f + e,), from so many terms, counts as if these had the features
    of the terms here (k, f). Weights that are fitted anew (1 + f + e,) are random numbers of unit
    spread, but for the intercept.
    """
    mean, spread = x.mean(axis=0), np.maximum(x.std(axis=0), 1e-9)
    table = np.column_stack([np.ones(len(x)), (x - mean) / spread, effects])
    first = 1 + x.shape[1]
    centre = before.copy()
    centre[0] += before[1:first] @ mean
    centre[1:first] *= spread
    weights = centre.copy()

    def curvature() -> tuple[FloatArray, FloatArray]:
        p = 1.0 / (1.0 + np.exp(-table @ weights))
        return p, (table * (p * (1.0 - p))[:, None]).T @ table

    penalty = terms / len(x) * curvature()[1]
    penalty[anew], penalty[:, anew] = 0.0, 0.0
    penalty += PENALTY * np.diag(np.concatenate([[0.0], np.ones(len(centre) - 1)]))
    for _ in range(100):
        p, hessian = curvature()
        slope = table.T @ (y - p) - penalty @ (weights - centre)
        step = np.linalg.solve(hessian + penalty, slope)
        weights += step
        if np.abs(step).max() < 1e-9:
            break
    weights[1:first] /= spread
    weights[0] -= weights[1:first] @ mean
    return weights


def said(weights: FloatArray, x: FloatArray, effects: BoolArray) -> FloatArray:
    """Probabilities (k,) of a fitted table."""
    odds = weights[0] + np.column_stack([x, effects]) @ weights[1:]
    return np.asarray(1.0 / (1.0 + np.exp(-odds)))


def reliability(p: FloatArray, y: FloatArray) -> list[str]:
    """Rows of a table: what was said, how often, and how much of it was true."""
    rows = ["| said, % | causes | said on average, % | true, % |", "|---|---:|---:|---:|"]
    for low, high in pairwise(EDGES):
        inside = (p >= low) & (p < high)
        if inside.any():
            rows.append(
                f"| {100 * low:.0f} to {min(100 * high, 100):.0f} | {inside.sum()} "
                f"| {100 * p[inside].mean():.0f} | {100 * y[inside].mean():.0f} |"
            )
    return rows


def fit(files: list[Path], anew: list[str], *, write: bool) -> None:
    """Fit the table, and print how tables without a tenth of the cells do on that tenth."""
    from idim_iv_ros.diagnosis.comparison import probability

    cells = {
        (file.name, name): terms
        for file in files
        for name, terms in json.loads(file.read_text()).items()
    }
    number = {name: k % GROUPS for k, name in enumerate(sorted(cells))}
    rows = [(number[name], term) for name, terms in cells.items() for term in terms]
    group = np.array([k for k, _ in rows])
    x = np.array([term["features"] for _, term in rows])
    y = np.array([float(term["true"]) for _, term in rows])
    old = probability.table()
    names = sorted({term["effect"] for _, term in rows} | set(old.effects))
    effects = np.array([[term["effect"] == name for name in names] for _, term in rows])
    kept = [0.0 if name in anew else old.effects.get(name, 0.0) for name in names]
    features = probability.FEATURES
    before = np.array([old.intercept, *(old.weights.get(name, 0.0) for name in features), *kept])
    unlearnt = [name not in old.weights for name in features]
    new = np.array([any(unlearnt), *unlearnt, *(name in anew for name in names)])
    p = np.zeros(len(y))
    for k in range(GROUPS):
        inside = group == k
        weights = fitted(x[~inside], effects[~inside], y[~inside], before, old.terms, new)
        p[inside] = said(weights, x[inside], effects[inside])
    print(f"{len(cells)} recordings, {len(y)} terms, {int(y.sum())} of them true\n")
    print("\n".join(reliability(p, y)))
    shipped = before[: 1 + len(features)], [old.effects.get(name, 0.0) for name in names]
    tables = {"anew": p}
    if not any(unlearnt):
        tables["before"] = said(np.concatenate(shipped), x, effects)
    for name, values in tables.items():
        loss = -np.mean(y * np.log(values) + (1.0 - y) * np.log(1.0 - values))
        print(f"loss of the table {name}: {loss:.4f}")
    for least in (0.5, 0.6, 0.7, 0.8):
        named = p >= least
        print(f"from {least}: {int(y[named].sum())} true, {int((1 - y[named]).sum())} false")
    weights = np.round(fitted(x, effects, y, before, old.terms, new), 4)
    offsets = dict(zip(names, weights[1 + x.shape[1] :].tolist(), strict=True))
    slopes = dict(zip(features, weights[1 : 1 + x.shape[1]].tolist(), strict=True))
    for name, weight in (*slopes.items(), *offsets.items()):
        print(f"{weight:+.3f}  {name}")
    if write:
        origin = (
            f"logistic regression on {len(y)} terms of {len(cells)} recordings of "
            f"benchmarks.hostile, after the table before it, which was a {old.origin}"
        )
        content = {
            "origin": origin,
            "terms": old.terms + len(y),
            "intercept": float(weights[0]),
            "weights": slopes,
            "effects": offsets,
        }
        path = Path(probability.__file__).with_name("probability.json")
        path.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")


def check(folder: Path, page: str | None) -> None:
    """Reliability of what was said of diagnosed cells: printed, or a page of the results."""
    claims = [
        (said, true)
        for answer in score(folder)[0].values()
        for said, true in answer.claims
        if said is not None
    ]
    p, y = (np.array(values, dtype=float) for values in zip(*claims, strict=True))
    lines = reliability(p, y)
    if page:
        write_page(page, "Probability of a cause: what was said, and what was true", lines)
    else:
        print("\n".join(lines))


def main() -> None:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    verbs = parser.add_subparsers(dest="verb", required=True)
    collecting = verbs.add_parser("collect", help="features of the terms of cells")
    collecting.add_argument("cells", type=Path)
    collecting.add_argument("--out", type=Path, required=True)
    collecting.add_argument("--processes", type=int, default=1)
    fitting = verbs.add_parser("fit", help="the table from features")
    fitting.add_argument("features", type=Path, nargs="+")
    fitting.add_argument("--anew", nargs="*", default=[], help="effects whose weight starts at 0")
    fitting.add_argument("--write", action="store_true")
    checking = verbs.add_parser("check", help="reliability of answers")
    checking.add_argument("cells", type=Path)
    checking.add_argument("--page", help="name of a page in benchmarks/results")
    given = parser.parse_args()
    if given.verb == "fit":
        fit(given.features, given.anew, write=given.write)
        return
    if given.verb == "check":
        check(given.cells, given.page)
        return
    made = json.loads(given.out.read_text()) if given.out.is_file() else {}
    labels = open_labels(given.cells)
    left = [name for name in labels if name not in made]
    with ProcessPoolExecutor(given.processes) as pool:
        folders = [given.cells / "cells" / name for name in left]
        for name, terms in zip(left, pool.map(collect, folders), strict=True):
            made[name] = with_truth(terms, labels[name])
            given.out.write_text(json.dumps(made), encoding="utf-8")
            print(f"{len(made)} of {len(labels)}", end="\r", file=sys.stderr)


if __name__ == "__main__":
    main()
