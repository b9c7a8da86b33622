"""Which instruments a recording allows: the control law, its fit, or what replaces them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from idim_iv_ros.configuration import Configuration
from idim_iv_ros.estimation.idim_iv import Start
from idim_iv_ros.estimation.instruments import FixedMotion, InstrumentSource, SimulatedLoop
from idim_iv_ros.model import InverseModel, RobotModel
from idim_iv_ros.signals import Cutoffs, Motion, zero_phase_butterworth
from idim_iv_ros.simulation import (
    ControlLaw,
    ControllerFit,
    control_law,
    control_period,
    filter_reference,
    fit_controller,
)
from idim_iv_ros.types import FloatArray

# A fitted control law that explains less of the torque than this is not simulated.
LEAST_R_SQUARED = 0.9


def reference(motion: Motion) -> FloatArray:
    """Position reference of a motion that has one, rad."""
    if motion.signals.position_reference is None:
        raise ValueError(f"{motion.signals.name} has no reference")
    return motion.signals.position_reference


def _filtered_references(
    robot: RobotModel, motions: Sequence[Motion]
) -> tuple[list[FloatArray], str]:
    """References through a fitted closed-loop filter, and how closely they follow the motion."""
    filters = [filter_reference(m.signals.rate, m.position, reference(m)) for m in motions]
    positions, missed, moved = zip(*filters, strict=True)
    errors, spreads = np.max(missed, axis=0), np.max(moved, axis=0)
    joints = ", ".join(
        f"{name} {error:.2g} {'rad' if kind == 'revolute' else 'm'}"
        + (f" ({100.0 * error / spread:.2g} %)" if spread > 0.0 else "")
        for name, kind, error, spread in zip(
            robot.joints, robot.joint_types, errors, spreads, strict=True
        )
    )
    return list(positions), (
        "reference through a fitted closed-loop filter, which misses the recorded motion where "
        f"it was not fitted by (rms, and share of the motion's standard deviation): {joints}"
    )


def _smoothed_measurements(
    cutoff: float, motions: Sequence[Motion]
) -> tuple[list[FloatArray], str]:
    """Positions smoothed harder than the regressor's.

    Noise below the cut-off stays in both X and Z: it is not averaged out, so that the estimate
    keeps the bias of least squares in that band, and Π = I says nothing.
    """
    return [
        zero_phase_butterworth(motion.position, rate=motion.signals.rate, cutoff=cutoff, order=4)
        for motion in motions
    ], f"measured positions smoothed at {cutoff:.3g} Hz"


@dataclass(frozen=True)
class InstrumentSources:
    """Sources in the order in which they are tried, and where the iteration may start.

    `controller`: what is known of the control law, one sentence each; `fits`: one for each motion
    where the law is unknown.
    """

    sources: tuple[InstrumentSource, ...]
    starts: tuple[Start, ...]
    controller: tuple[str, ...]
    fits: tuple[ControllerFit, ...] = ()


def instrument_sources(
    configuration: Configuration, model: InverseModel, motions: Sequence[Motion], cutoffs: Cutoffs
) -> InstrumentSources:
    """List the sources of instruments that the configuration and the recordings allow."""
    sources: list[InstrumentSource] = []
    fits: tuple[ControllerFit, ...] = ()
    sentences: list[str] = []
    if all(motion.signals.position_reference is not None for motion in motions):
        law, fits, of_laws = _laws(configuration, motions)
        sentences += of_laws
        if law is not None:
            configured = configuration.controller.type != "unknown"
            how = "configured" if configured else "fitted"
            name = f"closed-loop simulation with the {how} control law"
            sources.append(SimulatedLoop(model, tuple(motions), law, name))
        untestable = (
            "the instruments come from a filter that was fitted to the measured motion: it follows "
            "the robot whatever the dynamic model is"
        )
        make = partial(_filtered_references, model.robot)
        sources.append(FixedMotion(model, tuple(motions), make, untestable))
    else:
        missing = [m.signals.name for m in motions if m.signals.position_reference is None]
        sentences.append(
            f"no reference is read from {', '.join(missing)}: the closed loop cannot be simulated, "
            "so that the instruments are smoothed measurements. Noise of the positions below the "
            "smoothing frequency is not averaged out, and the instruments cannot be tested"
        )
    cutoff = cutoffs.decimation / 2.0
    untestable = (
        "the instruments are smoothed measurements, not a simulation: the noise below "
        f"{cutoff:.3g} Hz is in both"
    )
    smooth = partial(_smoothed_measurements, cutoff)
    sources.append(FixedMotion(model, tuple(motions), smooth, untestable))
    return InstrumentSources(tuple(sources), _starts(configuration, model), tuple(sentences), fits)


def _starts(configuration: Configuration, model: InverseModel) -> tuple[Start, ...]:
    """Values with which the iteration may begin: the nominal ones, if usable, then regular ones."""
    regular = Start("the regular start", model.regular, spread=None)
    usable = model.robot.has_inertials and configuration.signals.effort_unit == "N m"
    if configuration.identification.start == "regular" or not usable:
        return (regular,)
    # A servo's law has no damping of its own: without the friction its loop would run away.
    servo = configuration.signals.effort_topic is None
    values = model.given if servo else model.given_without_friction
    given = Start("the given values", values, _sizes(model))
    return (given, regular)


def _sizes(model: InverseModel) -> FloatArray:
    """Size of each given value (b,): its own and the median of its unit; infinite for friction."""
    values = np.abs(model.given_without_friction)
    units = np.array(model.base.units)
    sizes = np.full(len(values), np.inf)
    for unit in set(model.base.units):
        present = values[(units == unit) & (values > 0.0)]
        if len(present):
            same_unit = units == unit
            sizes[same_unit] = values[same_unit] + np.median(present)
    return sizes


def _laws(
    configuration: Configuration, motions: Sequence[Motion]
) -> tuple[tuple[ControlLaw, ...] | None, tuple[ControllerFit, ...], list[str]]:
    section = configuration.controller
    joints = configuration.robot.joints
    if section.type != "unknown":
        law = control_law(section, len(joints))
        law = replace(law, period=control_period(section, (m.signals.rate for m in motions)))
        return tuple(law for _ in motions), (), [f"control law {section.type} as configured"]
    fits = tuple(
        fit_controller(motion.signals, torque_limit=section.torque_limit) for motion in motions
    )
    sentences = [
        f"{name}{f' in {motion.signals.name}' if len(motions) > 1 else ''}: {fit.describe(joint)}"
        for fit, motion in zip(fits, motions, strict=True)
        for joint, name in enumerate(joints)
    ]
    worst = min(float(fit.r_squared.min()) for fit in fits)
    if worst < LEAST_R_SQUARED:
        sentences.append(
            f"the fitted control law explains only R² = {worst:.2f} of a joint's torque, less than "
            f"{LEAST_R_SQUARED:g}: the loop is not simulated with it"
        )
        return None, fits, sentences
    try:
        laws = tuple(
            fit.law(motion.signals, section.torque_limit)
            for fit, motion in zip(fits, motions, strict=True)
        )
    except ValueError as error:
        sentences.append(f"the loop is not simulated with the fitted control law: {error}")
        return None, fits, sentences
    return laws, fits, sentences
