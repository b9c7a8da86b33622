"""The simulated fleet: its bags, and what the statistics make of it.

    python -m benchmarks.fleet make DIR [--robots 50] [--bags 20] [--seconds 20]
    idim-iv fleet identify DIR/manifest.csv --config DIR/arm2.yaml --out DIR/out
    python -m benchmarks.fleet score DIR DIR/out/fleet.json [--repeats 100]

`score` writes benchmarks/results/fleet.md; with the repeats of a small fleet drawn as R factors.
"""

import argparse
from pathlib import Path

from benchmarks.fleet.coverage import lines, smallest_changes
from benchmarks.fleet.make import make
from benchmarks.fleet.score import score
from benchmarks.measurement import write_page
from idim_iv_ros.fleet.result import FleetResult


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    commands = parser.add_subparsers(dest="command", required=True)
    made = commands.add_parser("make", help="simulate the bags")
    made.add_argument("out", type=Path)
    made.add_argument("--robots", type=int, default=50)
    made.add_argument("--bags", type=int, default=20)
    made.add_argument("--seconds", type=float, default=20.0)
    scored = commands.add_parser("score", help="compare a result with the truth")
    scored.add_argument("fleet", type=Path)
    scored.add_argument("result", type=Path)
    scored.add_argument("--repeats", type=int, default=100)
    given = parser.parse_args()
    if given.command == "make":
        make(given.out, robots=given.robots, bags=given.bags, seconds=given.seconds)
        return
    result = FleetResult.read(given.result)
    repeated = [*lines(given.repeats), "", *smallest_changes()] if given.repeats else []
    write_page(
        "fleet",
        "A simulated fleet",
        [
            f"{len(result.robots)} arms of two joints, {len(result.bags)} bags of 20 s at 500 Hz.",
            "",
            *score(given.fleet, result),
            "",
            "## Repeats",
            "",
            *repeated,
        ],
    )


if __name__ == "__main__":
    main()
