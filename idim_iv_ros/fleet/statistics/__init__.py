"""What many bags of many robots say together.

- `quantities`: base parameters and residuals of each bag, as columns; all bags of a robot in one
  regression
- `random_effects`: variance between units beyond that of their estimates; the robots of a type
- `robots`: what one robot's bags differ by from day to day; what changed at a robot, when, and by
  how much; whether bags resemble the ones before; all of the robots of a type
- `outliers`: which robots differ from their type, and in which parameters
- `common_causes`: what the diagnoses say together
"""
