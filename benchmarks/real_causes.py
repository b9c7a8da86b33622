"""Real recordings whose cause is known, withheld from the nominal model or from the effort.

    python -m benchmarks.real_causes [--only NAME]… [--keep FOLDER] [--write]

Each case is a set of recordings with a configuration in which one thing is wrong or missing, and
most have a control: the same robot with that thing in its place. What is named in a case and not
in its control was brought about by what was withheld: it is either that, or false. Effects that
both name are properties of the robot; where no other source says anything of them they are listed
as unconfirmed, not as right. `--write` makes benchmarks/results/real_causes.md; `--keep` leaves
every gap.json in a folder, from which an interrupted run goes on.
"""

import argparse
import os
import re
import sys
import tempfile
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import yaml

from benchmarks.measurement import write_page
from idim_iv_ros import load_configuration, write_bag
from idim_iv_ros.diagnosis.diagnose import diagnose
from idim_iv_ros.diagnosis.result.document import GapResult
from idim_iv_ros.recording.writing.write import JointTopic
from tests.real import recordings

ROOT = Path(__file__).resolve().parents[1]
DATA = ROOT.parent / "shared" / "data"
RESULTS = ROOT / "benchmarks" / "results" / "real_causes.md"

Name = tuple[str, str | None]


@dataclass(frozen=True)
class Case:
    """Recordings, and what is known of them.

    Attributes
    ----------
    name : str
    truth : str
        What is withheld, and what is known of it.
    make : callable
        From the folder of the data and an empty folder to bags and a configuration.
    expected : tuple of (effect, joint)
        Names that are right; one is enough for each inner tuple. A joint of None stands for any.
    control : str
        Case that has what this one lacks.
    documented : dict of effect to str
        Effects that another source confirms: which.
    contradicted : tuple of str
        Effects that the recording is known not to have.
    says : tuple of str
        Words of the summary or of a note without which the case is missed.
    outside : bool
        Whether the truth is outside of the catalogue: "not in the catalogue" or "unexplained" is
        the answer that is wanted. It is no hit, for it does not say what the truth is.
    """

    name: str
    truth: str
    make: Callable[[Path, Path], tuple[Sequence[Path], Path]]
    expected: tuple[tuple[Name, ...], ...] = ()
    control: str = ""
    documented: dict[str, str] = field(default_factory=dict)
    contradicted: tuple[str, ...] = ()
    says: tuple[str, ...] = ()
    outside: bool = False


@dataclass(frozen=True)
class Outcome:
    """What was said in one case."""

    case: Case
    result: GapResult

    @property
    def seconds(self) -> float:
        """What the diagnosis took."""
        return sum(self.result.timing.values())

    @property
    def names(self) -> list[Name]:
        """Every cause, by effect and joint."""
        return [(cause.effect, cause.joint) for cause in self.result.causes]

    @property
    def hits(self) -> int:
        """How many of what is expected was named or said."""
        named = sum(any(_is(name, self.names) for name in names) for names in self.case.expected)
        return named + sum(words in self._text for words in self.case.says)

    @property
    def wanted(self) -> int:
        """How many there are."""
        return len(self.case.expected) + len(self.case.says)

    @property
    def left_open(self) -> bool:
        """Whether something is said to be outside of the catalogue."""
        return self.result.unexplained is not None or "Unexplained residual" in self.result.summary

    @property
    def _text(self) -> str:
        return " ".join((self.result.summary, *self.result.notes))

    def false(self, control: "Outcome | None") -> list[Name]:
        """Names that are known to be wrong."""
        right = [name for names in self.case.expected for name in names]
        in_control = set() if control is None else {effect for effect, _ in control.names}
        wrong = []
        for name in self.names:
            if any(_same(wanted, name) for wanted in right) or name[0] in self.case.documented:
                continue
            brought = control is not None and name[0] not in in_control
            if brought or name[0] in self.case.contradicted:
                wrong.append(name)
        return wrong

    def undocumented(self, control: "Outcome | None") -> list[Name]:
        """Structural effects of which no other source says anything."""
        right = [name for names in self.case.expected for name in names]
        false = self.false(control)
        return [
            (cause.effect, cause.joint)
            for cause in self.result.causes
            if cause.kind == "structural"
            and cause.effect not in self.case.documented
            and (cause.effect, cause.joint) not in false
            and not any(_same(wanted, (cause.effect, cause.joint)) for wanted in right)
        ]


def _same(wanted: Name, named: Name) -> bool:
    return wanted[0] == named[0] and wanted[1] in (None, named[1])


def _is(wanted: Name, named: Iterable[Name]) -> bool:
    return any(_same(wanted, name) for name in named)


def _written(folder: Path, name: str, text: str) -> Path:
    path = folder / name
    path.write_text(text)
    return path


def _emps(data: Path, folder: Path) -> tuple[Sequence[Path], Path]:
    return [recordings.emps_bag(data, folder / "emps.mcap")], ROOT / "config" / "emps.yaml"


def _pulses(data: Path, folder: Path) -> tuple[Sequence[Path], Path]:
    bag = recordings.emps_with_pulses(data, folder / "emps_pulses.mcap")
    return [bag], ROOT / "config" / "emps.yaml"


def _tx40(change: tuple[str, str]) -> Callable[[Path, Path], tuple[Sequence[Path], Path]]:
    def make(data: Path, folder: Path) -> tuple[Sequence[Path], Path]:
        from tests.real.recordings import TX40

        urdf = data / "staubli_tx40" / "tx40_mdh_modified.urdf"
        text = TX40.replace(*change).format(urdf=urdf)
        bag = recordings.tx40_bag(data, folder / "tx40.mcap")
        return [bag], _written(folder, "tx40.yaml", text)

    return make


def _ur10(data: Path, folder: Path) -> tuple[Sequence[Path], Path]:
    bag = data / "unisa_ur10" / "ur10_exciting_trajectory.db3"
    return [bag], ROOT / "config" / "ur10.yaml"


def _kuka(link: str) -> Callable[[Path, Path], tuple[Sequence[Path], Path]]:
    def make(data: Path, folder: Path) -> tuple[Sequence[Path], Path]:
        text = recordings.KUKA.format(urdf=data / "kuka_kr300" / "kr300.urdf")
        return recordings.kuka_bags(data, folder, link=link), _written(folder, "kr300.yaml", text)

    return make


# Friction of the two drives (shoulder, elbow), N m and N m s/rad: least squares of the recordings
# with everything in the effort, so that a nominal model has it.
_FRICTION = {
    "acrobot": ((0.161, 0.139), (0.002, 0.008)),
    "pendubot": ((0.095, 0.125), (0.008, 0.007)),
}
_FULL = {"tau_con": 1.0, "tau_pert": 1.0}
_WITHOUT_PULSES = {"tau_con": 1.0}
_WITHOUT_COMPENSATION = {**_FULL, "tau_fric": -1.0}


# Links of the double pendulum by design: lengths, m, and the published model.
_DESIGNS = {
    "A": ((0.3, 0.2), "design_A0/model_2.1.yml"),
    "C": ((0.2, 0.3), "design_C0/model_3.1.yml"),
}
_LINK = """
<link name="{name}"><inertial><origin xyz="{lever} 0 0"/><mass value="{mass}"/>
<inertia ixx="0.00001" iyy="{inertia}" izz="{inertia}"
ixy="0" ixz="0" iyz="0"/></inertial></link>"""
_JOINT = """
<joint name="{name}" type="continuous"><parent link="{parent}"/><child link="{child}"/>
<origin xyz="{along} 0 0" rpy="{turned}"/><axis xyz="0 0 1"/><limit velocity="30" effort="10"/>
<dynamics friction="{friction}" damping="{damping}"/></joint>"""
_PENDULUM = """
robot:
  name: double_pendulum
  urdf: {urdf}
  joints: [shoulder, elbow]
simulator:
  armature: [0.0, 0.0]
controller:
  type: unknown
processing:
  position_cutoff: 20.0
  decimation_cutoff: 8.0
  minimum_speed: [0.1, 0.1]
"""


def _pendulum_urdf(
    data: Path,
    design: str,
    friction: tuple[float, float] = (0.0, 0.0),
    damping: tuple[float, float] = (0.0, 0.0),
) -> str:
    """URDF of a design's published model; inertias there are about the joint."""
    (upper, _), file = _DESIGNS[design]
    model = yaml.safe_load((data / "dfki_double_pendulum" / file).read_text())
    links = []
    for number, name in ((1, "upper"), (2, "lower")):
        mass, lever = model[f"m{number}"], model[f"r{number}"]
        inertia = max(model[f"I{number}"] - mass * lever**2, 1e-5)
        links.append(_LINK.format(name=name, lever=lever, mass=mass, inertia=inertia))
    quarter = "1.5707963267948966 1.5707963267948966 0"
    keys = ("name", "parent", "child", "along", "turned", "friction", "damping")
    tree = (("shoulder", "base", "upper", 0, quarter), ("elbow", "upper", "lower", upper, "0 0 0"))
    joints = [
        _JOINT.format(**dict(zip(keys, (*row, *losses), strict=True)))
        for row, losses in zip(tree, zip(friction, damping, strict=True), strict=True)
    ]
    whole = "".join(['<link name="base"/>', *links, *joints])
    return f'<robot name="double_pendulum">{whole}</robot>'


def _pendulum_bag(file: Path, out: Path, terms: dict[str, float]) -> Path:
    """Positions, velocities and an effort that is the sum of some channels.

    Parameters
    ----------
    terms
        Factor of each channel: ``tau_con``, ``tau_pert``, ``tau_fric``, ``tau_meas``.
    """
    names = file.read_text().split("\n", 1)[0].strip().split(",")
    table = np.loadtxt(file, delimiter=",", skiprows=1)
    columns = dict(zip(names, table.T, strict=True))

    def both(name: str) -> np.ndarray:
        return np.column_stack([columns[f"{name}1"], columns[f"{name}2"]])

    effort = np.asarray(sum(factor * both(name) for name, factor in terms.items()))
    signals = both("pos_meas"), both("vel_meas"), effort
    write_bag(out, [JointTopic("/joint_states", ["shoulder", "elbow"], columns["time"], *signals)])
    return out


def _perturbed(
    kind: str, terms: dict[str, float]
) -> Callable[[Path, Path], tuple[Sequence[Path], Path]]:
    def make(data: Path, folder: Path) -> tuple[Sequence[Path], Path]:
        files = sorted((data / "dfki_double_pendulum" / "perturbed").glob(f"{kind}_*.csv"))
        bags = [_pendulum_bag(file, folder / f"{file.stem}.mcap", terms) for file in files]
        _written(folder, "c.urdf", _pendulum_urdf(data, "C", *_FRICTION[kind]))
        return bags, _written(folder, "c.yaml", _PENDULUM.format(urdf="c.urdf"))

    return make


def _design(recorded: str, model: str) -> Callable[[Path, Path], tuple[Sequence[Path], Path]]:
    def make(data: Path, folder: Path) -> tuple[Sequence[Path], Path]:
        files = sorted((data / "dfki_double_pendulum" / f"design_{recorded}0").glob("*.csv"))
        bags = [
            _pendulum_bag(file, folder / f"{file.stem}.mcap", {"tau_meas": 1.0}) for file in files
        ]
        _written(folder, "links.urdf", _pendulum_urdf(data, model))
        return bags, _written(folder, "links.yaml", _PENDULUM.format(urdf="links.urdf"))

    return make


def _servo(recorded: int, law: int) -> Callable[[Path, Path], tuple[Sequence[Path], Path]]:
    def make(data: Path, folder: Path) -> tuple[Sequence[Path], Path]:
        urdf = _written(folder, "xl330.urdf", recordings.SERVO_URDF)
        text = recordings.servo_configuration(law, urdf)
        return recordings.servo_bags(data, folder, recorded), _written(folder, "xl330.yaml", text)

    return make


_DRIVES = {"friction_level": "the nominal model has none", "drive_inertia": "none is given"}
_EMPS_DOCUMENTED = {
    "payload": "the nominal axis has 1 kg, 95 are published",
    "friction_level": "the nominal model has none",
}
_SERVO_DOCUMENTED = {
    "load_dependent_friction": "in the published model m6",
    "stribeck": "in the published models m2 and m6",
}
_BOTH = (("friction_level", "shoulder"),), (("friction_level", "elbow"),)
_LINKS = ("link_inertia", None), ("payload", None)
_PENDULUM_DOCUMENTED = {
    "link_inertia": "least squares finds 0.06 kg m² about the shoulder, 0.049 are published",
    "drive_inertia": "least squares finds 0.004 to 0.008 kg m² at the elbow, none is published",
}
# The drives have no gear that could bend.
_DIRECT = ("elasticity", "backlash")
_NO_FRICTION = {"friction_level": "the nominal model has none", **_PENDULUM_DOCUMENTED}


def _disturbed(name: str, pulses: float) -> tuple[Case, Case, Case]:
    """Arm with disturbances and a friction compensation known sample by sample; pulses in N m."""
    control = f"{name}, everything in the effort"
    every = Case(
        control,
        "control: command and disturbance",
        _perturbed(name, _FULL),
        documented=_PENDULUM_DOCUMENTED,
        contradicted=_DIRECT,
    )
    return (
        every,
        replace(
            every,
            name=f"{name}, disturbance missing",
            truth=f"torques of up to {pulses} N m that are not in the effort",
            make=_perturbed(name, _WITHOUT_PULSES),
            control=control,
            outside=True,
        ),
        replace(
            every,
            name=f"{name}, compensation subtracted",
            truth="friction of up to 0.27 N m is missing from the effort of both drives",
            make=_perturbed(name, _WITHOUT_COMPENSATION),
            expected=_BOTH,
            control=control,
        ),
    )


CASES = (
    Case(
        "emps",
        "asymmetric friction (published); the law reproduces the command to 0.0037 V",
        _emps,
        expected=((("asymmetric_friction", "axis"),),),
        documented=_EMPS_DOCUMENTED,
        contradicted=("controller_mismatch", "torque_saturation", "elasticity", "backlash"),
    ),
    Case(
        "emps, pulses in the command",
        "four pulses of ±70 N for 0.25 s that the law does not contain",
        _pulses,
        expected=((("asymmetric_friction", "axis"),),),
        control="emps",
        documented=_EMPS_DOCUMENTED,
        contradicted=("controller_mismatch",),
        says=("beyond the control law",),
    ),
    Case("tx40", "nothing withheld", _tx40(("", "")), documented=_DRIVES),
    Case(
        "tx40, coupling left out",
        "the drives of joints 5 and 6 are coupled",
        _tx40(("  couplings:\n    - joints: [joint_5, joint_6]\n", "  couplings: []\n")),
        expected=((("joint_coupling", "joint_5"), ("joint_coupling", "joint_6")),),
        control="tx40",
        documented=_DRIVES,
    ),
    Case(
        "tx40, gravity zero",
        "the robot stands on the floor",
        _tx40(("processing:", "  gravity: [0.0, 0.0, 0.0]\nprocessing:")),
        expected=((("gravity_direction", None),),),
        control="tx40",
        documented=_DRIVES,
    ),
    Case("ur10", "no answer is known; efforts in A, no inertials", _ur10),
    *_disturbed("acrobot", 0.74),
    *_disturbed("pendubot", 0.49),
    Case(
        "design C0 with its own model",
        "control; the model has no friction",
        _design("C", "C"),
        documented=_NO_FRICTION,
        contradicted=_DIRECT,
    ),
    Case(
        "design C0 with the model of A0",
        "only the links differ: lengths, masses, levers",
        _design("C", "A"),
        expected=(_LINKS,),
        control="design C0 with its own model",
        documented=_NO_FRICTION,
        contradicted=_DIRECT,
    ),
    Case(
        "design A0 with its own model",
        "control; the model has no friction",
        _design("A", "A"),
        documented=_NO_FRICTION,
        contradicted=_DIRECT,
    ),
    Case(
        "kr300",
        "gears of 4.58, 7.52, 4.10 · 10⁶ N m/rad (published), encoders 2.6 to 3.2 ms apart",
        _kuka("encoders"),
        expected=tuple((("elasticity", joint),) for joint in ("j1", "j2", "j3")),
    ),
    Case(
        "kr300, a time offset alone",
        "the motor's encoder 3 ms late, with noise, in place of the one behind the gear",
        _kuka("late"),
        contradicted=("elasticity", "backlash"),
        says=("which is no elasticity",),
    ),
    *(
        Case(
            f"xl330, gain {gain}, its own law",
            "control; no torque is recorded, the voltage of the bridge stands for it",
            _servo(gain, gain),
            documented=_SERVO_DOCUMENTED,
            contradicted=("controller_mismatch", "torque_saturation"),
        )
        for gain in (100, 200, 400)
    ),
    *(
        Case(
            f"xl330, gain {gain}, law of {law}",
            f"the gain is {gain / law:g} times that of the law",
            _servo(gain, law),
            expected=((("controller_mismatch", "servo"),),),
            control=f"xl330, gain {gain}, its own law",
            documented=_SERVO_DOCUMENTED,
            contradicted=("torque_saturation",),
        )
        for gain, law in ((100, 200), (200, 400), (400, 100), (200, 100))
    ),
)


def run(cases: Sequence[Case], keep: Path | None) -> dict[str, Outcome]:
    """Diagnose the cases that are not kept yet, each control before what is compared with it."""
    outcomes = {}
    for case in cases:
        kept = None if keep is None else keep / re.sub(r"\W+", "_", case.name) / "gap.json"
        if kept is None or not kept.is_file():
            with tempfile.TemporaryDirectory() as made:
                bags, configuration = case.make(DATA, Path(made))
                result = diagnose(list(bags), load_configuration(configuration))
            if kept is not None:
                kept.parent.mkdir(parents=True, exist_ok=True)
                result.write(kept)
        else:
            result = GapResult.read(kept)
        outcomes[case.name] = Outcome(case, result)
        print(_line(outcomes[case.name], outcomes), flush=True)
    return outcomes


def _line(outcome: Outcome, outcomes: dict[str, Outcome]) -> str:
    control = outcomes.get(outcome.case.control)
    cells = [
        outcome.case.name,
        outcome.case.truth,
        _score(outcome),
        _listed(outcome.false(control)),
        _listed(outcome.undocumented(control)),
        outcome.result.verdict,
        f"{outcome.seconds:.0f}",
    ]
    return "| " + " | ".join(cells) + " |"


def _score(outcome: Outcome) -> str:
    if outcome.case.outside:
        return "left open" if outcome.left_open else "not said"
    return f"{outcome.hits} of {outcome.wanted}" if outcome.wanted else "–"


def _listed(names: Iterable[Name]) -> str:
    joints: dict[str, list[str]] = {}
    for effect, joint in names:
        joints.setdefault(effect, []).append(joint or "")
    shown = [f"{effect} {', '.join(filter(None, at))}".strip() for effect, at in joints.items()]
    return "; ".join(shown) or "–"


def table(outcomes: dict[str, Outcome]) -> list[str]:
    """Lines of the results file."""
    wanted = sum(outcome.wanted for outcome in outcomes.values())
    hits = sum(outcome.hits for outcome in outcomes.values())
    false = sum(
        len(outcome.false(outcomes.get(outcome.case.control))) for outcome in outcomes.values()
    )
    head = ("case", "what is known", "found", "false", "unconfirmed", "verdict", "s")
    return [
        f"{hits} of {wanted} known causes were found; false names: {false}. Unconfirmed: "
        "effects that are also named where nothing is withheld, or of which no other source says "
        "anything. The recordings are not in the project: README says where they are published.",
        "",
        "| " + " | ".join(head) + " |",
        "|" + "---|" * len(head),
        *(_line(outcome, outcomes) for outcome in outcomes.values()),
    ]


def main() -> int:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", action="append", default=[], help="cases whose name holds this")
    parser.add_argument(
        "--keep",
        type=Path,
        help="folder of every gap.json: what is there already is not diagnosed again",
    )
    parser.add_argument("--write", action="store_true", help=f"write {RESULTS.name}")
    options = parser.parse_args()
    if not DATA.is_dir():
        print(f"no real recordings at {DATA}; README says where they are published")
        return 1
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    chosen = [case for case in CASES if any(part in case.name for part in options.only)]
    outcomes = run(chosen or CASES, options.keep)
    if options.write:
        write_page("real_causes", "Real recordings of known cause", table(outcomes))
    return 0


if __name__ == "__main__":
    sys.exit(main())
