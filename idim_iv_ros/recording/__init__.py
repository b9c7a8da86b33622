"""Recordings: bags and tables in, immutable signals on a uniform grid out."""

from idim_iv_ros.recording.frozen import FrozenStretches
from idim_iv_ros.recording.read import read_recordings
from idim_iv_ros.recording.recording import ClockQuality, Note, Recording, Signal
from idim_iv_ros.recording.table import ImportSummary, import_table
from idim_iv_ros.recording.write import JointTopic, write_bag

__all__ = [
    "ClockQuality",
    "FrozenStretches",
    "ImportSummary",
    "JointTopic",
    "Note",
    "Recording",
    "Signal",
    "import_table",
    "read_recordings",
    "write_bag",
]
