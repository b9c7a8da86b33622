"""``python -m benchmarks.paper_tx40 --out DIR``: section V of the paper on a simulated TX40."""

import json
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table

from benchmarks.measurement import write_page
from benchmarks.paper_tx40.claims import CLAIMS
from benchmarks.paper_tx40.experiment import SITUATIONS, Reproduction, reproduce
from benchmarks.paper_tx40.page import page
from idim_iv_ros import write_report


def main(
    out: Annotated[Path, typer.Option(help="Folder for the bags and reports.")],
    seeds: Annotated[int, typer.Option(min=1, help="Noise seeds 1, 2, …")] = 3,
    keep: Annotated[
        bool, typer.Option("--keep", help="Write benchmarks/results/paper_tx40.md, too.")
    ] = False,
) -> None:
    """Simulate, identify, compare with the paper: about a minute for each seed."""
    console = Console(highlight=False)
    out.mkdir(parents=True, exist_ok=True)
    runs = []
    for seed in range(1, seeds + 1):
        run = reproduce(seed, out, say=console.print)
        for name in SITUATIONS:
            write_report(run.results[name], out / f"seed-{seed}" / name)
        runs.append(run)
    (out / "index.html").write_text(page(runs), encoding="utf-8")
    (out / "sentences.json").write_text(
        json.dumps(_document(runs), indent=1, ensure_ascii=False) + "\n", encoding="utf-8"
    )
    if keep:
        _keep(runs)
    console.print(_table(runs))
    console.print(f"Report: {out / 'index.html'}", soft_wrap=True)


def _document(runs: list[Reproduction]) -> list[dict[str, object]]:
    return [
        {
            "section": claim.section,
            "sentence": claim.sentence,
            "paper": claim.paper,
            "here": {str(run.seed): claim.measure(run).__dict__ for run in runs},
        }
        for claim in CLAIMS
    ]


def _keep(runs: list[Reproduction]) -> None:
    rows = []
    for claim in CLAIMS:
        outcomes = [claim.measure(run) for run in runs]
        ours = "; ".join(dict.fromkeys(outcome.ours for outcome in outcomes))
        agreeing = sum(outcome.agrees for outcome in outcomes)
        rows.append(
            f"| {claim.section} | {claim.sentence} | {claim.paper} | {ours} | "
            f"{agreeing} of {len(runs)} | {claim.remark if agreeing < len(runs) else ''} |"
        )
    write_page(
        "paper_tx40",
        f"Section V of the founding paper on a simulated TX40, {len(runs)} noise seeds",
        ["| | sentence | paper | here | holds | why not |", "|---|---|---|---|---|---|", *rows],
    )


def _table(runs: list[Reproduction]) -> Table:
    table = Table(title="Section V, sentence by sentence", title_justify="left")
    for heading in ("", "sentence", "paper", f"here (seed {runs[0].seed})", "holds"):
        table.add_column(heading)
    for claim in CLAIMS:
        outcomes = [claim.measure(run) for run in runs]
        agreeing = sum(outcome.agrees for outcome in outcomes)
        table.add_row(
            claim.section,
            claim.sentence,
            claim.paper,
            outcomes[0].ours,
            f"{agreeing} of {len(runs)}",
        )
    return table


if __name__ == "__main__":
    typer.run(main)
