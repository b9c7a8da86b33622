"""A first configuration, proposed from what a bag and a URDF hold."""
