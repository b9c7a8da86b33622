"""Design of motions that identify a robot or separate the causes of a gap."""
