"""Is a payload named beside friction that the model lacks, and does its interval hold the mass?

    python -m benchmarks.payload --out DIR

makes the bags of every cell in DIR, finds structural effects and parameter errors as `diagnose`
does (without its simulated motion), keeps what was found in DIR, and writes results/payload.md.
`--only PART` takes the cells whose names hold PART; `--draws N` those of the coverage study. Cells
that were judged before are not made again.
"""

import argparse
import json
from dataclasses import asdict, dataclass
from pathlib import Path

from benchmarks.measurement import write_page
from benchmarks.payload.cells import CELLS, Cell
from benchmarks.payload.coverage import STUDIES, Coverage, coverage, recorded
from benchmarks.payload.plants import LOADED
from benchmarks.payload.sessions import session
from idim_iv_ros.compilation import one_thread
from idim_iv_ros.configuration import Configuration
from idim_iv_ros.diagnosis.parametric.agreement import agreement
from idim_iv_ros.diagnosis.parametric.causes import ParametricOutcome, parametric_causes
from idim_iv_ros.diagnosis.refit.baseline import Baseline
from idim_iv_ros.diagnosis.refit.refit import refitted
from idim_iv_ros.diagnosis.structural.attribution import Attribution, attributed
from idim_iv_ros.diagnosis.structural.causes import NamedModel
from idim_iv_ros.diagnosis.structural.confirmation import confirmation
from idim_iv_ros.effects.registry import PARAMETRIC
from idim_iv_ros.identification.prepare import read_configured


@dataclass(frozen=True)
class Judged:
    """What was said of a cell.

    `mass` and `half_width` (kg, 95 %) are None where no payload is named; `share` is of the gap;
    `parametric` and `structural` are all that was named, `differing` the recordings that do not
    agree with the others.
    """

    name: str
    truth: float
    mass: float | None
    half_width: float | None
    share: float | None
    parametric: list[str]
    structural: list[str]
    differing: list[str]

    @property
    def held(self) -> bool:
        """Whether the interval holds the mass."""
        if self.mass is None or self.half_width is None:
            return False
        return abs(self.mass - self.truth) <= self.half_width


def judged(cell: Cell, bags: list[Path], configuration: Configuration) -> Judged:
    """Diagnose a cell."""
    with one_thread():
        refit = refitted(read_configured(bags, configuration, None), configuration, ())
        found = attributed(refit.data, refit.regression, ())
        model = confirmation(refit.data, found).model
        outcome = parametric_causes(refit.data, *model.for_parameters(refit.data))
        return summary(cell, refit.data, found, model, outcome)


def summary(
    cell: Cell,
    data: Baseline,
    found: Attribution,
    model: NamedModel,
    outcome: ParametricOutcome,
) -> Judged:
    """Keep what the page needs."""
    payload = next((each for each in outcome.causes if each.effect.name == "payload"), None)
    number = None if payload is None else payload.parameters.get("mass")
    differing = [
        f"{each.recording + 1}: "
        + ", ".join(
            f"{cause.effect.name} {number.value:.3g} ± {1.96 * (number.std or 0.0):.2g} kg"
            if (number := cause.parameters.get("mass")) is not None
            else cause.effect.name
            for cause in each.causes
        )
        for each in agreement(data, found, PARAMETRIC).differences
    ]
    return Judged(
        cell.name,
        cell.truth,
        None if number is None else number.value,
        None if number is None or number.std is None else 1.96 * number.std,
        None if payload is None else payload.share,
        [f"{each.effect.name}{_place(each.joint)}" for each in outcome.causes],
        [
            f"{each.candidate.effect.name} @{each.candidate.place.joint + 1}"
            for each in model.found
        ],
        differing,
    )  # fmt: skip


def _place(joint: str | None) -> str:
    return "" if joint is None else f" @{joint.rsplit('_', 1)[-1]}"


def page(results: list[Judged], coverages: list[tuple[str, Coverage]]) -> str:
    """Text of the page below its heading."""
    cells = {cell.name: cell for cell in CELLS}
    loaded = [
        each
        for each in results
        if abs(each.truth) > 0.0 and all(cells[each.name].loaded) and not cells[each.name].gains
    ]
    unloaded = [each for each in results if each.truth == 0.0]
    named = [each for each in loaded if each.mass is not None]
    first = [each for each in named if each.parametric[0].startswith("payload")]
    said = [each for each in unloaded if each.mass is not None]
    lines = [
        "| figure | measured | target |",
        "|---|---|---|",
        f"| payload named | {_of(len(named), len(loaded))} | ≥ 90 % |",
        f"| payload the first parameter error | {_of(len(first), len(loaded))} | |",
        f"| mass in its 95 % interval, where named | "
        f"{_of(sum(each.held for each in named), len(named))} | ≥ 90 % |",
        f"| payload named where there is none | {_of(len(said), len(unloaded))} | 0 |",
        "",
        "| cell | truth, kg | mass, kg | parameter errors | effects | recordings that differ |",
        "|---|---|---|---|---|---|",
    ]
    for each in results:
        mass = "–" if each.mass is None else f"{each.mass:.3f} ± {each.half_width or 0.0:.3f}"
        lines.append(
            f"| {each.name} | {each.truth:g} | {mass} | {', '.join(each.parametric) or '–'} | "
            f"{', '.join(each.structural) or '–'} | {'; '.join(each.differing) or '–'} |"
        )
    lines += [
        "",
        "| arm | what else is off | draws | named | mass in its interval | median half-width |",
        "|---|---|---|---|---|---|",
    ]
    lines += [
        f"| {arm} | {each.study.name} | {each.draws} | {_of(each.named, each.draws)} | "
        f"{_of(each.held, each.named)} | {100.0 * each.relative_width:.1f} % |"
        for arm, each in coverages
    ]
    return "\n".join(lines) + "\n"


def _of(part: int, whole: int) -> str:
    return f"{100.0 * part / max(whole, 1):.0f} % ({part}/{whole})"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--only", default="")
    parser.add_argument("--draws", type=int, default=200)
    arguments = parser.parse_args()
    results = []
    for number, cell in enumerate(CELLS):
        if arguments.only not in cell.name:
            continue
        kept = arguments.out / cell.name / "judged.json"
        if not kept.exists():
            bags, configuration = session(cell, number, kept.parent)
            kept.write_text(json.dumps(asdict(judged(cell, bags, configuration))))
        results.append(Judged(**json.loads(kept.read_text())))
        print(results[-1], flush=True)
    coverages = [
        (arm, coverage(data, arm, study, arguments.draws, LOADED[arm]))
        for arm in (("arm6", "arm2") if arguments.draws else ())
        for data in (recorded(arm, arguments.out / "coverage"),)
        for study in STUDIES
    ]
    write_page("payload", "Payloads beside friction", [page(results, coverages)])


if __name__ == "__main__":
    main()
