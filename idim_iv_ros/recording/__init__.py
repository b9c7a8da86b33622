"""Recordings: bags and tables in, immutable signals on a uniform grid out."""

from idim_iv_ros.recording.read import read_recordings
from idim_iv_ros.recording.recording import (
    ClockQuality,
    FrozenStretches,
    Note,
    Recording,
    Session,
    SessionPart,
    Signal,
    in_recordings,
    session_of,
)
from idim_iv_ros.recording.table import ImportSummary, import_table
from idim_iv_ros.recording.writing.write import JointTopic, write_bag

__all__ = [
    "ClockQuality",
    "FrozenStretches",
    "ImportSummary",
    "JointTopic",
    "Note",
    "Recording",
    "Session",
    "SessionPart",
    "Signal",
    "import_table",
    "in_recordings",
    "read_recordings",
    "session_of",
    "write_bag",
]
