"""What a search costs where that can be counted: calls of the decimation filter."""

from types import SimpleNamespace

import numpy as np

from idim_iv_ros.diagnosis.refit.baseline import rows_of
from idim_iv_ros.effects.effect import Place
from idim_iv_ros.effects.position_ripple import PositionRipple
from idim_iv_ros.effects.waves import Waves


def test_a_grid_of_waves_is_filtered_in_few_calls_and_each_column_once() -> None:
    filtered: list[int] = []

    def rows(values: np.ndarray) -> np.ndarray:
        filtered.append(values.shape[1])
        return values[::5]

    position = np.linspace(-1.0, 1.0, 500)[:, None]
    kept = (np.arange(100) % 7 > 0)[:, None]
    data = SimpleNamespace(motions=[SimpleNamespace(position=position, rows=rows, kept=kept)])
    shapes = [Waves((float(number),)) for number in np.linspace(3.0, 80.0, 200)]
    made = rows_of(data, PositionRipple(), Place(0), shapes)
    assert sum(filtered) == 400
    assert len(filtered) <= 7
    for shape, columns in zip(shapes, made, strict=True):
        phase = shape.wave_numbers[0] * position[::5][kept[:, 0], 0]
        np.testing.assert_allclose(
            columns[0], np.column_stack([np.sin(phase), np.cos(phase)]), atol=1e-12
        )
