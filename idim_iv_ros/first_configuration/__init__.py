"""A first configuration, proposed from what a bag and a URDF hold."""

from idim_iv_ros.first_configuration.proposal import propose_configuration, write_configuration

__all__ = ["propose_configuration", "write_configuration"]
