"""From bags to filtered motion and a model: what precedes every estimate and every check."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from idim_iv_ros.configuration import Configuration
from idim_iv_ros.errors import DataError, UsageError
from idim_iv_ros.estimation.least_squares import unseen_parameters
from idim_iv_ros.estimation.rows import JointRows
from idim_iv_ros.files import FilePaths
from idim_iv_ros.identification.sanity import JointFinding, joint_findings, repeats_motion
from idim_iv_ros.model import InverseModel, build_inverse_model, read_urdf_file, read_urdf_text
from idim_iv_ros.progress import Progress
from idim_iv_ros.recording.read import read_requested
from idim_iv_ros.recording.recording import Recording, Session, session_of
from idim_iv_ros.recording.request import Request
from idim_iv_ros.signals.cutoffs import Cutoffs, choose_cutoffs
from idim_iv_ros.signals.joint_side import joint_side
from idim_iv_ros.signals.motion import Motion, filter_motion
from idim_iv_ros.types import FloatArray

if TYPE_CHECKING:
    from idim_iv_ros.identification.result import BagSummary

ARMATURE_MISSING = (
    "no simulator.armature is given: the drives of the nominal model have no inertia; give it in "
    "kg m² on the joint side, zeros for direct drives"
)
_LOCKED = 0.05  # rad (m) by which a locked joint may move: it sways under its load
_REPEATED = (
    "its references repeat the measured positions, which no motion follows so closely: they are "
    "left out; give the topic on which the controller gets its references as signals.reference"
)


@dataclass(frozen=True)
class PreparedRegression:
    """Everything that the rows of the regression are made from.

    `session`: the recordings in their order, and the time that they share. `minimum_speed`:
    (n_joints,) rad/s. `still`: joints that stand still in all recordings. `reasons`: what was
    proposed or decided while filtering, and why. `advice`: what to add to the configuration,
    because the recordings hold more than it names.
    """

    configuration: Configuration
    session: Session
    model: InverseModel
    cutoffs: Cutoffs
    minimum_speed: FloatArray
    motions: tuple[Motion, ...]
    still: tuple[str, ...]
    reasons: tuple[str, ...]
    advice: tuple[str, ...] = ()

    @property
    def recordings(self) -> tuple[Recording, ...]:
        """The recordings in the order of the session, as `motions`."""
        return self.session.recordings

    @property
    def why_no_given(self) -> str:
        """Why there is no nominal model to compare with; empty where there is one."""
        if not self.model.robot.has_inertials:
            return "the URDF gives no inertia: there is no nominal model to compare with"
        unit = self.configuration.signals.effort_unit
        if unit != "N m":
            return (
                f"efforts are in {unit} and the nominal model is in N m, so that they are not "
                "compared; to compare them, give torque constant times gear ratio as "
                "signals.effort_scale, and effort_unit N m"
            )
        return ""

    @property
    def given(self) -> FloatArray | None:
        """Base parameters (b,) of the nominal model; None where `why_no_given` says so."""
        return None if self.why_no_given else self.model.given

    @property
    def armature_missing(self) -> bool:
        """Whether the nominal model has drives without inertia because nothing was said of it."""
        drives = self.configuration.identification.drive_inertia
        return drives and not self.why_no_given and not self.model.robot.armature_given

    @property
    def doubts(self) -> tuple[str, ...]:
        """Sentences on what makes the nominal model hard to believe."""
        missing = (ARMATURE_MISSING,) if self.armature_missing else ()
        return (*self.model.robot.doubts, *missing)

    @cached_property
    def joint_findings(self) -> tuple[JointFinding, ...]:
        """What is wrong with the signals of single joints."""
        unit = self.configuration.signals.effort_unit
        return joint_findings(self.model, self.motions, self.cutoffs, unit)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Sentences of doubt about the nominal model, and on what is wrong with the signals."""
        joints, wrong = self.configuration.robot.joints, self.joint_findings
        return self.doubts + tuple(f"{joints[of.joint]}: {of.sentence}" for of in wrong)


def prepare(recordings: Sequence[Recording], configuration: Configuration) -> PreparedRegression:
    """Build the model and filter the motion: everything that precedes an estimate.

    Recordings are put in the order of their session first (`session_of`): the order in which they
    are given changes nothing.

    Raises UsageError or DataError: see `build_inverse_model`, `choose_cutoffs`, `filter_motion`;
    or a joint that the model locks moves others.
    """
    session = session_of(recordings)
    recordings = session.recordings
    urdf, source = description_text(configuration, recordings)
    model = build_inverse_model(configuration, urdf, source)
    for recording in recordings:
        for name in model.robot.carriers:
            low, high = recording.other_positions.get(name, (0.0, 0.0))
            if high - low > _LOCKED:
                raise DataError(
                    f"{recording.path.name}: {name} carries other joints and moves from "
                    f"{low:.3g} to {high:.3g}, and robot.joints leaves it out, which locks it: "
                    "add it to robot.joints, or record with it at rest"
                )
    records = [joint_side(recording, configuration) for recording in recordings]
    repeating = []
    for place, record in enumerate(records):
        reference, servo = record.position_reference, configuration.signals.effort_topic is None
        if reference is not None and not servo and repeats_motion(record.position, reference):
            repeating.append(f"{record.name}: {_REPEATED}")
            records[place] = replace(record, position_reference=None, velocity_reference=None)
    source = str(configuration.source or "the configuration")
    cutoffs = choose_cutoffs(configuration.processing, records, source)
    couplings = model.regressor.layout.coupling_joints
    motions, minimum_speed, still, reasons = filter_motion(
        records, configuration.processing, cutoffs, configuration.robot.joints, couplings
    )
    return PreparedRegression(
        configuration=configuration,
        session=session,
        model=model,
        cutoffs=cutoffs,
        minimum_speed=minimum_speed,
        motions=motions,
        still=still,
        reasons=(
            *session.sentences,
            *repeating,
            *cutoffs.reasons,
            *reasons,
            *loss_sentences(recordings),
        ),
        advice=_advice(recordings, configuration),
    )


def _advice(recordings: Sequence[Recording], configuration: Configuration) -> tuple[str, ...]:
    """Say which line makes an unused topic the reference, where every recording has one."""
    first, *others = (recording.unused_references for recording in recordings)
    common = [topic for topic in first if all(topic in other for other in others)]
    if not common:
        return ()
    source = configuration.source.name if configuration.source else "the configuration"
    either = "" if len(common) == 1 else f" (or {', '.join(common[1:])})"
    return (
        f"{recordings[0].path.name} holds positions of all joints on {common[0]}{either} and "
        f"nothing uses them; if that is the reference of the control, write "
        f"`reference: {common[0]}` under `signals:` in {source}",
    )


def loss_sentences(recordings: Sequence["Recording | BagSummary"]) -> tuple[str, ...]:
    """Say what measurements of each recording were lost, or left out because a channel froze."""
    sentences: list[str] = []
    for recording in recordings:
        lost = [note.sentence for note in recording.notes if note.limits]
        lost += [interval.sentence for interval in recording.frozen]
        sentences += [f"{Path(recording.path).name}: {sentence}" for sentence in lost]
    return tuple(sentences)


def read_configured(
    bags: FilePaths, configuration: Configuration, progress: Progress | None = None
) -> tuple[Recording, ...]:
    """Read the topics and joints of a configuration; see `read_recordings`."""
    return read_requested(bags, configured_request(configuration), progress)


def configured_request(configuration: Configuration) -> Request:
    """Return what a configuration asks of each bag."""
    signals = configuration.signals
    urdf = configuration.robot.description
    prismatic: frozenset[str] = frozenset()
    # Behind a transmission the positions are angles of motors, whatever the joints are.
    if urdf is not None and configuration.robot.motor_to_joint is None:
        joints = read_urdf_text(*description_text(configuration, ())).joints.values()
        prismatic = frozenset(joint.name for joint in joints if joint.type == "prismatic")
    return Request(
        joints=configuration.robot.joints,
        joint_states=signals.joint_states,
        effort=signals.effort_topic,
        reference=signals.reference,
        prismatic=prismatic,
        link_states=signals.link_states,
        node_topics=configuration.node_topics,
    )


def require_excitation(prepared: PreparedRegression, rows: Sequence[JointRows]) -> None:
    """Refuse rows that cannot determine the base parameters, and list those they cannot.

    Raises DataError: a joint without rows, or parameters that the motion does not show.
    """
    names = prepared.model.base.names
    where = ", ".join(recording.path.name for recording in prepared.recordings)
    for joint, speed in zip(rows, prepared.minimum_speed, strict=True):
        if len(joint) == 0:
            raise DataError(
                f"{where}: {joint.name} has no usable sample (it never exceeds {speed:.3g} rad/s, "
                "or nothing was measured); record a motion of this joint or leave it out of "
                "robot.joints"
            )
    unseen = unseen_parameters(rows, len(names))
    if unseen:
        listed = ", ".join(names[column] for column in unseen)
        still = ", ".join(prepared.still)
        because = f" ({still} stands still)" if still else ""
        way_out = f", or leave {still} out of robot.joints, which locks it" if still else ""
        raise DataError(
            f"{where}: the excitation is rank deficient{because}: {listed} cannot be separated "
            f"from the other parameters; record a richer motion of all joints{way_out}"
        )


def description_text(
    configuration: Configuration, recordings: Sequence[Recording]
) -> tuple[str, str]:
    """URDF of the robot, of the configuration or else of a recording, and what to call it.

    Raises UsageError: there is none, or it cannot be read.
    """
    path = configuration.robot.description
    if path is not None:
        return read_urdf_file(path), str(path)
    for recording in recordings:
        if recording.robot_description is not None:
            return recording.robot_description, f"{recording.path.name} robot_description"
    raise UsageError(
        f"{configuration.source}: robot.urdf is not given and no bag has /robot_description"
    )
