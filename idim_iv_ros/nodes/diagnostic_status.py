"""One entry of /diagnostics."""

from collections.abc import Mapping

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue


def diagnostic_status(
    level: bytes, name: str, hardware: str, sentence: str, values: Mapping[str, object]
) -> DiagnosticStatus:
    """Return the entry; `values` are written as text."""
    pairs = [KeyValue(key=key, value=str(value)) for key, value in values.items()]
    return DiagnosticStatus(
        level=level, name=name, hardware_id=hardware, message=sentence, values=pairs
    )
