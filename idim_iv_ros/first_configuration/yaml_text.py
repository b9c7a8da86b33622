"""The proposal as a YAML file in which every key has its line: meaning, default, an example."""

import io
from pathlib import Path

from pydantic.fields import FieldInfo
from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedMap

from idim_iv_ros.configuration import Configuration, Section
from idim_iv_ros.errors import UsageError
from idim_iv_ros.files import FilePath, require_replaceable, signed, write_together
from idim_iv_ros.first_configuration.proposal import Proposal

_WIDTH = 10_000  # no value is broken over lines


# Sections of a configuration; what only `idim-iv simulate` reads comes last.
SECTIONS: dict[str, type[Section]] = {
    name: field.annotation
    for name, field in sorted(
        Configuration.model_fields.items(), key=lambda item: item[0] == "simulated_robot"
    )
    if isinstance(field.annotation, type) and issubclass(field.annotation, Section)
}


def configuration_text(proposal: Proposal, out: FilePath) -> str:
    """Return the text of a configuration file at `out`."""
    values = proposal.values_for(Path(out))
    bags = " ".join(path.name for path in proposal.bags)
    lines = [
        f"# A first configuration, made by idim-iv init from {' '.join(bags.split())}.",
        "# Lists are in the order of robot.joints. A line that begins with # is a key that is left",
        "# out; behind its example: what it means, and what holds without it. All keys at length:",
        "# docs/configuration.md.",
    ]
    for section, kind in SECTIONS.items():
        given = values.get(section, {})
        lines += ["", f"{section}:" if given else f"# {section}:"]
        for name, field in kind.model_fields.items():
            lines.append(_line(proposal, section, name, field, given))
            if (section, name) == ("robot", "joints"):
                left_out = proposal.left_out.items()
                lines += [f"  # left out: {joint}: {reason}" for joint, reason in left_out]
    return signed("\n".join(lines) + "\n")


def write_configuration(proposal: Proposal, out: FilePath, *, force: bool = False) -> Path:
    """Write the proposal as a configuration file.

    Raises
    ------
    UsageError
        It cannot be written, or a file of the user is in its place.
    """
    path = Path(out)
    require_replaceable([path], force=force)
    try:
        write_together({path: configuration_text(proposal, path)})
    except OSError as error:
        raise UsageError(f"{path}: cannot be written: {error.strerror or error}") from error
    return path


def _line(
    proposal: Proposal, section: str, name: str, field: FieldInfo, given: dict[str, object]
) -> str:
    """One key with its value, or as a comment with its example."""
    words, reason = field.json_schema_extra, proposal.reasons.get((section, name), "")
    assert isinstance(words, dict)
    about = f"{field.description}; default: {words['without']}" + (f". {reason}" if reason else "")
    if name in given:
        return f"  {_yaml(name, given[name])}  # {about}"
    example: object = words["example"]
    if (section, name) == ("controller", "torque_limit") and proposal.limits:
        example = list(proposal.limits)
    elif isinstance(example, list) and len(example) == 1 and isinstance(example[0], float):
        example = example * len(proposal.joints)
    return f"  # {_yaml(name, example)}  # {about}"


def _yaml(name: str, value: object) -> str:
    """``name: value`` in one line."""
    yaml = YAML()
    yaml.default_flow_style = True
    yaml.width = _WIDTH
    stream = io.StringIO()
    mapping = CommentedMap({name: value})
    mapping.fa.set_block_style()
    yaml.dump(mapping, stream)
    return stream.getvalue().strip()
