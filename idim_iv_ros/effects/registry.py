"""The catalogue: every cause that a file of `effects/` defines, and what all of them declare."""

from importlib import import_module
from inspect import getmembers, isclass
from pkgutil import iter_modules
from types import ModuleType

from idim_iv_ros.effects.cause import Cause, Part
from idim_iv_ros.effects.contribution import DriveLaw, EncoderLaw, TorqueLaw
from idim_iv_ros.effects.controller_mismatch import ControllerMismatch
from idim_iv_ros.effects.effect import Effect, StructuralEffect
from idim_iv_ros.effects.parametric_effect import ParametricEffect


def catalogue() -> tuple[tuple[ModuleType, ...], tuple[Cause, ...]]:
    """Modules of this package, and their causes: parametric, then structural, in their order."""
    package = import_module("idim_iv_ros.effects")
    names = [module.name for module in iter_modules(package.__path__)]
    modules = tuple(import_module(f"{package.__name__}.{name}") for name in names)
    causes = [
        member()
        for module in modules
        for _, member in getmembers(module, isclass)
        if member.__module__ == module.__name__ and issubclass(member, Cause)
        if hasattr(member, "name")
    ]
    return modules, tuple(sorted(causes, key=lambda cause: (cause.kind, cause.order)))


# Source of all that is compiled of effects, for the key of numba's cache, and what it defines.
MODULES, CAUSES = catalogue()
BY_NAME: dict[str, Cause] = {cause.name: cause for cause in CAUSES}
PARAMETRIC = tuple(cause for cause in CAUSES if isinstance(cause, ParametricEffect))
# Another control law, which commands show; the others may explain the residual of the refit.
CONTROL_LAW = next(cause for cause in CAUSES if isinstance(cause, ControllerMismatch))
STRUCTURAL: tuple[Effect, ...] = tuple(
    cause for cause in CAUSES if isinstance(cause, StructuralEffect)
)

EFFECTS: tuple[str, ...] = tuple(BY_NAME)  # Every name that a cause may have

# What the simulator's kernel dispatches over, by place.
TORQUE_LAWS = tuple(law for cause in CAUSES for law in cause.laws if isinstance(law, TorqueLaw))
DRIVE_LAWS = tuple(law for cause in CAUSES for law in cause.laws if isinstance(law, DriveLaw))
ENCODER_LAWS = tuple(law for cause in CAUSES for law in cause.laws if isinstance(law, EncoderLaw))


def part_of(effect: str) -> Part:
    """Return what an effect changes; empty of a name that this version does not know."""
    return BY_NAME[effect].part if effect in BY_NAME else ""


def parameter_words(effect: str, name: str) -> str:
    """Return what a number of a cause is; its name without underscores where that says it."""
    cause = BY_NAME.get(effect)
    return name.replace("_", " ") if cause is None else cause.parameter_words(name)


def name_of(part: Part) -> str:
    """Return the name of the one cause that changes a part."""
    (name,) = (cause.name for cause in CAUSES if cause.part == part)
    return name
