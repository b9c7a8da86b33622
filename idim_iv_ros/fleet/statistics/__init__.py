"""Statistics of a fleet: comparison of many bags of many robots.

- `quantities`: base parameters and residuals of each bag; regression over all bags of a robot
- `random_effects`: variance between units beyond that of their estimates; estimates of a type
- `robots`: scatter of one robot's bags; changes at a robot, their time and size; correlation of
  successive bags; comparison of all robots of a type
- `outliers`: which robots differ from their type, and in which parameters
- `common_causes`: causes that diagnoses of several robots have in common
"""
