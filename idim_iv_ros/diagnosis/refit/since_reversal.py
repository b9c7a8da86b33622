"""How far a joint has moved since it last turned."""

import numpy as np

from idim_iv_ros.types import FloatArray


def since_reversal(position: FloatArray, velocity: FloatArray, slowest: float) -> FloatArray:
    """Path since the last reversal (since the start, before the first): (s,) rad (m).

    Parameters
    ----------
    position, velocity
        (s,) rad, rad/s.
    slowest
        A joint has turned once it is faster than this the other way: noise does not turn it.
    """
    path = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(position)))])
    ways = np.where(np.abs(velocity) >= slowest, np.sign(velocity), 0.0)
    moving = np.flatnonzero(ways)
    turned = moving[1:][np.diff(ways[moving]) != 0.0]
    # The joint stood at its turning point when the speed crossed zero, a little before.
    crossing = np.flatnonzero(np.diff(np.sign(velocity)) != 0.0) + 1
    if len(crossing) and len(turned):
        turned = crossing[np.maximum(np.searchsorted(crossing, turned, side="right") - 1, 0)]
    starts = np.concatenate([[0], turned]).astype(np.int64)
    last = starts[np.searchsorted(starts, np.arange(len(position)), side="right") - 1]
    return np.asarray(path - path[last])
