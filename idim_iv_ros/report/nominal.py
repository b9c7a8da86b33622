"""The nominal model of a result, read again: its geometry and its values."""

import json
from collections.abc import Mapping
from dataclasses import dataclass

from idim_iv_ros.configuration import Configuration
from idim_iv_ros.errors import one_line
from idim_iv_ros.model import InverseModel, build_inverse_model, read_urdf_file
from idim_iv_ros.model.skeleton import Skeleton, skeleton


@dataclass(frozen=True)
class Nominal:
    """What the configuration of a result and its URDF say.

    Attributes
    ----------
    configuration : Configuration or None
    model : InverseModel or None
    skeleton : Skeleton or None
    missing : str
        Why there is no model; empty where there is one.
    """

    configuration: Configuration | None
    model: InverseModel | None
    skeleton: Skeleton | None
    missing: str

    @property
    def is_mjcf(self) -> bool:
        """Whether the nominal model is an MJCF, which holds drive inertias too."""
        return self.configuration is not None and self.configuration.robot.mjcf is not None

    @property
    def urdf(self) -> str:
        """What to call the URDF in an instruction."""
        path = None if self.configuration is None else self.configuration.robot.description
        return "the URDF" if path is None else path.name


def read_nominal(document: Mapping[str, object]) -> Nominal:
    """Read the nominal model of a configuration as a result holds it.

    Where the URDF came with the recording or is not there any more, there is none: the report then
    leaves out what needs it.
    """
    configuration = None
    try:
        configuration = Configuration.model_validate_json(json.dumps(document))
        urdf = configuration.robot.description
        if urdf is None:
            reason = "the URDF came with the recording, not with the configuration"
            return Nominal(configuration, None, None, reason)
        model = build_inverse_model(configuration, read_urdf_file(urdf), urdf.name)
        return Nominal(configuration, model, skeleton(model.robot), "")
    except Exception as error:  # whatever is wrong with a file that was right before
        return Nominal(configuration, None, None, one_line(error))
