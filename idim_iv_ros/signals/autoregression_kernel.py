"""Whitening of many columns and Burg's recursion, compiled: a search does both very often."""

from idim_iv_ros.compilation import entry
from idim_iv_ros.types import FloatArray, IntArray


@entry
def whiten_lines(
    lines: FloatArray,
    starts: IntArray,
    polynomial: FloatArray,
    start: FloatArray,
    scale: float,
    whitened: FloatArray,
) -> None:
    """Apply a prediction-error filter within each segment.

    - `lines`: (k, r), one column of rows a line
    - `starts`: (m + 1,) int, first row of each segment, and the number of rows
    - `polynomial`: (p + 1,), 1, c₁ … c_p
    - `start`: (p, p) lower triangular, whitens the first p rows of a segment
    """
    order = len(polynomial) - 1
    for k in range(len(lines)):
        line, made = lines[k], whitened[k]
        for t in range(len(line)):
            made[t] = scale * line[t]
        for lag in range(1, order + 1):
            weight = scale * polynomial[lag]
            past, now = line[: len(line) - lag], made[lag:]
            for t in range(len(now)):
                now[t] += weight * past[t]
        for m in range(len(starts) - 1):
            first = starts[m]
            for row in range(min(order, starts[m + 1] - first)):
                total = 0.0
                for column in range(row + 1):
                    total += start[row, column] * line[first + column]
                made[first + row] = scale * total


@entry
def whiten_lines_adjoint(
    lines: FloatArray,
    starts: IntArray,
    polynomial: FloatArray,
    start: FloatArray,
    scale: float,
    drawn: FloatArray,
) -> None:
    """Apply the transpose of the filter of `whiten_lines` to lines; arguments as there."""
    order = len(polynomial) - 1
    for k in range(len(lines)):
        line, made = lines[k], drawn[k]
        made[:] = 0.0
        for m in range(len(starts) - 1):
            first, end = starts[m], starts[m + 1]
            head = min(first + order, end)
            for lag in range(order + 1):
                weight = scale * polynomial[lag]
                for t in range(head, end):
                    made[t - lag] += weight * line[t]
            for row in range(head - first):
                weight = scale * line[first + row]
                for column in range(row + 1):
                    made[first + column] += weight * start[row, column]


@entry
def burg(
    forward: FloatArray,
    backward: FloatArray,
    place: IntArray,
    floor: float,
    most: float,
    reflections: FloatArray,
) -> int:
    """Write reflection coefficients and return how many there are.

    - `forward`, `backward`: (r, m), the series, twice; overwritten by its prediction errors
    - `place`: (r,) int, how many predecessors each row has in its segment
    - `floor`: energy below which nothing is left to predict
    - `most`: modulus of a reflection coefficient, at most
    """
    for step in range(1, len(reflections) + 1):
        energy, product = 0.0, 0.0
        for t in range(1, len(place)):
            if place[t] >= step:
                for m in range(forward.shape[1]):
                    ahead, behind = forward[t, m], backward[t - 1, m]
                    energy += ahead * ahead + behind * behind
                    product += ahead * behind
        if energy <= floor:
            return step - 1
        reflection = min(max(-2.0 * product / energy, -most), most)
        reflections[step - 1] = reflection
        for t in range(len(place) - 1, 0, -1):
            if place[t] >= step:
                for m in range(forward.shape[1]):
                    ahead, behind = forward[t, m], backward[t - 1, m]
                    forward[t, m] = ahead + reflection * behind
                    backward[t, m] = behind + reflection * ahead
    return len(reflections)
