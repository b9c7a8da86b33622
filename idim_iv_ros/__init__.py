"""Identification of robot dynamics from ROS 2 recordings by IDIM-IV, with its tests.

The names below are the public interface. They are imported when they are first used: reading a
bag does not load what an identification needs.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    __version__: str
    from idim_iv_ros.configuration import Configuration, load_configuration
    from idim_iv_ros.diagnosis.diagnose import diagnose
    from idim_iv_ros.diagnosis.result.document import GapResult
    from idim_iv_ros.errors import DataError, IdimError, UsageError
    from idim_iv_ros.excitation.excite import excite
    from idim_iv_ros.excitation.trajectory import Trajectory, read_trajectory
    from idim_iv_ros.first_configuration.proposal import propose_configuration, write_configuration
    from idim_iv_ros.fleet.commands import Fleet, FleetRun, diagnose_fleet, identify_fleet
    from idim_iv_ros.identification.check import CheckReport, check
    from idim_iv_ros.identification.identify import identify, identify_recordings
    from idim_iv_ros.identification.result import IdentificationResult
    from idim_iv_ros.recording.read import read_recordings
    from idim_iv_ros.recording.recording import Recording
    from idim_iv_ros.recording.table import import_table
    from idim_iv_ros.recording.writing.write import write_bag
    from idim_iv_ros.report.write import write_gap_report, write_replay_report, write_report
    from idim_iv_ros.servo.identify import identify_servos
    from idim_iv_ros.servo.result import ServoResult
    from idim_iv_ros.simulator_files.export import Exported, export
    from idim_iv_ros.simulators.replay import replay_bags
    from idim_iv_ros.simulators.replay_result import ReplayResult

__all__ = [
    "CheckReport", "Configuration", "DataError", "Exported", "Fleet", "FleetRun", "GapResult",
    "IdentificationResult", "IdimError", "Recording", "ReplayResult", "ServoResult",
    "Trajectory", "UsageError", "check", "diagnose", "diagnose_fleet", "excite", "export",
    "identify", "identify_fleet", "identify_recordings", "identify_servos", "import_table",
    "load_configuration", "propose_configuration", "read_recordings", "read_trajectory",
    "replay_bags", "write_bag", "write_configuration", "write_gap_report",
    "write_replay_report", "write_report",
]  # fmt: skip

_MODULES = {
    "configuration": ("Configuration", "load_configuration"),
    "errors": ("DataError", "IdimError", "UsageError"),
    "excitation.excite": ("excite",),
    "excitation.trajectory": ("Trajectory", "read_trajectory"),
    "simulator_files.export": ("Exported", "export"),
    "first_configuration.proposal": ("propose_configuration", "write_configuration"),
    "diagnosis.diagnose": ("diagnose",),
    "diagnosis.result.document": ("GapResult",),
    "fleet.commands": ("Fleet", "FleetRun", "diagnose_fleet", "identify_fleet"),
    "identification.identify": ("identify", "identify_recordings"),
    "recording.read": ("read_recordings",),
    "recording.recording": ("Recording",),
    "recording.table": ("import_table",),
    "recording.writing.write": ("write_bag",),
    "report.write": ("write_gap_report", "write_replay_report", "write_report"),
    "servo.identify": ("identify_servos",),
    "servo.result": ("ServoResult",),
    "simulators.replay": ("replay_bags",),
    "simulators.replay_result": ("ReplayResult",),
    "identification.result": ("IdentificationResult",),
    "identification.check": ("CheckReport", "check"),
}


def __getattr__(name: str) -> object:
    if name == "__version__":
        return import_module("importlib.metadata").version("idim-iv-ros")
    for module, names in _MODULES.items():
        if name in names:
            return getattr(import_module(f"{__name__}.{module}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
