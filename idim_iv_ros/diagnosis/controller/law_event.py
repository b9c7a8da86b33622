"""Something that commands hold at a certain time and their law does not."""

from dataclasses import dataclass


@dataclass(frozen=True)
class LawEvent:
    """One stretch of time.

    Attributes
    ----------
    begin, end : float
        s, of the recording.
    recording : int
    size : float
        Its median, N m (N).
    energy : float
        Sum of squares over its rows.
    """

    begin: float
    end: float
    recording: int
    size: float
    energy: float
