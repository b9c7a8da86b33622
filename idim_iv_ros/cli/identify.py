"""`idim-iv check`, `idim-iv identify`, `idim-iv servo` and `idim-iv compare`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from rich.console import Console
from rich.padding import Padding
from rich.text import Text
from typer import Argument, Option

from idim_iv_ros.cli import output as shared
from idim_iv_ros.cli.output import LONGEST, Output, next_command, print_table
from idim_iv_ros.errors import DataError, UsageError
from idim_iv_ros.files import RESULT, SERVO, signed, write_together
from idim_iv_ros.report.numerals import plural

if TYPE_CHECKING:
    from idim_iv_ros.diagnosis.result.document import GapResult
    from idim_iv_ros.identification.check import CheckReport
    from idim_iv_ros.identification.result import IdentificationResult

_STYLES = {"good": "green", "limited": "yellow", "unusable": "red"}
_FILE, _CONFIGURATION = "compare.html", "robot.yaml"
_SHOWN = 8  # rows at least, without --verbose


def check_command(
    bags: shared.Bags,
    config: shared.Config,
    quiet: shared.Quiet = False,
    as_json: shared.AsJson = False,
    verbose: shared.Verbose = False,
) -> None:
    """Say whether recordings can support an identification, per joint and per parameter.

    Exit status 1 if they cannot.

    Example: idim-iv check run1.mcap --config ur5.yaml
    """
    from idim_iv_ros.configuration import load_configuration

    output = Output(quiet=quiet, as_json=as_json)
    configuration = load_configuration(config)
    with output.progress() as progress:
        from idim_iv_ros.identification.check import check

        report = check(bags, configuration, progress)
    output.document(report.to_document())
    _print_findings(output.console, report, verbose)
    if not report.usable:
        first, *others = [f for f in report.findings if f.level == "unusable"]
        more = f" (and {len(others)} more)" if others else ""
        raise DataError(f"not usable for an identification: {first.where}: {first.sentence}{more}")
    limits = sum(finding.level == "limited" for finding in report.findings)
    named = f"Usable, with {plural(limits, 'limit')} named above."
    output.line(named if limits else "Usable.")
    output.line(f"Next: {next_command('identify', bags, config, '--out', 'results')}")


def _print_findings(console: Console, report: CheckReport, whole: bool) -> None:

    def print_indented(*parts: str | tuple[str, str]) -> None:
        console.print(Padding(Text.assemble(*parts), (0, 0, 0, 2), expand=False))

    for where in dict.fromkeys(finding.where for finding in report.findings):
        console.print(Text(where, style="bold"), soft_wrap=True)
        for finding in report.findings:
            if finding.where == where:
                level = "" if finding.level == "good" else f"{finding.level}: "
                print_indented((level, _STYLES[finding.level]), finding.sentence)
    if report.condition_number is None:
        return
    console.print(
        f"\nWhat the excitation shows (condition number {report.condition_number:.3g}; the "
        "residual of least squares is taken as white, so that these are lower bounds):"
    )
    for seen, words in (("well", "well, σ ≤ 10 %"), ("yes", "σ ≤ 30 %")):
        names = [parameter.name for parameter in report.parameters if parameter.seen == seen]
        if names:
            print_indented(f"{words}: {' '.join(names)}")
    poorly = [
        (p.name, "" if p.smallest is None else f"{p.smallest:.2g}", p.unit)
        for p in report.parameters
        if p.seen == "poorly"
    ]
    if poorly:
        columns = ("parameter", ">visible from (2σ)", "unit")
        most = None if whole else LONGEST
        print_table(console, "Seen poorly, or small", columns, poorly, most=most)


def identify_command(
    bags: shared.Bags,
    config: shared.Config,
    out: shared.OutOrJson = None,
    estimator: Literal["idim-iv", "idim-ls"] = Option(
        "idim-iv", help="Instrumental variables, or least squares."
    ),
    force: shared.Force = False,
    quiet: shared.Quiet = False,
    as_json: shared.AsJson = False,
) -> None:
    """Identify the dynamic parameters, test them, write result.json and report.html.

    Example: idim-iv identify run1.mcap run2.mcap --config ur5.yaml --out results
    """
    output = Output(quiet=quiet, as_json=as_json)
    with output.progress():  # while the libraries are loaded
        from idim_iv_ros.identification.identify import identify
        from idim_iv_ros.identification.prepare import loss_sentences
    result, numbers, page = output.produce(
        identify, bags, config, RESULT, out, force=force, estimator=estimator
    )
    print_parameters(output.console, result)
    print_verdict(output.console, result)
    output.warn(result.doubts)
    for advice in result.processing.advice:
        output.line(f"Advice: {advice}")
    output.warn(loss_sentences(result.bags))
    if result.verdict.verdict == "misspecified":
        output.line(f"Next: {next_command('diagnose', bags, config, '--out', 'why')}")
    print_physical(output, result, numbers, config)
    output.name_files(numbers, page)


def print_physical(
    output: Output,
    result: IdentificationResult | GapResult,
    numbers: Path | None,
    config: Path,
    *options: str,
) -> None:
    """Print the command that exports the result to a simulator; else why it cannot be."""
    if result.physical is None:
        if result.why_no_physical:
            output.line(f"No physical parameters for a simulator: {result.why_no_physical}")
        return
    if not result.physical.test.accepted:
        output.line(f"Physical parameters: {result.physical.sentence}")
    if numbers is not None:
        command = next_command("export", [numbers], config, *options, "--out", "simulator")
        output.line(f"Into a simulator: {command}")


def print_parameters(console: Console, result: IdentificationResult) -> None:
    """Print essential parameters with their standard deviations, the best determined first."""
    rows: list[tuple[float, tuple[str, ...]]] = []
    for parameter in result.parameters:
        value, std = parameter.essential_value, parameter.essential_std
        if parameter.essential and value is not None and std is not None:
            percent = 100.0 * std / abs(value)
            cells = (f"{value:.4g}", f"{std:.2g}", f"{percent:.2g}", parameter.unit)
            rows.append((percent, (parameter.name, *cells, parameter.essential_remark)))
    title = f"{result.robot}: essential parameters, {result.estimator}, best determined first"
    columns = ("parameter", ">value", ">σ", ">%σ", "unit", "remark")
    ordered = [cells for _, cells in sorted(rows)]
    print_table(console, title, columns, ordered, most=LONGEST, rest="the report has them")
    console.print(
        "A base parameter is what a motion can show: the parameter of its name (M mass, MX … first "
        "moments, XX … inertias, Ia drive inertia, Fv viscous and Fc Coulomb friction, off "
        "constant torque; joint last) with what is grouped with it. Essential: the recording "
        "determines it.",
        style="dim",
    )


def print_verdict(console: Console, result: IdentificationResult) -> None:
    """Print verdict, fit, source of the instruments, and parameters that were left out."""
    fit = result.fit
    percents = ", ".join(
        f"{joint} {'–' if error is None else f'{error:.3g} %'}"
        for joint, error in fit.joint_relative_error_percent.items()
    )
    lines = (
        f"{fit.essential_parameters} of {fit.base_parameters} base parameters are essential; "
        f"relative error {fit.relative_error_percent:.3g} % on {fit.samples} rows; "
        f"{plural(result.iterations, 'iteration')}, {'' if result.converged else 'NOT '}converged",
        percents and f"Relative error of the torque by joint: {percents}",
        f"Instruments: {result.instruments.source}",
        f"Verdict: {result.verdict.verdict}. {result.verdict.sentence}",
    )
    for line in filter(None, lines):
        console.print(Text(line))


def servo_command(
    bags: shared.Bags,
    config: shared.Config,
    gains: str | None = Option(
        None,
        metavar="G1,G2,…",
        help="The servos' gain setting in each recording, in any unit, where it differs.",
    ),
    model_error: float = Option(
        0.05,
        min=0.0,
        max=1.0,
        help="How wrong the nominal model's torques may be, as a standard deviation.",
    ),
    out: shared.OutOrJson = None,
    force: shared.Force = False,
    quiet: shared.Quiet = False,
    as_json: shared.AsJson = False,
) -> None:
    """Identify servos from commands and positions, for robots that record no torque.

    Writes servo.json, report.html and, where stiffness is known in N m/rad, servo.xml (MuJoCo),
    servo_isaac_lab.py and servo.yaml, a configuration for `identify` and `diagnose`.

    Example: idim-iv servo run1.mcap --config so101.yaml --out servos
    """
    from idim_iv_ros.configuration import load_configuration

    output = Output(quiet=quiet, as_json=as_json)
    settings = None if gains is None else shared.numbers("--gains", gains)
    if settings is not None and not all(setting > 0.0 for setting in settings):
        raise UsageError(f"--gains {gains}: gains are above zero")
    from idim_iv_ros.report import servo as servos
    from idim_iv_ros.servo.actuators import require_servo_files, write_servo_files
    from idim_iv_ros.servo.identify import identify_servos

    if out is not None:
        require_servo_files(out, force=force)
    options = {"gains": settings, "model_error": model_error}
    result, numbers, page = output.produce(
        identify_servos, bags, config, SERVO, out, force=force, **options
    )
    console, absolute = output.console, any(joint.absolute for joint in result.joints)
    columns = ("joint", *(f">{heading}" for heading in servos.SUMMARY_COLUMNS[1:]))
    title = "Servos (± half of the 95 % interval)"
    print_table(console, title, columns, servos.summary_rows(result))
    if not absolute:
        for joint in result.joints:
            rows = servos.number_rows((*joint.numbers, *joint.ratios))
            print_table(console, joint.joint, ("", ">value", ">95 % interval"), rows)
    for joint in result.joints:
        if joint.reason:
            console.print(f"{joint.joint}: {joint.reason}")
    heads = ("joint", ">perfect tracking", ">simulated servo", ">half not fitted", ">encoder step")
    print_table(console, "Position, rms in mrad", heads, servos.error_rows(result))
    if result.gains:
        columns = ("recording", "joint", ">given", ">estimated", ">95 % interval", "")
        print_table(console, "Gains", columns, servos.gain_rows(result))
    console.print(servos.headline(result))
    output.warn(result.warnings)
    if out is not None and absolute:
        for path in write_servo_files(result, load_configuration(config), bags, out):
            output.line(f"Wrote {path}")
    output.name_files(numbers, page)


def compare_command(
    first: Annotated[Path, Argument(help="A result.json of `idim-iv identify`.")],
    second: Annotated[Path, Argument(help="Another one of the same robot.")],
    out: Path | None = Option(None, "--out", help=f"Folder for {_FILE}, both side by side."),
    config: Path | None = Option(
        None,
        help="The robot's YAML file, for the next command; left out, that of the second "
        f"result is written beside {_FILE}.",
    ),
    force: shared.Force = False,
    quiet: shared.Quiet = False,
    as_json: shared.AsJson = False,
    verbose: shared.Verbose = False,
) -> None:
    """Say in which parameters two identifications of one robot differ.

    Example: idim-iv compare monday/result.json friday/result.json --out compared
    """
    from idim_iv_ros.identification.compare import compare_results
    from idim_iv_ros.report.compare import compare_html, compare_step, pair_words
    from idim_iv_ros.report.section import Files
    from idim_iv_ros.report.sections.provenance import configuration_text
    from idim_iv_ros.report.write import require_writable

    output = Output(quiet=quiet, as_json=as_json)
    comparison = compare_results(first, second)
    files = Files() if config is None else Files(str(config))
    if out is not None:
        written = {}
        if config is None:
            files = Files(str(out / _CONFIGURATION))
            written = {Path(files.config): signed(configuration_text(comparison.configuration))}
        written[out / _FILE] = compare_html(comparison, files)
        with require_writable(out, [path.name for path in written], force=force):
            write_together(written)
    output.document(comparison.to_document())
    title = f"{comparison.robot}: base parameters, those that differ most first"
    columns = ("base parameter", ">first (± 95 %)", ">second (± 95 %)", "unit", ">difference")
    rows = []
    for pair in comparison.pairs:
        *values, apart = pair_words(pair)
        rows.append((pair.words, *values, pair.unit, apart))
    most = None if verbose else max(_SHOWN, sum(pair.differs for pair in comparison.pairs))
    print_table(output.console, title, columns, rows, most=most)
    output.console.print(comparison.sentence)
    if out is not None or config is not None:
        output.line(f"Next: {compare_step(comparison, files).code}")
    if out is not None:
        output.line(f"Report: {out / _FILE}")
