"""The JSON Schemas of the documents: ``python -m idim_iv_ros.schemas docs/schemas``."""

import json
import sys
from pathlib import Path

from idim_iv_ros.diagnosis.result.document import GapResult
from idim_iv_ros.documents import Document
from idim_iv_ros.fleet.result import BagResult, FleetResult
from idim_iv_ros.identification.result import IdentificationResult
from idim_iv_ros.servo.result import ServoResult
from idim_iv_ros.simulators.replay_result import ReplayResult

SCHEMAS: dict[str, type[Document]] = {
    "bag.schema.json": BagResult,
    "fleet.schema.json": FleetResult,
    "gap.schema.json": GapResult,
    "replay.schema.json": ReplayResult,
    "result.schema.json": IdentificationResult,
    "servo.schema.json": ServoResult,
}


def schema_texts() -> dict[str, str]:
    """Return the content of each file by its name."""
    return {
        name: json.dumps(kind.json_schema(), indent=2, ensure_ascii=False) + "\n"
        for name, kind in SCHEMAS.items()
    }


def main(folder: Path) -> None:
    """Write the files into a folder, which is created if it does not exist."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in schema_texts().items():
        (folder / name).write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
