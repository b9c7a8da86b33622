"""An effect is one file: what others need of it they read from the registry."""

import sys
from pathlib import Path

import pytest

from idim_iv_ros import effects
from idim_iv_ros.effects import registry


def test_an_effect_is_added_by_its_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = (Path(effects.__path__[0]) / "spring.py").read_text()
    text = text.replace('name = "spring"', 'name = "rope"').replace("order = 130", "order = 5")
    (tmp_path / "rope.py").write_text(text)
    monkeypatch.setattr(effects, "__path__", [*effects.__path__, str(tmp_path)])
    names = [cause.name for cause in registry._one_of_each(registry._modules())]
    assert names.index("rope") == names.index("stribeck") - 1
    del sys.modules["idim_iv_ros.effects.rope"]
