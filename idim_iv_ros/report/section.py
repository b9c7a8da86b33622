"""A section of a report: title, template, and what it shows of a result and its nominal model."""

import json
import os
import warnings
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Generic, TypeVar

from jinja2 import Environment
from markupsafe import Markup

from idim_iv_ros.configuration import Configuration
from idim_iv_ros.diagnosis.result.document import GapResult
from idim_iv_ros.encoding import shell_command
from idim_iv_ros.errors import ReportWarning, one_line
from idim_iv_ros.files import GAP, RESULT
from idim_iv_ros.identification.result import IdentificationResult
from idim_iv_ros.model import InverseModel, build_inverse_model, read_urdf_file
from idim_iv_ros.model.link_motion import Skeleton, skeleton
from idim_iv_ros.recording.recording import SessionPart
from idim_iv_ros.report.time_axis import SessionAxis

# What a page calls the configuration where its file is not known.
CONFIGURATION = "robot.yaml"

Result = IdentificationResult | GapResult
R = TypeVar("R", IdentificationResult, GapResult, Result)


@dataclass(frozen=True)
class Nominal:
    """The nominal model of a result, read again from its configuration; or why it is `missing`."""

    missing: str = ""
    model: InverseModel | None = None
    skeleton: Skeleton | None = None
    is_mjcf: bool = False  # which also holds drive inertias


def read_nominal(document: Mapping[str, object]) -> Nominal:
    """Read the nominal model of the configuration in a result.

    Where the URDF came with the recording or does not exist any more, there is none: the report
    then leaves out what needs it.
    """
    is_mjcf = False
    try:
        configuration = Configuration.model_validate_json(json.dumps(document))
        urdf, is_mjcf = configuration.robot.description, configuration.robot.mjcf is not None
        if urdf is None:
            return Nominal("the URDF came with the recording, not with the configuration")
        model = build_inverse_model(configuration, read_urdf_file(urdf), urdf.name)
        return Nominal("", model, skeleton(model.robot), is_mjcf)
    except Exception as error:  # whatever is wrong with a file that was right before
        return Nominal(one_line(error), is_mjcf=is_mjcf)


@dataclass(frozen=True)
class Files:
    """Paths in the commands on a page, which run where the page was made.

    `folder` is that of the page and its numbers; `bags` are recordings, or a fleet's source.
    """

    config: str = CONFIGURATION
    folder: str = ""
    bags: tuple[str, ...] = ()

    def here(self, name: str) -> str:
        """Return the path of a file in the folder of the page."""
        return str(Path(self.folder, name))

    def recordings(self, names: Iterable[str]) -> list[str]:
        """Return the paths of recordings by name; the name if its path is unknown or ambiguous."""
        paths = {name: [bag for bag in self.bags if Path(bag).name == name] for name in names}
        return [places[0] if len(places) == 1 else name for name, places in paths.items()]

    def command(self, *words: str, out: str = "") -> str:
        """Return a command of this program with the configuration, quoted for a shell."""
        end = ("--out", out) if out else ()
        return f"idim-iv {shell_command(*words, '--config', self.config, *end)}"

    def again(self, command: str, *options: str, out: str) -> str:
        """Return two commands: record new bags, and run `command` on them."""
        words = shell_command(*options, "--config", self.config, "--out", out)
        return f"{self.command('record', out='new')}\nidim-iv {command} new/* {words}"


# For a page without the files of its result.
UNPLACED = Files()


@dataclass(frozen=True)
class Report(Generic[R]):
    """A result and the files of its page, with the nominal model and time axis."""

    result: R
    files: Files = UNPLACED

    @property
    def numbers(self) -> str:
        """Return the name of the file with all numbers."""
        return GAP if isinstance(self.result, GapResult) else RESULT

    @cached_property
    def nominal(self) -> Nominal:
        """Return the nominal model, read again from the configuration."""
        return read_nominal(self.result.configuration)

    @cached_property
    def session(self) -> SessionAxis:
        """Return the common time axis of the recordings."""
        if isinstance(self.result, GapResult):
            return SessionAxis(tuple(self.result.session))
        bags = self.result.bags
        parts = (SessionPart(Path(bag.path).name, bag.session_start, bag.duration) for bag in bags)
        return SessionAxis(tuple(parts))


@dataclass(frozen=True)
class Section:
    """One section of a page.

    The template is `template`, else that with the name of the anchor. It has the `report`, its
    `result` and `files`, whether that is a `diagnosis`, `anchor` and `title`, and may call the
    functions of `page.environment`. Where it prints nothing, the section is left out.
    """

    title: str
    anchor: str
    template: str = ""

    def render(self, report: Report[Any], templates: Environment) -> Markup | None:
        """Return the section as HTML, or one line in its place where it cannot be drawn.

        A failure is a `ReportWarning`, since all numbers are in another file. With
        ``IDIM_IV_TRACEBACK`` set in the environment it is raised.
        """
        given: dict[str, Any] = {"anchor": self.anchor, "title": self.title}
        result, files, diagnosis = report.result, report.files, report.numbers == GAP
        try:
            template = templates.get_template(f"{self.template or self.anchor}.html.j2")
            shown = {"report": report, "result": result, "files": files, "diagnosis": diagnosis}
            text = template.render(given | shown)
        except Exception as error:
            if os.environ.get("IDIM_IV_TRACEBACK"):
                raise
            reason = one_line(error)
            what = f"the section “{self.title}” of the report cannot be drawn ({reason})"
            message = f"{what}; all numbers are in {report.numbers}"
            warnings.warn(message, ReportWarning, stacklevel=2)
            failed = templates.get_template("failed.html.j2")
            text = failed.render(given, reason=reason, numbers=report.numbers)
        return Markup(text) if text.strip() else None
