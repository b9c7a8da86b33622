"""What to type next, as a line that can be pasted."""

import shlex
from collections.abc import Sequence
from pathlib import Path


def next_command(command: str, bags: Sequence[Path], config: Path | str, *options: str) -> str:
    """Return ``idim-iv COMMAND BAG… --config FILE OPTIONS``."""
    words = [command, *map(str, bags), "--config", str(config), *options]
    return f"idim-iv {shlex.join(words)}"
