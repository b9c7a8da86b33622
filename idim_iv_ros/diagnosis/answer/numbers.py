"""Numbers that mean something to an engineer, from the coefficients of a term."""

import numpy as np

from idim_iv_ros.diagnosis.answer.explained import Explained
from idim_iv_ros.diagnosis.comparison.beside import Term
from idim_iv_ros.diagnosis.result import EffectParameter
from idim_iv_ros.effects.parametric_effect import Estimated, ParametricEffect


def estimates_of(term: Term) -> list[Estimated]:
    """Changes of given numbers with the deviations that they have beside all other errors."""
    return [
        Estimated(change, float(value), float(std))
        for change, value, std in zip(
            term.candidate.changes, term.coefficients, term.deviations, strict=True
        )
    ]


def numbers_of(term: Term, found: Explained) -> dict[str, EffectParameter]:
    """Parameters of a term at its shape, with their deviations."""
    effect = term.candidate.effect
    if isinstance(effect, ParametricEffect):
        joint = None if term.candidate.place is None else term.candidate.place.joint
        space = found.selection.comparison.catalogue.space
        return effect.parameters(space, joint, estimates_of(term))
    return effect.parameters(term.shape, np.asarray(term.coefficients), term.deviations)
