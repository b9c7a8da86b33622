"""A result or a replay as one picture to show others: verdict, how far the gap shrinks, robot."""

import struct
import textwrap
from collections.abc import Callable
from pathlib import Path
from typing import Any
from zlib import crc32

from markupsafe import Markup

from idim_iv_ros.diagnosis.result import GapResult
from idim_iv_ros.errors import UsageError
from idim_iv_ros.files import (
    GENERATOR,
    PNG_SOFTWARE,
    FilePath,
    complete_files,
    require_file_place,
    write_together,
)
from idim_iv_ros.identification.result import IdentificationResult
from idim_iv_ros.model.parameters import unit_at
from idim_iv_ros.report.advice import diagnosis_headline, identification_headline, verdict_badge
from idim_iv_ros.report.gap_words import VERDICTS, stage_words, torque_unit
from idim_iv_ros.report.numerals import is_number, number, percent
from idim_iv_ros.report.page import environment
from idim_iv_ros.report.replay import headline
from idim_iv_ros.report.section import Report
from idim_iv_ros.report.sections.verdict import shaded_robot
from idim_iv_ros.simulators.replay_result import CORRECTED, NOMINAL, WITH_EFFECTS, ReplayResult

SUFFIXES = (".svg", ".png")
WIDTH, HEIGHT = 1200, 630
_LETTERS = 84  # of a line of the headline
_MOST_BARS = 9
_BARS_WIDTH = 300.0
_COLOURS = {
    "given": "#8a94a3",
    "refit": "#d55e00",
    NOMINAL: "#8a94a3",
    CORRECTED: "#d55e00",
    WITH_EFFECTS: "#0072b2",
}
_EFFECT, _NOISE = "#0072b2", "#b9c1cc"
_PNG_HEADER = 33  # bytes of the signature and the first chunk

# Name, size, colour, and the size in words, of a bar.
Bar = tuple[str, float, str, str]


def require_picture(path: FilePath | None, *, force: bool = False) -> None:
    """Make sure, before long work, that a picture of that name can be made.

    Raises
    ------
    UsageError
        Another suffix than ``.svg`` or ``.png``, a PNG without the library for it, or as
        `require_file_place`.
    """
    if path is None:
        return
    suffix = Path(path).suffix.lower()
    if suffix not in SUFFIXES:
        raise UsageError(f"--picture {path}: give a name that ends in .svg or .png")
    if suffix == ".png":
        _rasteriser(path)
    require_file_place([Path(path)], force=force)


def write_picture(result: IdentificationResult | GapResult | ReplayResult, path: FilePath) -> Path:
    """Write the summary of a result as an SVG or PNG picture, in the place of any file there.

    Raises
    ------
    UsageError
        A PNG without the library for it, or the file cannot be written.
    """
    svg, path = picture_svg(result), Path(path)
    try:
        if path.suffix.lower() == ".png":
            png = _signed(_rasteriser(path)(svg_string=svg, width=2 * WIDTH))
            with complete_files([path]) as temporary:
                temporary[path].write_bytes(png)
        else:
            write_together({path: svg})
    except OSError as error:
        raise UsageError(f"{path}: cannot write the picture: {error.strerror or error}") from error
    return path


def _rasteriser(path: FilePath) -> Callable[..., bytes]:
    try:
        from resvg_py import svg_to_bytes
    except ImportError as error:
        raise UsageError(
            f"--picture {path}: PNG needs resvg-py, `pip install 'idim-iv-ros[picture]'`; SVG "
            "needs nothing"
        ) from error
    return lambda **options: bytes(svg_to_bytes(**options))


def _signed(png: bytes) -> bytes:
    """Name the program in a tEXt chunk after the header: `files.written_by_program`."""
    content = b"tEXt" + PNG_SOFTWARE
    chunk = struct.pack(">I", len(PNG_SOFTWARE)) + content + struct.pack(">I", crc32(content))
    return png[:_PNG_HEADER] + chunk + png[_PNG_HEADER:]


def picture_svg(result: IdentificationResult | GapResult | ReplayResult) -> str:
    """Return the picture as the text of an SVG file."""
    robot, missing = None, ""
    if isinstance(result, ReplayResult):
        badge: tuple[str, str, str] = ("fair", "", "replay in MuJoCo")
        sentences: tuple[str, ...] = (headline(result),)
        title, bars = _tracking_errors(result)
    else:
        report: Report[Any] = Report(result)
        robot, missing = shaded_robot(report), report.nominal.missing
        if isinstance(result, GapResult):
            badge, sentences = VERDICTS[result.verdict], diagnosis_headline(result)
            title, bars = _stages(result)
        else:
            badge = verdict_badge(result.verdict.verdict)
            sentences = identification_headline(result)
            title, bars = "Relative error of the torque", _torque_errors(result)
    largest = max((size for _, size, *_ in bars), default=0.0) or 1.0
    return environment().get_template("picture.svg.j2").render(
        generator=Markup(GENERATOR),
        robot_name=result.robot,
        badge=badge,
        lines=textwrap.wrap(" ".join(sentences), _LETTERS),
        bars_title=title,
        bars=[
            (name, round(_BARS_WIDTH * size / largest, 1), colour, value)
            for name, size, colour, value in bars
        ],
        robot=robot,
        missing=missing,
        width=WIDTH,
        height=HEIGHT,
    )  # fmt: skip


def _stages(result: GapResult) -> tuple[str, list[Bar]]:
    """The models at the joint with the widest gap."""
    worst = max(result.joint_gaps, key=lambda gap: gap.share, default=None)
    if worst is None:
        return "", []
    unit = torque_unit(result, worst.joint)
    sizes = [(stage.name, stage.torque_rms.get(worst.joint)) for stage in result.stages]
    named = [(name, size) for name, size in sizes if size is not None and is_number(size)]
    if len(named) > _MOST_BARS:
        named = [*named[:2], *named[-_MOST_BARS + 2 :]]
    rows = [
        (stage_words(name), size, _COLOURS.get(name, _EFFECT), f"{number(size)} {unit}")
        for name, size in named
    ]
    if worst.noise_floor is not None:
        rows.append(
            ("noise floor", worst.noise_floor, _NOISE, f"{number(worst.noise_floor)} {unit}")
        )
    return f"Torque gap at {worst.joint}, rms on held-out data", rows


def _torque_errors(result: IdentificationResult) -> list[Bar]:
    errors = result.fit.joint_relative_error_percent
    return [
        (joint, error, _EFFECT, percent(error))
        for joint, error in list(errors.items())[:_MOST_BARS]
        if error is not None and is_number(error)
    ]


def _tracking_errors(result: ReplayResult) -> tuple[str, list[Bar]]:
    """Every stage at the joint that is farthest off at first."""
    errors = [(stage.name, stage.tracking) for stage in result.stages if stage.tracking is not None]
    if not errors:
        return "", []
    worst = max(result.joints, key=lambda joint: errors[0][1][joint].rms)
    unit = unit_at("mrad", result.joint_types[result.joints.index(worst)])
    sizes = [(name, 1e3 * tracking[worst].rms, _COLOURS[name]) for name, tracking in errors]
    sizes.append(("noise", 1e3 * result.tracking_noise[worst], _NOISE))
    rows = [(name, size, colour, f"{number(size)} {unit}") for name, size, colour in sizes]
    return f"Position of {worst}, simulation less recording (rms)", rows
