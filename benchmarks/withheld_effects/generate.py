"""Write the cells of the benchmark: opaque folders of bags, and the labels sealed elsewhere.

    python -m benchmarks.withheld_effects.generate --subset fast --out DIR

DIR/cells/NAME/ holds robot.yaml, the URDF and recording_1.mcap to recording_3.mcap.
DIR/options.json says which cells are to be diagnosed with an effect left out.
DIR/labels.sealed.json is the truth, DIR/labels.sha256 its hash.
A run that was stopped goes on where it was.
"""

import argparse
import hashlib
import json
import os
import shutil
import time
from collections.abc import Callable, Mapping
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from benchmarks.withheld_effects.cells import MASTER_SEED, Cell, chosen_cells
from benchmarks.withheld_effects.robot import given_robot
from benchmarks.withheld_effects.session import Session, make_session
from benchmarks.withheld_effects.world import Runaway
from idim_iv_ros.recording.writing.write import JointTopic, write_bag

LABELS, SEAL, OPTIONS = "labels.sealed.json", "labels.sha256", "options.json"


def cell_name(cell: Any, master: int) -> str:
    """Twelve hexadecimal digits that tell nothing; their order is not that of the list."""
    return hashlib.sha256(f"{master}/{cell.index}".encode()).hexdigest()[:12]


def generate(
    out: Path,
    subset: str,
    *,
    master: int = MASTER_SEED,
    processes: int = 2,
    first: int | None = None,
) -> None:
    """Write all cells of a subset that are not there yet, then seal their labels.

    Names are hashes: the `first` cells by name are a random part of the subset.

    Raises
    ------
    ValueError
        `out` holds other cells, or sealed labels of other cells.
    RuntimeError
        Some cells could not be made; the others are written, and nothing is sealed.
    """
    cells = {cell_name(cell, master): cell for cell in chosen_cells(subset, master)}
    cells = {name: cells[name] for name in sorted(cells)[:first]}
    write_cells(out, cells, master=master, processes=processes)


def write_cells(
    out: Path,
    cells: Mapping[str, Any],
    *,
    master: int,
    processes: int,
    write: Callable[[Path, str, Any, int], float] | None = None,
) -> None:
    """Write these cells, by name, and seal their labels (errors as in `generate`).

    Cells whose loop runs away with the effect are left out.

    `write` writes one cell of another benchmark, as `write_cell` does.
    """
    write = write or write_cell
    (out / "cells").mkdir(parents=True, exist_ok=True)
    strangers = {folder.name for folder in (out / "cells").iterdir()} - set(cells)
    if strangers:
        raise ValueError(f"{out} holds {len(strangers)} cells of another subset or seed")
    missing = [name for name in sorted(cells) if not (out / "cells" / name).is_dir()]
    if not missing and (out / LABELS).is_file():
        return
    if (out / LABELS).is_file():
        raise ValueError(f"{out}: labels are sealed, but cells are missing; use an empty folder")
    started = time.perf_counter()
    # One thread each: the processes share the cores.
    os.environ.update(OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1")
    with ProcessPoolExecutor(processes, mp_context=get_context("spawn")) as pool:
        jobs = {pool.submit(write, out, name, cells[name], master): name for name in missing}
        failed, runaways = [], set()
        for number, job in enumerate(as_completed(jobs), start=1):
            error = job.exception()
            said = f"{jobs[job]} " + (repr(error) if error else f"{job.result():.1f} s")
            if isinstance(error, Runaway):
                runaways.add(jobs[job])
            elif error is not None:
                failed.append(said)
            elapsed = time.perf_counter() - started
            print(f"{number}/{len(missing)} {said}, {elapsed:.0f} s in all", flush=True)
    if failed:
        raise RuntimeError("cells that could not be made: " + "; ".join(failed))
    seal(out, {name: cell for name, cell in cells.items() if name not in runaways}, master)


def write_cell(out: Path, name: str, cell: Cell, master: int) -> float:
    """Write one cell and its label; the folder takes its name when it is whole. Seconds taken."""
    started = time.perf_counter()
    made = make_session(cell, master)
    making = out / ".making" / name
    shutil.rmtree(making, ignore_errors=True)
    making.mkdir(parents=True)
    given = given_robot(cell.robot)
    shutil.copyfile(given.yaml, making / "robot.yaml")
    shutil.copyfile(given.urdf, making / given.urdf.name)
    _write_bags(making, made, given.joints)
    keep(out, name, making, made.label)
    return time.perf_counter() - started


def keep(out: Path, name: str, making: Path, label: dict[str, Any]) -> None:
    """Put the label of a cell aside and give its folder its name."""
    aside = out / ".sealed" / f"{name}.json"
    aside.parent.mkdir(exist_ok=True)
    part = aside.with_suffix(f".{os.getpid()}.part")
    part.write_text(json.dumps(label), encoding="utf-8")
    part.replace(aside)
    (out / "cells").mkdir(exist_ok=True)
    making.rename(out / "cells" / name)


def _write_bags(folder: Path, made: Session, joints: tuple[str, ...]) -> None:
    for number, (record, start) in enumerate(zip(made.records, made.starts, strict=True), start=1):
        stamps = start + record.time
        write_bag(
            folder / f"recording_{number}.mcap",
            [
                JointTopic(
                    "/joint_states",
                    joints,
                    stamps,
                    record.position,
                    record.velocity,
                    record.effort,
                ),
                JointTopic(
                    "/joint_reference",
                    joints,
                    stamps,
                    record.position_reference,
                    record.velocity_reference,
                ),
            ],
        )


def seal(out: Path, cells: Mapping[str, Any], master: int) -> str:
    """Gather the labels into one file, write its SHA-256 beside it, and return the hash."""
    folder = out / ".sealed"
    labels = {
        name: json.loads((folder / f"{name}.json").read_text(encoding="utf-8"))
        for name in sorted(cells)
    }
    text = json.dumps({"master_seed": master, "cells": labels}, indent=1) + "\n"
    without = {name: getattr(cell, "without", None) for name, cell in cells.items()}
    options = {name: ["--without", effect] for name, effect in without.items() if effect}
    (out / OPTIONS).write_text(json.dumps(dict(sorted(options.items())), indent=1) + "\n")
    (out / LABELS).write_text(text, encoding="utf-8")
    digest = hashlib.sha256(text.encode()).hexdigest()
    (out / SEAL).write_text(f"{digest}  {LABELS}\n", encoding="utf-8")
    shutil.rmtree(folder)
    shutil.rmtree(out / ".making", ignore_errors=True)
    return digest


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--subset", choices=["full", "fast", "families"], default="fast")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--seed", type=int, default=MASTER_SEED)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--first", type=int, help="so many cells by name: a random part")
    arguments = parser.parse_args()
    generate(
        arguments.out,
        arguments.subset,
        master=arguments.seed,
        processes=arguments.processes,
        first=arguments.first,
    )


if __name__ == "__main__":
    main()
