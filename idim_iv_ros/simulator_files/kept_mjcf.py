"""The files of an export whose nominal model is an MJCF: the user's file with other values."""

from idim_iv_ros.configuration import Configuration
from idim_iv_ros.errors import UsageError
from idim_iv_ros.model.mjcf import mjcf_as_urdf
from idim_iv_ros.model.urdf_reader import decoded_urdf
from idim_iv_ros.simulator_files.changes import changes_text
from idim_iv_ros.simulator_files.findings import (
    ISAAC_LAB,
    Exported,
    Findings,
    Texts,
    require_read_back,
)
from idim_iv_ros.simulator_files.mjcf_values import with_mjcf_values
from idim_iv_ros.simulators.effects_file import EffectsFile


def kept_mjcf(made: Exported, what: Findings, configuration: Configuration) -> Texts:
    """Contents of all files; the MJCF is the user's, so that effects stay with the callbacks."""
    answer, source = what.answer, what.source
    if configuration.robot.couplings:
        raise UsageError(
            f"{configuration.source or 'configuration'}: robot.couplings: the coupled transmission "
            f"would be a tendon that {source} does not have: diagnose with the same robot as "
            "robot.urdf, whose export makes an MJCF with it"
        )
    written, more = with_mjcf_values(
        what.content,
        source,
        what.urdf,
        what.links,
        answer.robot.joints,
        what.drives,
        what.mounted,
    )
    require_read_back(mjcf_as_urdf(source, decoded_urdf(written)), configuration, what)
    notes = (
        *what.notes,
        *more,
        "everything else of the MJCF is as it was, actuators and time step too: they need not be "
        "the law of the configuration, which is in changes.md",
        "dry friction turns as early as in the recording, not 10 ms before the joint as with "
        "MuJoCo's default: that is solreffriction of the joints",
        f"there is no {ISAAC_LAB}: it needs a URDF",
    )
    if configuration.simulator.armature is not None:
        notes += ("the MJCF holds the armature now: leave out simulator.armature beside it",)
    effects = what.planted
    names = [file.name for file in made.files]
    texts = {
        made.mjcf: written,
        made.effects: EffectsFile(effects=effects, recordings=answer.bags).to_json().encode(),
        made.changes: changes_text(
            answer, effects, what.law, names, notes, randomization=what.randomization, file="MJCF"
        ).encode(),
    }
    return texts, effects, notes
