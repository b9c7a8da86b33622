"""How often the interval of a payload's mass holds the truth: regressions of a known robot.

The motion is simulated once. In each draw the rows are those of a true robot, whose numbers are
off from the nominal model's as the study says, with a payload and noise; the causes are found and
estimated from these rows. Neither the closed loop nor the search for structural effects is part.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import scipy
from numpy.typing import NDArray

from benchmarks.payload.plants import Plant, record
from benchmarks.payload.robots import LOAD_CENTRE, RADIUS, data_sheet
from benchmarks.payload.sessions import motion
from idim_iv_ros.diagnosis.parametric.causes import parametric_causes
from idim_iv_ros.diagnosis.refit.baseline import Baseline, baseline, smooth_regression
from idim_iv_ros.diagnosis.structural.likelihood import Regression
from idim_iv_ros.identification.prepare import read_configured

FloatArray = NDArray[np.float64]

NOISE = 0.005  # of the torque limit, standard deviation of a row
AUTOCORRELATION = 0.5  # from row to row
LOAD_SHARE = 0.1
_CENTRE = 0.1  # m, what the relative error of a link's centre of mass is of
_OF_DRIVES = ("Ia", "Fv", "Fc")


@dataclass(frozen=True)
class Study:
    """What is off beside the payload.

    `inertials`: relative errors of every mass and inertia, and of 0.1 m in each centre of mass;
    `friction`: of drives and friction; `coulomb`: relative error at the two
    joints that carry the weight alone; `load`: whether there is friction over the load, which is
    in the model with free coefficients.
    """

    name: str
    inertials: float = 0.0
    friction: float = 0.0
    coulomb: float = 0.0
    load: bool = False
    payload: bool = True


STUDIES = (
    Study("nothing else is off"),
    Study("inertials off by 10 %", inertials=0.1),
    Study("inertials, drives and friction off by 10 %", inertials=0.1, friction=0.1),
    Study("Coulomb friction of two joints off by 30 %", coulomb=0.3),
    Study("the same, and friction over the load", coulomb=0.3, load=True),
    Study("inertials off by 10 %, and friction over the load", inertials=0.1, load=True),
    Study("everything off by 10 %, no payload", inertials=0.1, friction=0.1, payload=False),
)


@dataclass(frozen=True)
class Coverage:
    """Draws, those in which the payload is named, and of these those whose interval holds it.

    `relative_width`: median half-width of the 95 % interval over the mass.
    """

    study: Study
    draws: int
    named: int
    held: int
    relative_width: float


def recorded(arm: str, folder: Path) -> Baseline:
    """Refit of a recording of the nominal robot itself."""
    sheet = data_sheet(arm)
    folder.mkdir(parents=True, exist_ok=True)
    bag = folder / f"{arm}.mcap"
    joints = len(sheet.configuration.robot.joints)
    record("own", Plant(sheet, "none", np.ones(joints)), arm, motion(arm, 1), 1, bag)
    return baseline(read_configured([bag], sheet.configuration, None), sheet.configuration)


def coverage(
    data: Baseline, arm: str, study: Study, draws: int, loaded: Sequence[int], seed: int = 1
) -> Coverage:
    """Draw robots and payloads; `loaded`: joints that carry the weight."""
    plain = smooth_regression(data)
    random = np.random.default_rng(seed)
    named, held, widths = 0, 0, []
    for _ in range(draws):
        mass = float(np.exp(random.uniform(np.log(0.5), np.log(3.0))))
        mass *= study.payload
        regression = _world(data, plain, arm, study, mass, loaded, random)
        causes = parametric_causes(data, regression, regression.fit()).causes
        payload = next((each for each in causes if each.effect.name == "payload"), None)
        if payload is None:
            continue
        named += 1
        found = payload.parameters.get("mass")
        if study.payload and found is not None and found.std is not None:
            held += abs(found.value - mass) <= 1.96 * found.std
            widths.append(1.96 * found.std / mass)
    return Coverage(study, draws, named, held, float(np.median(widths)) if widths else np.nan)


def _world(
    data: Baseline,
    plain: Regression,
    arm: str,
    study: Study,
    mass: float,
    loaded: Sequence[int],
    random: np.random.Generator,
) -> Regression:
    values = _true_values(data, arm, study, mass, loaded, random)
    limits = np.asarray(data.prepared.configuration.controller.torque_limit)
    joints, columns = [], {}
    for joint, rows in enumerate(plain.joints):
        torque = rows.matrix @ values[rows.columns]
        if study.load and joint in loaded:
            columns[joint] = np.zeros((len(rows), len(loaded)))
            friction = data.counting(
                joint,
                [
                    each.rows((np.abs(each.load) * each.slip)[:, [joint]])
                    for each in data.motions
                ],
            )  # fmt: skip
            columns[joint][:, [list(loaded).index(joint)]] = friction
            torque = torque + LOAD_SHARE * friction[:, 0]
        white = random.standard_normal(len(rows))
        scale = NOISE * limits[joint] * np.sqrt(1.0 - AUTOCORRELATION**2)
        noise = scipy.signal.lfilter([scale], [1.0, -AUTOCORRELATION], white)
        joints.append(replace(rows, torque=torque + noise))
    regression = Regression(tuple(joints), plain.parameters)
    return regression.with_columns(columns) if columns else regression


def _true_values(
    data: Baseline,
    arm: str,
    study: Study,
    mass: float,
    loaded: Sequence[int],
    random: np.random.Generator,
) -> FloatArray:
    """Base parameters (b,) of the true robot with its payload."""
    model = data.prepared.model
    layout = model.regressor.layout
    given = model.robot.given
    inertial = np.array([_off(link, study.inertials, random) for link in given.inertial])
    vector = layout.vector(replace(given, inertial=inertial))
    last = layout.joints - 1
    x, y, z = centre = np.array(LOAD_CENTRE[arm])
    inertia = mass * (centre @ centre * np.eye(3) - np.outer(centre, centre))
    inertia += 0.4 * mass * RADIUS**2 * np.eye(3)
    moments = {f"{'XYZ'[a]}{'XYZ'[b]}": inertia[a, b] for a in range(3) for b in range(a, 3)}
    body = {"M": mass, "MX": mass * x, "MY": mass * y, "MZ": mass * z, **moments}
    for place, each in enumerate(layout.parameters):
        if each.kind in _OF_DRIVES:
            vector[place] *= 1.0 + study.friction * random.uniform(-1.0, 1.0)
        if each.kind == "Fc" and each.joint in loaded:
            vector[place] *= 1.0 + study.coulomb * random.choice([-1.0, 1.0])
        if each.kind in body and each.joint == last:
            vector[place] += body[each.kind]
    return model.base.from_standard(vector)


def _off(values: FloatArray, error: float, random: np.random.Generator) -> FloatArray:
    """A link (10,) whose mass, inertia and centre of mass are off."""
    link = pin.Inertia.FromDynamicParameters(values)
    mass, inertia = 1.0 + error * random.uniform(-1.0, 1.0, 2)
    centre = link.lever + error * _CENTRE * random.uniform(-1.0, 1.0, 3)
    return np.asarray(
        pin.Inertia(link.mass * mass, centre, link.inertia * inertia).toDynamicParameters()
    )
