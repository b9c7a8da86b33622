"""What changed between two sets of recordings: the whole of `diagnose --against`."""

from collections.abc import Collection, Sequence

import numpy as np
from scipy.stats import chi2

from idim_iv_ros.configuration import Configuration
from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.against import words
from idim_iv_ros.diagnosis.against.blocks import block_errors, time_blocks_of
from idim_iv_ros.diagnosis.against.law import (
    LawDifference,
    ShiftDifference,
    law_differences,
    shift_difference,
)
from idim_iv_ros.diagnosis.against.parameters import (
    ParametricDifference,
    ParametricDifferences,
    beside_effects,
    parametric_differences,
    with_own_parameters_beside,
)
from idim_iv_ros.diagnosis.against.scoped import plain_name, scope_of
from idim_iv_ros.diagnosis.against.sets import TwoSets, two_sets
from idim_iv_ros.diagnosis.against.structural import (
    StructuralDifference,
    StructuralOutcome,
    structural_differences,
)
from idim_iv_ros.diagnosis.result import (
    ContrastCause,
    ContrastResult,
    EffectParameter,
    Evidence,
    Indistinguishable,
    JointContrast,
    JointTorque,
)
from idim_iv_ros.diagnosis.structural.deviations import parameters_of
from idim_iv_ros.diagnosis.structural.likelihood import Fit
from idim_iv_ros.diagnosis.structural.nonparametric import Nonparametric
from idim_iv_ros.effects.controller_mismatch import ControllerMismatch
from idim_iv_ros.effects.registry import PARAMETRIC
from idim_iv_ros.effects.time_delay import TimeDelay
from idim_iv_ros.progress import Progress
from idim_iv_ros.recording import Recording
from idim_iv_ros.types import FloatArray, IntArray


def contrasted(
    reference: Sequence[Recording],
    against: Sequence[Recording],
    configuration: Configuration,
    without: Collection[str] = (),
    progress: Progress | None = None,
) -> ContrastResult:
    """Say what changed from the reference recordings to the others.

    Base parameters and effects that both sets share are fitted to both, so that errors of the
    nominal model cancel.

    Parameters
    ----------
    without
        Effects that are left out of the catalogue.

    Raises
    ------
    UsageError, DataError
        As `identify`, for each set.
    """
    sets = two_sets(reference, against, configuration)
    blocks = time_blocks_of(sets.data, len(sets.sets[0].motions))
    structural = structural_differences(sets, without, blocks, progress)
    catalogue = [effect for effect in PARAMETRIC if effect.name not in without]
    parametric = parametric_differences(sets, structural, catalogue, blocks)
    law, why_no_law = law_differences(sets, without)
    shift = shift_difference(sets)
    return _Assembly(sets, blocks, structural, parametric, law, shift).result(why_no_law)


class _Assembly:
    """The result from what the steps found."""

    def __init__(
        self,
        sets: TwoSets,
        blocks: Sequence[IntArray],
        structural: StructuralOutcome,
        parametric: ParametricDifferences,
        law: Sequence[LawDifference],
        shift: ShiftDifference,
    ) -> None:
        self._sets, self._data, self._blocks = sets, sets.data, blocks
        self._structural, self._parametric = structural, parametric
        self._law, self._shift = law, shift
        self._model = with_own_parameters_beside(
            sets, beside_effects(sets, structural), sets.second
        )
        self._fit: Fit = self._model.fit(structural.fit.noise_models)
        self._bags = [part.bag for part in self._data.prepared.session.parts]
        second = [
            rows.torque[inside] for rows, inside in zip(self._data.rows, sets.inside, strict=True)
        ]
        self._sizes = [max(float(np.sqrt(np.mean(torque**2))), 1e-300) for torque in second]

    def result(self, why_no_law: str) -> ContrastResult:
        """Build it."""
        causes = [
            *self._structural_causes(),
            *(self._parametric_cause(each) for each in self._parametric.differences),
            *(self._law_cause(each) for each in self._law),
            *self._delay(),
        ]
        causes.sort(
            key=lambda cause: -max((each.share_of_torque for each in cause.torques), default=0.0)
        )
        joints = self._joints()
        unattributed = tuple(self._unattributed(each) for each in self._structural.unattributed)
        differs = bool(causes or unattributed or self._parametric.rejected)
        unexplained = [
            each
            for joint, each in enumerate(joints)
            if differs and each.unexplained >= settings.CONTRAST_LEAST_SHARE * self._sizes[joint]
        ]
        first = len(self._sets.sets[0].motions)
        reference, against = tuple(self._bags[:first]), tuple(self._bags[first:])
        return ContrastResult(
            reference=reference,
            against=against,
            differs=differs,
            test=self._parametric.test.hypothesis,
            sentence=words.summary(
                self._data,
                against,
                causes,
                unattributed,
                unexplained,
                joints,
                differs=differs,
                closest=self._parametric.closest,
            ),
            joints=tuple(joints),
            causes=tuple(causes),
            unattributed=unattributed,
            common=tuple(
                words.common(self._data, each.candidate) for each in self._structural.common
            ),
            effort_shift={"reference": self._shift.reference, "against": self._shift.against},
            notes=tuple(note for note in self._notes(why_no_law) if note),
        )

    def _notes(self, why_no_law: str) -> list[str]:
        groups = [[self._bags[number] for number in group] for group in self._parametric.groups]
        apart = [self._bags[number] for number in self._parametric.reference_disagrees]
        return [
            words.shift(self._shift),
            *words.softened(self._sets.softened, self._data.joints),
            words.groups(groups),
            words.reference_disagrees(apart),
            why_no_law,
        ]

    def _structural_causes(self) -> list[ContrastCause]:
        found = self._structural.differences
        blocks = {(each.effect, each.found.candidate.place) for each in found}
        return [
            self._structural_cause(
                [each for each in found if (each.effect, each.found.candidate.place) == key]
            )
            for key in sorted(blocks, key=lambda key: (key[0], key[1].joint))
        ]

    def _structural_cause(self, parts: Sequence[StructuralDifference]) -> ContrastCause:
        """One cause of an effect that one set has, or that the sets have otherwise."""
        data, (first, *_) = self._data, parts
        place = first.found.candidate.place
        joint = data.joints[place.joint]
        numbers: dict[str, dict[str, EffectParameter]] = {"reference": {}, "against": {}}
        for each in parts:
            numbers[each.scope] = data.in_units_at(place.joint, self._numbers(each))
        shared = any(
            (each.candidate.effect.name, each.candidate.place) == (first.effect, place)
            for each in self._structural.common
        )
        change = (
            "changed"
            if shared or len(parts) > 1
            else ("appeared" if first.scope == "against" else "vanished")
        )
        parameters = numbers["against"] or numbers["reference"]
        if len(parts) > 1:
            parameters = _difference(numbers["against"], numbers["reference"])
        statistic = sum(2.0 * each.found.candidate.gain for each in parts)
        degrees = sum(each.found.candidate.numbers for each in parts)
        gains = np.concatenate([each.gains for each in parts])
        others = tuple(
            Indistinguishable(plain_name(other.effect.name), data.joints[other.place.joint], value)
            for each in parts
            for other, value in each.found.indistinguishable_from
            if not isinstance(other.effect, Nonparametric)
            and scope_of(other.effect.name) == each.scope
        )
        torques = self._taken(parts, joint)
        return ContrastCause(
            effect=first.effect,
            kind="structural",
            joint=joint,
            other_joint=None if place.other is None else data.joints[place.other],
            change=change,  # type: ignore[arg-type]
            bags=tuple(self._bags[number] for number in sorted(self._sets.second)),
            parameters=parameters,
            reference=numbers["reference"],
            against=numbers["against"],
            evidence=Evidence(
                statistic,
                min(1.0, self._structural.tried * float(chi2.sf(statistic, degrees))),
                None,
                _positive(gains),
            ),
            indistinguishable_from=others,
            torques=torques,
            sentence=words.structural(data, first, change, numbers, torques, others),
        )

    def _numbers(self, difference: StructuralDifference) -> dict[str, EffectParameter]:
        start = self._start(difference)
        found = parameters_of(self._data, self._model, self._fit, difference.found.candidate, start)
        return found

    def _start(self, difference: StructuralDifference) -> int:
        """Place of its first coefficient among those that were added."""
        return next(
            int(sum(self._model.widths[:place]))
            for place, block in enumerate(self._model.added)
            if block is difference.found.candidate.columns
        )

    def _taken(self, parts: Sequence[StructuralDifference], own: str) -> tuple[JointTorque, ...]:
        """What they take of the residual of their sets on blocks that were not fitted."""
        return self._of_joints(
            [max(each) for each in zip(*(part.torques for part in parts), strict=True)], own
        )

    def _made(self, torques: Sequence[FloatArray], own: str | None) -> tuple[JointTorque, ...]:
        """RMS of torques (r_j,) over the rows on which they act."""
        acting = [each[each != 0.0] for each in torques]
        return self._of_joints(
            [float(np.sqrt(np.mean(each**2))) if len(each) else 0.0 for each in acting], own
        )

    def _of_joints(self, torques: Sequence[float], own: str | None) -> tuple[JointTorque, ...]:
        """Joints where a torque matters, their own first."""
        found = [
            JointTorque(name, torque, torque / size)
            for name, torque, size in zip(self._data.joints, torques, self._sizes, strict=True)
            if name == own or torque >= settings.CONTRAST_LEAST_SHARE * size
        ]
        return tuple(sorted(found, key=lambda each: (each.joint != own, -each.share_of_torque)))

    def _parametric_cause(self, difference: ParametricDifference) -> ContrastCause:
        cause = difference.cause
        torques = self._made(difference.torques, cause.joint)
        bags = tuple(self._bags[number] for number in difference.recordings)
        place = None if cause.joint is None else self._data.joints.index(cause.joint)
        parameters = (
            cause.parameters if place is None else self._data.in_units_at(place, cause.parameters)
        )
        return ContrastCause(
            effect=cause.effect.name,
            kind="parametric",
            joint=cause.joint,
            change="changed",
            bags=bags,
            parameters=parameters,
            evidence=Evidence(
                cause.statistic, cause.p_value, None, _positive(np.array(difference.gains))
            ),
            indistinguishable_from=cause.indistinguishable_from,
            torques=torques,
            sentence=words.parametric(
                self._data,
                cause,
                parameters,
                torques,
                bags if len(self._parametric.groups) > 1 else (),
            ),
        )

    def _law_cause(self, difference: LawDifference) -> ContrastCause:
        joint, data = self._data.joints[difference.joint], self._data
        numbers = [
            data.in_units_at(difference.joint, each)
            for each in (difference.change, difference.reference, difference.against)
        ]
        torque = JointTorque(
            joint, difference.torque, difference.torque / self._sizes[difference.joint]
        )
        return ContrastCause(
            effect=ControllerMismatch.name,
            kind="structural",
            joint=joint,
            change="changed",
            bags=tuple(self._bags[number] for number in sorted(self._sets.second)),
            parameters=numbers[0],
            reference=numbers[1],
            against=numbers[2],
            evidence=Evidence(difference.statistic, difference.p_value, None, ""),
            torques=(torque,),
            sentence=words.law(joint, numbers[1], numbers[2], torque),
        )

    def _delay(self) -> list[ContrastCause]:
        if not self._shift.is_delay:
            return []
        change = self._shift.change
        assert change.std is not None
        statistic = (change.value / change.std) ** 2
        return [
            ContrastCause(
                effect=TimeDelay.name,
                kind="structural",
                joint=None,
                change="changed",
                bags=tuple(self._bags[number] for number in sorted(self._sets.second)),
                parameters={"delay": change},
                reference={"delay": self._shift.reference},
                against={"delay": self._shift.against},
                evidence=Evidence(statistic, float(chi2.sf(statistic, 1)), None, ""),
                sentence=words.delay(self._shift),
            )
        ]

    def _unattributed(self, difference: StructuralDifference) -> str:
        joint = self._data.joints[difference.found.candidate.place.joint]
        return words.unattributed(self._data, difference, self._taken([difference], joint)[0])

    def _joints(self) -> list[JointContrast]:
        """RMS in the second set: of the reference's model, with the causes, with its own."""
        noise = self._fit.noise_models
        named = beside_effects(self._sets, self._structural)
        for each in self._parametric.differences:
            named = named.with_columns(each.columns)
        after = block_errors(named, noise, self._blocks).residuals
        own = block_errors(self._model, noise, self._blocks).residuals
        before = self._of_reference()
        found = []
        for joint, name in enumerate(self._data.joints):
            inside = self._sets.inside[joint]
            first, second, least = (
                float(np.sqrt(np.mean(each[joint][inside] ** 2))) for each in (before, after, own)
            )
            found.append(
                JointContrast(
                    name,
                    first,
                    second,
                    least,
                    float(np.sqrt(max(first**2 - least**2, 0.0))) / self._sizes[joint],
                    float(np.sqrt(max(second**2 - least**2, 0.0))),
                )
            )
        return found

    def _of_reference(self) -> list[FloatArray]:
        """What the model of the reference leaves (r_j,) at every joint, N m (N)."""
        left = [rows.residual(self._fit.values) for rows in self._sets.regression.joints]
        starts = np.concatenate([[0], np.cumsum(self._model.widths)]).astype(int)
        shared = {
            id(each.candidate.columns): each.candidate.columns for each in self._structural.common
        }
        for each in (*self._structural.differences, *self._structural.unattributed):
            if each.scope == "reference":
                shared[id(each.found.candidate.columns)] = each.common
        for block, start, width in zip(self._model.added, starts, self._model.widths, strict=False):
            columns = shared.get(id(block))
            if columns is not None:
                coefficients = self._fit.coefficients[start : start + width]
                for joint, rows in columns.items():
                    left[joint] = left[joint] - rows @ coefficients
        return left


def _positive(gains: FloatArray) -> str:
    return f"{int(np.sum(gains > 0.0))} of {len(gains)}"


def _difference(
    against: dict[str, EffectParameter], reference: dict[str, EffectParameter]
) -> dict[str, EffectParameter]:
    """Number by number, of those that both have."""
    found = {}
    for name, each in against.items():
        other = reference.get(name)
        if other is not None:
            known = each.std is not None and other.std is not None
            std = float(np.hypot(each.std or 0.0, other.std or 0.0)) if known else None
            found[name] = EffectParameter(each.value - other.value, std, each.unit)
    return found
