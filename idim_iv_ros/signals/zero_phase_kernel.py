"""Second-order sections run forward and backward over many signals side by side, compiled.

`scipy.signal.sosfilt` filters one signal after the other, and each step of a recursion waits for
the one before. Here `LANES` signals take each step together, tile by tile, so that a tile stays in
the cache; the operations and their order are those of `sosfilt`, so that every bit is the same
down to numbers of 1e-200.
"""

from idim_iv_ros.compilation import entry, kernel
from idim_iv_ros.types import FloatArray, IntArray

LANES = 32
TILE = 64
SMALLEST = 1e-200


@entry
def forward_backward(
    sections: FloatArray,
    constant_state: FloatArray,
    lines: FloatArray,
    padding: int,
    kept: IntArray,
    work: FloatArray,
    tile: FloatArray,
    states: FloatArray,
    filtered: FloatArray,
) -> None:
    """Filter `lines` forward and backward and keep some samples, as `sosfiltfilt` with odd ends.

    Parameters
    ----------
    sections : (n_sections, 6)
    constant_state : (n_sections, 2)
        State of the filter in a signal that is 1 for ever.
    lines : (k, n)
        One signal a line.
    padding
        Samples by which each end is extended, point by point about the end.
    kept : (m,) int, increasing
        Samples that are wanted.
    work : (n + 2 padding, LANES)
        Overwritten; so are `tile`, (TILE, LANES), and `states`, (2, n_sections, LANES).
    filtered : (k, m)
        Result.
    """
    lanes, size = tile.shape[1], tile.shape[0]
    count, samples = lines.shape
    length = samples + 2 * padding
    last = samples - 1
    for first in range(0, count, lanes):
        used = min(lanes, count - first)
        for lane in range(used, lanes):
            for t in range(size):
                tile[t, lane] = 0.0
        for start in range(0, length, size):
            steps = min(size, length - start)
            for lane in range(used):
                line = lines[first + lane]
                for t in range(steps):
                    place = start + t - padding
                    if place < 0:
                        tile[t, lane] = 2.0 * line[0] - line[-place]
                    elif place > last:
                        tile[t, lane] = 2.0 * line[last] - line[2 * last - place]
                    else:
                        tile[t, lane] = line[place]
            if start == 0:
                _settle(constant_state, tile[0], states)
            _advance(sections, states, tile, steps)
            for t in range(steps):
                for lane in range(lanes):
                    work[start + t, lane] = tile[t, lane]
        wanted = len(kept) - 1
        for end in range(length, 0, -size):
            steps = min(size, end)
            for t in range(steps):
                for lane in range(lanes):
                    tile[t, lane] = work[end - 1 - t, lane]
            if end == length:
                _settle(constant_state, tile[0], states)
            _advance(sections, states, tile, steps)
            while wanted >= 0 and kept[wanted] + padding >= end - steps:
                t = end - 1 - padding - kept[wanted]
                for lane in range(used):
                    filtered[first + lane, wanted] = tile[t, lane]
                wanted -= 1


@kernel
def _settle(constant_state: FloatArray, values: FloatArray, states: FloatArray) -> None:
    """Start as if the signals had always had these values."""
    for section in range(len(constant_state)):
        for lane in range(len(values)):
            states[0, section, lane] = constant_state[section, 0] * values[lane]
            states[1, section, lane] = constant_state[section, 1] * values[lane]


@kernel
def _advance(sections: FloatArray, states: FloatArray, tile: FloatArray, steps: int) -> None:
    """Filter the first `steps` rows of the tile in place, section by section."""
    for section in range(len(sections)):
        b0, b1, b2 = sections[section, 0], sections[section, 1], sections[section, 2]
        a1, a2 = sections[section, 4], sections[section, 5]
        near, far = states[0, section], states[1, section]
        for t in range(steps):
            row = tile[t]
            for lane in range(LANES):
                given = row[lane]
                made = b0 * given + near[lane]
                near[lane] = b1 * given - a1 * made + far[lane]
                far[lane] = b2 * given - a2 * made
                row[lane] = made
        for lane in range(LANES):
            # After a signal has become zero its response decays to numbers so small that the
            # processor takes a hundred times as long for each.
            if abs(near[lane]) < SMALLEST:
                near[lane] = 0.0
            if abs(far[lane]) < SMALLEST:
                far[lane] = 0.0
