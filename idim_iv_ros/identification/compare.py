"""Two identifications of one robot side by side: which parameters differ beyond chance."""

from dataclasses import asdict, dataclass

from idim_iv_ros.errors import UsageError, first_of
from idim_iv_ros.files import FilePath
from idim_iv_ros.identification.result import IdentificationResult
from idim_iv_ros.model.parameters import words_of_name
from idim_iv_ros.statistics.hypothesis import drifts_of

_LEVEL = 0.05  # probability that any parameter of two equal robots is called different
_MOST_NAMES = 3  # in the sentence


@dataclass(frozen=True)
class ParameterPair:
    """A base parameter in two results of identifications, and its difference.

    `words`: what the parameter of its name is; `deviations`: second less first, in standard
    deviations of the difference; `differs`: whether chance does not do that among all parameters.
    """

    name: str
    unit: str
    expression: str
    words: str
    first: float
    first_std: float
    second: float
    second_std: float
    deviations: float
    differs: bool


@dataclass(frozen=True)
class ParameterComparison:
    """Parameters of two results, those that differ most first.

    - `limit`: standard deviations from which on a parameter differs
    - `alone`: parameters that only one of the results has
    """

    names: tuple[str, str]
    robot: str
    bags: tuple[tuple[str, ...], ...]
    pairs: tuple[ParameterPair, ...]
    limit: float
    alone: tuple[str, ...]
    configuration: dict[str, object]

    @property
    def sentence(self) -> str:
        """Whether the parameters of two results differ, and which, in a sentence."""
        differing = [f"{p.words} ({abs(p.deviations):.2g} σ)" for p in self.pairs if p.differs]
        count, level = len(self.pairs), f"{100.0 * _LEVEL:g} %"
        if not differing:
            return (
                f"No parameter differs beyond chance: all {count} are within {self.limit:.2g} "
                f"standard deviations, which results of an unchanged robot exceed with a "
                f"probability of {level}."
            )
        verb = "differs" if len(differing) == 1 else "differ"
        return (
            f"{len(differing)} of {count} parameters {verb}: {first_of(differing, _MOST_NAMES)}. "
            f"Results of an unchanged robot differ so with a probability of {level}."
        )

    def to_document(self) -> dict[str, object]:
        """Return plain values for JSON."""
        document = asdict(self)
        del document["configuration"]
        return {**document, "sentence": self.sentence}


def compare_results(first: FilePath, second: FilePath) -> ParameterComparison:
    """Compare the parameters of two files result.json.

    The estimates are taken as independent: of two results of the same recordings differences look
    smaller than they are.

    Raises UsageError: a file is no result, or they are of robots with other base parameters.
    """
    results = [IdentificationResult.read(path) for path in (first, second)]
    before, now = ({parameter.name: parameter for parameter in of.parameters} for of in results)
    shared = [name for name in before if name in now]
    other = [name for name in shared if before[name].unit != now[name].unit]
    if not shared or other or results[0].joints != results[1].joints:
        why = f"{other[0]} has another unit" if other else "they have other joints or parameters"
        raise UsageError(
            f"{second}: cannot be compared with {first}: {why}; give results of a robot"
        )
    estimates, others = (
        {name: (of[name].value, of[name].std) for name in shared} for of in (before, now)
    )
    drifts = drifts_of(estimates, others, _LEVEL)
    pairs = [
        ParameterPair(
            drift.name,
            before[drift.name].unit,
            before[drift.name].expression,
            words_of_name(drift.name, results[0].joints),
            *(drift.before, drift.before_std, drift.now, drift.now_std),
            drift.statistic,
            drift.drifts,
        )
        for drift in drifts
    ]
    return ParameterComparison(
        names=(str(first), str(second)),
        robot=results[0].robot,
        bags=tuple(tuple(bag.path for bag in result.bags) for result in results),
        pairs=tuple(sorted(pairs, key=lambda pair: -abs(pair.deviations))),
        limit=drifts[0].limit,
        alone=tuple(sorted(set(before) ^ set(now))),
        configuration=results[1].configuration,
    )
