"""Arguments that several commands share.

Nothing here or in the modules of the commands imports what computes or draws: `--help` and shell
completion load them all. Each command imports what it needs when it runs.
"""

import math
from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from idim_iv_ros.errors import UsageError

Bags = Annotated[
    list[Path],
    Argument(help="MCAP files, rosbag2 folders or .db3 files of one robot."),
]
Config = Annotated[
    Path, Option("--config", help="The robot's YAML file; `idim-iv init` writes a first one.")
]
Out = Annotated[Path, Option("--out", help="Folder for the results.")]
OutOrJson = Annotated[
    Path | None, Option("--out", help="Folder for the results; may be left out with --json.")
]
Force = Annotated[bool, Option("--force", help="Replace files that idim_iv_ros did not write.")]
Quiet = Annotated[bool, Option("--quiet", "-q", help="Print nothing but warnings and errors.")]
AsJson = Annotated[
    bool, Option("--json", help="Print the result as JSON, and nothing else, on stdout.")
]
Verbose = Annotated[bool, Option("--verbose", "-v", help="Print long tables whole.")]


def numbers(option: str, text: str) -> list[float]:
    """Return finite numbers from a text in which commas separate them."""
    try:
        values = [float(part) for part in text.split(",")]
    except ValueError as error:
        raise UsageError(f"{option} {text}: numbers separated by commas are needed") from error
    if not all(map(math.isfinite, values)):
        raise UsageError(f"{option} {text}: finite numbers are needed")
    return values
