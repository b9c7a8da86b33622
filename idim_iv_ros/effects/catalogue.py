"""The catalogue: which effects the diagnosis looks for, as the files of `effects` have them."""

from importlib import import_module
from inspect import getmembers, isabstract, isclass
from pkgutil import iter_modules

from idim_iv_ros import effects
from idim_iv_ros.effects.controller_mismatch import ControllerMismatch
from idim_iv_ros.effects.effect import Effect
from idim_iv_ros.effects.parametric_effect import ParametricEffect


def _one_of_each() -> list[Effect | ParametricEffect]:
    """Every effect that a module of the package defines, in the order that they give."""
    modules = [
        import_module(f"{effects.__name__}.{module.name}")
        for module in iter_modules(effects.__path__)
    ]
    found: list[Effect | ParametricEffect] = [
        each()
        for module in modules
        for _, each in getmembers(module, isclass)
        if each.__module__ == module.__name__
        and issubclass(each, (Effect, ParametricEffect))
        and not isabstract(each)
    ]
    return sorted(found, key=lambda effect: effect.order)


_FOUND = _one_of_each()
PARAMETRIC = tuple(effect for effect in _FOUND if isinstance(effect, ParametricEffect))
STRUCTURAL = tuple(effect for effect in _FOUND if isinstance(effect, Effect))

# Every name that a cause may have.
EFFECTS: tuple[str, ...] = (
    *(effect.name for effect in PARAMETRIC),
    *(effect.name for effect in STRUCTURAL),
    ControllerMismatch.name,
)
