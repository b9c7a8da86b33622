"""Write the cells of a seed and seal their labels; what was stopped goes on."""

import shutil
import time
from pathlib import Path

from benchmarks.hostile.cells import HostileCell, hostile_cells
from benchmarks.hostile.files import write_files
from benchmarks.hostile.session import make_session
from benchmarks.withheld_effects.generate import cell_name, keep, write_cells


def generate(out: Path, count: int, seed: int, processes: int = 1) -> None:
    """Write those of `count` cells that are not there yet, then seal their labels.

    Names begin with the place in the list, so that they are diagnosed in its order.

    Raises
    ------
    ValueError, RuntimeError
        As `benchmarks.withheld_effects.generate.write_cells`.
    """
    cells = {
        f"{cell.index:04d}_{cell_name(cell, seed)[:6]}": cell for cell in hostile_cells(count, seed)
    }
    write_cells(out, cells, master=seed, processes=processes, write=write_cell)


def write_cell(out: Path, name: str, cell: HostileCell, seed: int) -> float:
    """Write one cell and its label; the folder takes its name when it is whole. Seconds taken."""
    started = time.perf_counter()
    made = make_session(cell, seed)
    making = out / ".making" / name
    shutil.rmtree(making, ignore_errors=True)
    making.mkdir(parents=True)
    write_files(making, made, seed + cell.index)
    keep(out, name, making, made.label)
    return time.perf_counter() - started
