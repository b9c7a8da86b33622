"""What the numbers of a cause are, in words: by effect and name in gap.json."""

import re
from collections.abc import Mapping

from idim_iv_ros.diagnosis.result import EffectParameter

# A name that ends in _k stands for _1, _2, …
_WORDS: dict[str, dict[str, str]] = {
    "payload": {
        "mass": "mass",
        "moment_x": "mass times its x in the link's frame",
        "moment_y": "mass times its y in the link's frame",
        "moment_z": "mass times its z in the link's frame",
    },
    "gravity_direction": {
        "rotation_about_x": "rotation of gravity about x of the base",
        "rotation_about_y": "rotation of gravity about y of the base",
        "rotation_about_z": "rotation of gravity about z of the base",
    },
    "torque_gain": {"factor": "actual torque over recorded torque"},
    "torque_offset": {"offset": "constant torque beyond the nominal model's"},
    "friction_level": {
        "change_of_viscous": "viscous friction less the given one",
        "change_of_coulomb": "Coulomb friction less the given one",
    },
    "drive_inertia": {"change_of_drive_inertia": "drive inertia less the given one"},
    "stribeck": {
        "excess": "dry friction at rest beyond that in motion",
        "speed": "Stribeck speed",
        "exponent": "exponent of speed over Stribeck speed",
    },
    "nonlinear_viscous": {"coefficient": "friction", "power": "power of the speed"},
    "asymmetric_friction": {"viscous": "half of viscous friction forwards less that backwards"},
    "load_dependent_friction": {
        "driving": "friction over load while the motor drives the load",
        "driven": "friction over load while the load drives the motor",
        "exponent": "power of load over scale",
        "scale": "scale of the load",
        "motor_torque": "load taken as the motor's torque (1) or the links' (0)",
    },
    "position_dependent_friction": {
        "wave_number_k": "wave number",
        "sine_k": "friction with the sine",
        "cosine_k": "friction with the cosine",
        "centre": "centre of the spot",
        "width": "width of the spot",
        "height": "friction there beyond that elsewhere",
    },
    "friction_drift": {
        "time_constant": "time constant",
        "coulomb": "Coulomb friction at the start beyond that at the end",
        "viscous": "viscous friction at the start beyond that at the end",
    },
    "presliding": {
        "span_k": "distance to full slip",
        "level_k": "part of the Coulomb friction",
    },
    "backlash": {
        "gap": "whole play",
        "stiffness": "stiffness beyond the play",
        "damping": "damping beyond the play",
    },
    "elasticity": {"stiffness": "stiffness of the shaft", "damping": "damping of the shaft"},
    "time_delay": {"delay": "delay of the torque"},
    "torque_saturation": {
        "knee": "torque from which on it saturates",
        "slope": "share of the torque beyond that acts",
    },
    "position_ripple": {
        "wave_number_k": "wave number",
        "sine_k": "torque with the sine",
        "cosine_k": "torque with the cosine",
    },
    "spring": {
        "linear": "coefficient of q",
        "quadratic": "coefficient of q²",
        "cubic": "coefficient of q³",
        "bent": "coefficient of the bent part",
        "lowest": "constant below",
        "highest": "constant above",
        "hardening": "bent part hardens (1) or softens (0)",
        "centre": "centre of the bent part",
        "width": "width of the bent part",
    },
    "encoder_eccentricity": {
        "sine": "encoder error with sin q",
        "cosine": "encoder error with cos q",
        "sine_2": "encoder error with sin 2q",
        "cosine_2": "encoder error with cos 2q",
    },
    "joint_coupling": {
        "direction": "friction of the sum (1) or the difference (−1) of both speeds",
        "coulomb": "Coulomb friction of the coupling",
        "viscous": "friction of the coupling beyond that",
        "power": "power of the speed",
    },
    "controller_mismatch": {
        "kp": "kp in use",
        "kd": "kd in use",
        "ki": "ki in use",
        "feedforward_acceleration": "feedforward over reference acceleration",
        "feedforward_velocity": "feedforward over reference velocity",
        "lag": "lag of the command",
    },
}


def parameter_words(effect: str, name: str) -> str:
    """Return what a number of a cause is; its name without underscores where that says it."""
    known = _WORDS.get(effect, {})
    if name in known:
        return known[name]
    numbered = re.fullmatch(r"(\w+)_(\d+)", name)
    if numbered and f"{numbered[1]}_k" in known:
        return f"{known[f'{numbered[1]}_k']} {numbered[2]}"
    changed = re.fullmatch(r"change_of_(base_)?([A-Z]+\d+)", name)
    if changed:
        grouped = " (grouped)" if changed[1] else ""
        return f"{changed[2]}{grouped} less the given one"
    inertia = re.fullmatch(r"inertia_(\w\w)", name)
    if inertia:
        return f"moment of inertia {inertia[1]} about the link's frame"
    return name.replace("_", " ")


def surest(parameters: Mapping[str, EffectParameter], most: int) -> dict[str, EffectParameter]:
    """Return at most so many numbers, in their order: those that differ from zero most surely.

    All where no number is fitted.
    """
    ratios = {name: abs(each.value) / each.std for name, each in parameters.items() if each.std}
    chosen = sorted(ratios, key=lambda name: -ratios[name])[:most] or list(parameters)
    return {name: each for name, each in parameters.items() if name in chosen}
