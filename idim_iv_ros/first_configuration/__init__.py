"""A first configuration, proposed from what a bag and a URDF hold."""

from idim_iv_ros.first_configuration.proposal import Proposal, propose_configuration
from idim_iv_ros.first_configuration.yaml_text import configuration_text, write_configuration

__all__ = ["Proposal", "configuration_text", "propose_configuration", "write_configuration"]
