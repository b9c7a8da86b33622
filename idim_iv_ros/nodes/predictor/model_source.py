"""Where the identified model comes from: a file, or the newest result of the identifier."""

from dataclasses import dataclass
from pathlib import Path

from idim_iv_ros.configuration import Configuration
from idim_iv_ros.errors import IdimError
from idim_iv_ros.files import RESULT
from idim_iv_ros.model import InverseModel, build_inverse_model, read_urdf_file, read_urdf_text
from idim_iv_ros.nodes.identifier.estimate_history import EstimateHistory
from idim_iv_ros.nodes.identifier.job import ESTIMATORS
from idim_iv_ros.prediction import IdentifiedModel, identified_model

WAITING = "no result yet: identify the robot, or set the parameter result"
_ADVICE = "output_directory must be that of the identifier, on the same machine"


@dataclass(frozen=True)
class _Described:
    """A URDF as a model; `links` are the links that the joints carry."""

    text: str
    source: str
    model: InverseModel
    links: tuple[str, ...]


class ModelSource:
    """Reads a result when there is a new one.

    `output_directory` is that of the identifier.

    `stamp`: when its identification ended, ns since 1970. `reason`: why there is no model, or why a
    newer result was refused; else empty.
    """

    def __init__(self, configuration: Configuration, output_directory: Path) -> None:
        self._configuration, self._directory = configuration, output_directory
        self._described: _Described | None = None
        self._announced: tuple[Path, int] | None = None
        self._read: tuple[Path, int, str] | None = None
        self.identified: IdentifiedModel | None = None
        self.stamp = 0
        self.reason = WAITING
        path = configuration.robot.description
        if path is not None:
            self._describe(read_urdf_file(path), str(path))
        self._announce_kept()

    @property
    def links(self) -> tuple[str, ...]:
        """Link that each joint carries; empty before there is a URDF."""
        return () if self._described is None else self._described.links

    @property
    def needs_description(self) -> bool:
        """Whether the URDF has to come from a topic."""
        return self._configuration.robot.description is None

    def describe(self, text: str, source: str) -> None:
        """Take the URDF of a topic."""
        if self._described is None or self._described.text != text:
            self._read = None
            try:
                self._describe(text, source)
            except IdimError as error:
                self.identified, self.reason = None, str(error)

    def announce(self, file: str, stamp: int) -> None:
        """Take note of a result of the identifier: a file relative to its output directory."""
        self._announced = self._directory / file, stamp

    def look(self, pinned: str) -> bool:
        """Read the result if it is new; whether `identified` is another one now.

        `pinned` is the file of the user's choice; empty for the newest that was announced.
        """
        if self._described is None:
            self.reason = "no URDF: none in the configuration, and none on robot_description yet"
            return False
        wanted = (Path(pinned), 0) if pinned else self._announced
        if wanted is None:
            return self._refused(WAITING, None)
        path, stamp = wanted
        try:
            written = path.stat().st_mtime_ns
        except OSError as error:
            advice = "set the parameter result" if pinned else _ADVICE
            return self._refused(f"{path}: {error.strerror or error}: {advice}", None)
        content = (path, written, self._described.text)
        if content == self._read:
            return False
        try:
            self.identified = identified_model(
                path, self._configuration, self._described.model, self._described.source
            )
        except IdimError as error:
            return self._refused(str(error), content)
        self._read, self.reason, self.stamp = content, "", stamp or written
        return True

    def _refused(self, reason: str, content: tuple[Path, int, str] | None) -> bool:
        """Give up what another file said: a user who names a file wants that one."""
        self.reason, self._read = reason, content
        changed, self.identified = self.identified is not None, None
        return changed

    def _describe(self, text: str, source: str) -> None:
        model = build_inverse_model(self._configuration, text, source)
        carried = {
            joint.name: link
            for link, joint in read_urdf_text(text, source).outward()
            if joint is not None
        }
        links = tuple(carried[joint] for joint in self._configuration.robot.joints)
        self._described = _Described(text, source, model, links)

    def _announce_kept(self) -> None:
        """Find the newest result that the identifier's history keeps of its own kind."""
        try:
            entries = EstimateHistory(self._directory).entries
        except IdimError:
            return  # what the identifier cannot read either, it says itself
        of_node = [entry for entry in entries if not entry.configuration]
        newest = [entry for entry in of_node if entry.estimator == ESTIMATORS[0]] or of_node
        if newest:
            self.announce(f"{newest[-1].folder}/{RESULT}", newest[-1].stamp)
