"""What recorded commands hold beyond the control law: how much, and whether at certain times."""

from collections.abc import Sequence

import numpy as np

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.controller.command_regression import rms
from idim_iv_ros.diagnosis.controller.law_change import LawChange
from idim_iv_ros.types import FloatArray


def beyond_the_law(change: LawChange, joint: str, unit: str, recordings: Sequence[str]) -> str:
    """Say it in one sentence; empty where the law explains the commands.

    Parameters
    ----------
    change
        The smallest change of the law that was found, or none; with its regression.
    joint, unit
        Name, and unit of its torque.
    recordings
        Names, by number.
    """
    rest, size = change.fit.residuals[0], change.rows.size
    much = rms(change.fit)
    if much < settings.MUCH_BEYOND_LAW * size:
        return ""
    text = (
        f"the commands of {joint} hold {much:.3g} {unit} rms beyond the control law "
        f"({100.0 * much / max(size, 1e-300):.0f} % of the command)"
    )
    events = _events(change, rest, recordings)
    if events:
        text += f", most of it {events}"
    return f"{text}: no change of a gain or feedforward explains it"


def _events(change: LawChange, rest: FloatArray, recordings: Sequence[str]) -> str:
    """When it acts, where it does at certain times only; empty where it acts all the time."""
    energy = rest**2
    kurtosis = float(np.mean(energy**2) / max(float(np.mean(energy)) ** 2, 1e-300)) - 3.0
    if kurtosis < settings.LAW_EVENT_KURTOSIS:
        return ""
    large = np.flatnonzero(np.abs(rest) > settings.LAW_EVENT_SIZE * np.median(np.abs(rest)))
    if len(large) == 0:
        return ""
    time, which = change.rows.time[large], change.rows.recording[large]
    cuts = np.flatnonzero((np.diff(which) != 0) | (np.diff(time) > settings.LAW_EVENTS_APART)) + 1
    parts = np.split(large, cuts)
    parts.sort(key=lambda part: -float(energy[part].sum()))
    shown = [
        f"from {change.rows.time[part[0]]:.2f} to {change.rows.time[part[-1]]:.2f} s of "
        f"{recordings[int(change.rows.recording[part[0]])]}"
        for part in parts[: settings.LAW_MOST_EVENTS]
    ]
    more = len(parts) - len(shown)
    return ", ".join(shown) + (f" and {more} more times" if more else "")
