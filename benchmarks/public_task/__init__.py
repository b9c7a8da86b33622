"""A task for any program that says why a simulator and its robot differ."""
