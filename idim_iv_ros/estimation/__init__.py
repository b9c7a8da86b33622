"""IDIM-LS, IDIM-IV and refined IDIM-IV, with the covariance of their estimates.

Imports are from the modules: `rows` and `qr`, which the tests of `statistics` need too, then load
neither the model nor the simulation.
"""
