"""Constants of the comparison: one notion each.

Shares are of the joint's torque (RMS). Where a number was chosen by trial, the set it was chosen
on is a development set of the hostile benchmark, never the one that is reported.
"""

import numpy as np

# Torque that an effect may have, as a share: its size is a mixture over these.
SIZES = np.array([0.01, 0.02, 0.04, 0.08, 0.16, 0.32, 0.64])
# A torque below this share is misfit, whatever its evidence; so is less than a tenth of what other
# effects have at the joint.
MISFIT = 0.0004
MISFIT_OF_OTHERS = 0.1
# Visible beside the errors of all numbers and the other effects: this share of the largest one.
VISIBLE_OF_OTHERS = 0.05
# A cause has this share of the torque at one of its joints, at least.
LEAST_SHARE = 0.003
# A cause is at least as probable as this; less is a hint.
LEAST_PROBABILITY = 0.6
# Part of what lies beyond the noise at its joint that a structural cause takes, at least.
ADEQUATE = 0.5
# Prior odds: nothing, a half; the rest equal for effects, then for places, then for shapes.
NOTHING = 0.5
CURVE = 0.2  # a free curve against an effect
# Whole models are compared by a part of their evidence: rows are less independent than they seem.
TEMPER = 1.5
# What errors of all numbers cost for each e-fold of their size beyond the least one.
ERROR_COST = 5.0
# Links and drives of one nominal model are about as good: spread of the logarithm of their ratio,
# where links are worse and where drives are. Friction and drive inertia are hardest to come by.
LINKS_WORSE = 0.3
DRIVES_WORSE = 0.7
# Evidence, as a share of what is explained at the joints, that misfit may make.
TOLERANCE = 1e-3
PRESENCE = 0.95
MOST_EFFECTS = 8
MOST_BANNED = 4
# Relative errors of the nominal numbers that are compared, of links and of drives: those of a
# simulator's copy of itself, and those of data sheets. In between lies nothing that is made, and
# there all links together would pass for one payload.
RELATIVE_ERRORS = (0.003, 0.03, 0.1, 0.2, 0.4)
# Options whose evidence is near the best's are the same shape or a rival.
NEAR = 12.0
RIVALS = 12  # keys whose scores over blocks of time are looked at
# Evidence that one term more of a shape must bring.
LEAST_EVIDENCE_OF_TERM = 6.0
