"""What is known of a driver before its bag is read: keys of a configuration, in a file."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from idim_iv_ros.configuration import Configuration
from idim_iv_ros.configuration_file import read_mapping
from idim_iv_ros.errors import UsageError
from idim_iv_ros.first_configuration.topics import BagContents
from idim_iv_ros.signal_source import field_of, topic_of, with_field
from idim_iv_ros.validation import first_problem

SOURCES = ("joint_states", "effort", "reference", "link_states")


@dataclass(frozen=True)
class DriverPreset:
    """Keys that the drivers of one kind of robot have in common."""

    name: str
    path: Path
    # By section, as a configuration has them; sources of signals as text
    keys: Mapping[str, Mapping[str, Any]]

    def sources(self, bags: Sequence[BagContents]) -> tuple[dict[str, str], dict[str, str]]:
        """Sources of signals that every bag holds, and why the others are left out.

        A robot in a namespace has the same topics below it: ``/left/joint_states``.
        """
        sources, reasons = {}, {}
        # Of topics that every bag has.
        names = set.intersection(
            *({*bag.unreadable, *(t.name for t in bag.topics)} for bag in bags)
        )
        for key in SOURCES:
            source = self.keys.get("signals", {}).get(key)
            if source is None:
                continue
            wanted, field = topic_of(source), field_of(source)
            topics = [wanted] if wanted in names else [n for n in names if n.endswith(wanted)]
            if len(topics) == 1:
                sources[key] = topics[0] if field is None else with_field(topics[0], field)
            else:
                reasons[key] = f"{wanted} of the driver {self.name} is not in the bag"
        return sources, reasons


def driver_files() -> dict[str, Path]:
    """Files of the drivers that come with this program, by name."""
    files: dict[str, Path] = {}
    for parent in Path(__file__).resolve().parents:
        # In a checkout; installed by pip or colcon.
        for folder in (parent / "config", parent / "share" / "idim_iv_ros" / "config"):
            for path in sorted((folder / "drivers").glob("*.yaml")):
                files.setdefault(path.stem, path)
        if files:
            break
    return files


def read_driver(name: str) -> DriverPreset:
    """Read the file of a driver by its name, or one of the user by its path.

    Raises UsageError: there is none, or it holds what no configuration has.
    """
    shipped = driver_files()
    path = shipped.get(name)
    if path is None:
        if not name.endswith((".yaml", ".yml")):
            listed = ", ".join(shipped) or "none is installed"
            raise UsageError(f"no driver {name}: known are {listed}; or give a YAML file")
        path = Path(name)
    data = read_mapping(path)
    if "robot" in data:
        raise UsageError(f"{path}: a driver says nothing of the robot: leave the key robot out")
    try:
        # The robot is another one each time: one joint, so that no list can have a wrong length.
        whole = Configuration.model_validate({"robot": {"joints": ["joint"]}, **data})
    except ValidationError as error:
        raise UsageError(f"{path}: {first_problem(error)}") from error
    given = whole.model_dump(exclude_unset=True)
    return DriverPreset(path.stem, path, {k: v for k, v in given.items() if k != "robot"})
