"""The work on one bag, as it runs on a worker: it may run twice, and knows of no other bag."""

import tempfile
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from idim_iv_ros.configuration import Configuration
from idim_iv_ros.errors import DataError, IdimError, UsageError
from idim_iv_ros.fleet.bag_result import BagResult, Status
from idim_iv_ros.fleet.content import configuration_digest, content_of
from idim_iv_ros.fleet.regression import bag_fields
from idim_iv_ros.fleet.remote import StoreError, local_path, open_bag
from idim_iv_ros.identification.prepare import configured_request
from idim_iv_ros.recording.bags.folder import Bag
from idim_iv_ros.recording.segments import read_segments


@dataclass(frozen=True)
class Robot:
    """A configuration with the text of its robot description: all that a worker needs.

    Attributes
    ----------
    configuration : Configuration
    description : bytes
        Of the URDF or MJCF; empty where the bags have it.
    digest : str
        Of both.
    """

    configuration: Configuration
    description: bytes
    digest: str

    @classmethod
    def of(cls, configuration: Configuration) -> "Robot":
        """Read the robot description of a configuration."""
        path = configuration.robot.description
        description = b"" if path is None else path.read_bytes()
        return cls(configuration, description, configuration_digest(configuration, description))

    def local(self) -> Configuration:
        """Return the configuration with a robot description on this machine."""
        path = self.configuration.robot.description
        if path is None or (path.is_file() and path.read_bytes() == self.description):
            return self.configuration
        if self.configuration.robot.mjcf is not None:
            raise DataError(
                f"{path}: an MJCF file reads others beside it, so that every worker needs the "
                "same folder; put it where all of them see it"
            )
        urdf = _kept(path.name, self.description)
        robot = self.configuration.robot.model_copy(update={"urdf": urdf})
        return self.configuration.model_copy(update={"robot": robot})


_folders: list[tempfile.TemporaryDirectory[str]] = []  # until the worker ends


@cache
def _kept(name: str, description: bytes) -> Path:
    folder = tempfile.TemporaryDirectory(prefix="idim_iv_")
    _folders.append(folder)
    path = Path(folder.name) / name
    path.write_bytes(description)
    return path


def content_task(uri: str) -> BagResult:
    """Return a bag with the digest of its content, or why it cannot be read.

    Raises
    ------
    UsageError
        Its store can be asked for no bag at all.
    """
    status: Status
    try:
        return BagResult(uri=uri, content=content_of(uri), status="ok")
    except FileNotFoundError:
        status, reason = "missing", "no such file"
    except StoreError as error:
        raise UsageError(f"{uri}: {error.strerror}") from error
    except OSError as error:
        status, reason = "unusable", error.strerror or str(error)
    except IdimError as error:
        status, reason = "corrupt", str(error).removeprefix(f"{local_path(uri)}: ")
    return BagResult(uri=uri, content="", status=status, reason=reason)


def identify_task(uri: str, content: str, key: str, robot: Robot) -> BagResult:
    """Identify one bag; whatever is wrong with it is in the result.

    A bag without a topic that can be read, or with damages, is corrupt.

    Raises
    ------
    OSError
        Its store does not answer: later it may.
    """
    bag = Bag(Path(uri))
    try:
        bag = open_bag(uri)
        configuration = robot.local()
        request = configured_request(configuration)
        fields = bag_fields(read_segments(bag, request), configuration)
    except IdimError as error:
        torn = isinstance(error, DataError) and (bag.damages or not bag.topics)
        # The name of the bag is beside it.
        reason = str(error).removeprefix(f"{bag.path}: ")
        fields = {"status": "corrupt" if torn else "unusable", "reason": reason}
    return BagResult(**{"uri": uri, "content": content, "key": key, "status": "ok"} | fields)
