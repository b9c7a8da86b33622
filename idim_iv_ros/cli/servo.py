"""`idim-iv servo`."""

from __future__ import annotations

from typer import Option

from idim_iv_ros.cli import arguments as shared
from idim_iv_ros.cli.output import Output, print_table
from idim_iv_ros.errors import UsageError
from idim_iv_ros.files import SERVO


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
    from idim_iv_ros.report.servo import (
        SUMMARY_COLUMNS,
        error_rows,
        gain_rows,
        headline,
        number_rows,
        summary_rows,
    )
    from idim_iv_ros.servo.actuators import require_servo_files, write_servo_files
    from idim_iv_ros.servo.identify import identify_servos

    if out is not None:
        require_servo_files(out, force=force)
    options = {"gains": settings, "model_error": model_error}
    result, numbers, page = output.produce(
        identify_servos, bags, config, SERVO, out, force=force, **options
    )
    columns = ("joint", *(f">{heading}" for heading in SUMMARY_COLUMNS[1:]))
    title = "Servos (± half of the 95 % interval)"
    print_table(output.console, title, columns, summary_rows(result))
    if not any(joint.absolute for joint in result.joints):
        for joint in result.joints:
            rows = number_rows((*joint.numbers, *joint.ratios))
            print_table(output.console, joint.joint, ("", ">value", ">95 % interval"), rows)
    for joint in result.joints:
        if joint.reason:
            output.console.print(f"{joint.joint}: {joint.reason}")
    print_table(
        output.console,
        "Position, rms in mrad",
        ("joint", ">perfect tracking", ">simulated servo", ">half not fitted", ">encoder step"),
        error_rows(result),
    )
    if result.gains:
        heads = ("recording", "joint", ">given", ">estimated", ">95 % interval", "")
        print_table(output.console, "Gains", heads, gain_rows(result))
    output.console.print(headline(result))
    output.warn(result.warnings)
    if out is not None and any(joint.absolute for joint in result.joints):
        for path in write_servo_files(result, load_configuration(config), bags, out):
            output.line(f"Wrote {path}")
    output.name_files(numbers, page)
