"""The simulated fleet.

python -m benchmarks.fleet make DIR [--robots 50] [--bags 20] [--seconds 20]
"""

import argparse
from pathlib import Path

from benchmarks.fleet.make import make


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    commands = parser.add_subparsers(dest="command", required=True)
    made = commands.add_parser("make", help="simulate the bags")
    made.add_argument("out", type=Path)
    made.add_argument("--robots", type=int, default=50)
    made.add_argument("--bags", type=int, default=20)
    made.add_argument("--seconds", type=float, default=20.0)
    given = parser.parse_args()
    make(given.out, robots=given.robots, bags=given.bags, seconds=given.seconds)


if __name__ == "__main__":
    main()
