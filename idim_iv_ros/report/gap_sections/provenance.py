"""Notes, the extended model's parameters, and how to obtain the same numbers again."""

from idim_iv_ros.diagnosis.result import GapResult
from idim_iv_ros.report.gap_sections.parameters import parameter_table
from idim_iv_ros.report.markup import Html, bullets, section, sentence, tag
from idim_iv_ros.report.sections.provenance import facts, quoted, time_spent, yaml_text


def notes_section(result: GapResult) -> Html | None:
    """Return what could not be done and why, or None."""
    if not result.notes:
        return None
    names = [*result.joints, *result.bags]
    notes = [sentence(note, names) for note in result.notes]
    return section("Notes", "notes", bullets(notes))


def gap_provenance_section(result: GapResult) -> Html:
    """Return the command, versions, timing, extended parameters and configuration."""
    bags = " ".join(quoted(bag) for bag in result.bags)
    without = "".join(f" --without {quoted(effect)}" for effect in result.without)
    command = f"idim-iv diagnose {bags} --config robot.yaml --out why{without}"
    return section(
        "How to repeat",
        "repeat",
        tag("p", "Save the configuration below as ", tag("code", "robot.yaml"), " and run"),
        tag("pre", command),
        tag("p", "All numbers, unrounded, are in ", tag("code", "gap.json"), " beside this."),
        tag(
            "div",
            facts("Software", dict(result.software)),
            facts("Time spent", time_spent(result.timing)),
            css="grid pair",
        ),
        _parameters(result),
        tag("h3", "Configuration"),
        tag("pre", yaml_text(result.configuration)),
    )


def _parameters(result: GapResult) -> Html | None:
    if not result.extended_parameters:
        return None
    count = len(result.extended_parameters)
    return tag(
        "details",
        tag("summary", tag("h3", f"Base parameters of the extended model ({count})")),
        parameter_table(result.extended_parameters),
    )
