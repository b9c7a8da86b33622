"""Every threshold of the diagnosis: its value, what it decides, and where it comes from.

They are read from this module when they are needed, so that `benchmarks.sensitivity` can change
one at run time. `python -m idim_iv_ros.diagnosis.settings` prints the table of docs/settings.md.

Shares that decide whether something is large enough differ in what they are a share of: of the
whitened energy of a residual, which is what the likelihood sees; of the torque gap's energy, which
is what goes when a cause is corrected; or of a joint's torque (rms), which is what the user of a
simulator sees. Where two steps ask the same of the same quantity they read one setting.

Not here: grids of shapes (they belong to their effect), tests for zero, and guards against
overflow.
"""

import re
from collections.abc import Iterator
from pathlib import Path

PAPER = "paper"
PHYSICS = "physics"
NUMERICAL = "numerical"
CONVENTION = "convention"
CHOSEN = "chosen on the development cells"


class Setting(float):
    """A number that knows its unit, what it decides, and where it comes from."""

    unit: str
    decides: str
    origin: str

    def __new__(cls, value: float, unit: str, decides: str, origin: str) -> "Setting":
        """Make a setting."""
        made = super().__new__(cls, value)
        made.unit, made.decides, made.origin = unit, decides, origin
        return made

    def times(self, factor: float) -> "Setting":
        """Return the setting with another value."""
        return Setting(factor * self, self.unit, self.decides, self.origin)


class Count(int):
    """The same for what is counted."""

    unit: str
    decides: str
    origin: str

    def __new__(cls, value: int, unit: str, decides: str, origin: str) -> "Count":
        """Make a setting."""
        made = super().__new__(cls, value)
        made.unit, made.decides, made.origin = unit, decides, origin
        return made

    def times(self, factor: float) -> "Count":
        """Return the setting with another value, rounded, at least 1."""
        return Count(max(1, round(factor * self)), self.unit, self.decides, self.origin)


# fmt: off
# Refit: the band of the rows, the motion of the candidates, the noise floor, the signal chain.
WIDEST_BAND = Setting(25.0, "Hz",
    "decimation cut-off that is proposed at most: arms have no rigid-body torque beyond, and "
    "loops are slower", PHYSICS)
NARROWEST_BAND = Setting(0.5, "decimation cut-off of the identification",
    "the same at least, where no loop can be simulated and the encoders' noise asks for less",
    CHOSEN)
POSITION_OVER_DECIMATION = Setting(2.5, "",
    "cut-off of the positions over that of the decimation", PAPER)
NYQUIST_MARGIN = Setting(1.3, "",
    "distance of the proposed cut-off of the positions from half of the sampling rate", NUMERICAL)
HIGHEST_CUTOFF = Setting(0.4, "sampling rate",
    "cut-off of the positions that is proposed at most", NUMERICAL)
ACCELERATION_NOISE = Setting(0.5, "standard deviation of the torque's noise",
    "what noise of the acceleration may add in the band that is proposed", CHOSEN)
NOISE_SEGMENT = Setting(2.0, "s",
    "segments of the spectrum from which the noise of the sensors is read", NUMERICAL)
LEAST_SPEED_SHARE = Setting(0.005, "largest speed of the joint",
    "speed below which the direction of a joint is unknown, where the configuration names none",
    CHOSEN)
MEASURED_BELOW = Setting(0.6, "decimation cut-off",
    "frequency below which candidates see the measured motion, above it the simulated one", CHOSEN)
JOINING_ORDER = Count(2, "", "order of the filter that joins the two motions", NUMERICAL)
ROWS_PER_MOTION_COEFFICIENT = Count(15, "rows",
    "rows for each coefficient that brings the simulated motion closer to the measured one, where "
    "the motion of all joints counts; with fewer that of the joint alone does", NUMERICAL)
SAMPLES_PER_ROW = Count(5, "samples",
    "samples for each row at which candidates are computed, at least", NUMERICAL)
SLOPE_STEP = Setting(1e-5, "rad or m", "step of the numerical slope of the torques", NUMERICAL)
REVERSAL_SPEED = Setting(0.3, "slowest speed that counts",
    "speed the other way from which on a joint has turned: noise does not turn it", CHOSEN)
LEAST_DRY_FRICTION = Setting(0.01, "largest torque of the joint",
    "dry friction below which a joint is taken to have none", PHYSICS)
ASSUMED_DRY_FRICTION = Setting(0.05, "largest torque of the joint",
    "dry friction of such a joint, where a plausible size of an effect is judged by it", PHYSICS)
REPEAT_TOLERANCE = Setting(0.01, "spread of the reference (rms)",
    "difference up to which a reference repeats another", CHOSEN)
REPEAT_COARSE = Setting(5.0, "REPEAT_TOLERANCE",
    "the same before the shift between the two is refined", NUMERICAL)
REPEAT_LEAST_OVERLAP = Setting(2.0, "s", "length of a repeat, at least", CHOSEN)
REPEAT_LEAST_SHARE = Setting(0.3, "shorter recording",
    "part of a recording that repeats another, at least", CHOSEN)
REPEAT_LEAST_ROWS = Count(50, "rows",
    "rows beyond the parameters' number from which a noise floor is computed, at least", NUMERICAL)
REPEAT_HAS_LEFT = Setting(0.3, "spread of the reference (rms)",
    "distance that a motion must have taken from itself before it can repeat itself", NUMERICAL)
REPEAT_LEAST_MOTION = Setting(0.1, "variance of the reference",
    "variance of an overlap below which nothing moves in it", NUMERICAL)
SHIFT_AGREEMENT = Setting(0.15, "control period",
    "difference up to which joints share the shift of the effort: clocks of one bus are no better",
    CHOSEN)
SHIFT_DEVIATIONS = Setting(3.0, "standard deviations",
    "the same, added for what the shifts leave open", CONVENTION)
EARLIEST_SHIFT = Setting(-1.0, "control periods",
    "shift down to which a single joint tells that of the recording", PHYSICS)
LATEST_SHIFT = Setting(2.0, "control periods",
    "the same upwards: half a period of hold and one of computing", PHYSICS)
SHIFT_STEPS = Count(2, "",
    "fits of the shift, which enters the regression to first order only", NUMERICAL)
SHIFT_SPLINE = Count(5, "", "order of the interpolation that shifts the effort", NUMERICAL)
LEAST_WAVES = Setting(50.0, "rad of phase a rad",
    "wave number from which on a ripple of a current's gain is looked for: it is the motor's, "
    "behind a gear", PHYSICS)
MOST_WAVES = Setting(600.0, "rad of phase a rad",
    "the same, at most: six poles of a motor behind a gear of 100", PHYSICS)
WAVES_TRIED = Count(6, "waves", "likely waves of each joint that are tried", NUMERICAL)
WAVE_STEPS = Count(7, "", "wave numbers that are tried near each", NUMERICAL)
GAIN_RIPPLE_LEVEL = Setting(0.01, "",
    "probability, times the waves and joints, up to which the gain ripples", CONVENTION)
GAIN_RIPPLE_SUPPORT = Setting(6.0, "chi-square",
    "what a ripple of the gain must take beyond the likeliest ripple of the torque: odds of 20",
    CONVENTION)
GAIN_RIPPLE_ALONE = Setting(3.0, "chi-square of the next likely ripple of the gain",
    "what a ripple of the gain must take, at least: structure that the model lacks correlates with "
    "many waves, a ripple with one", CHOSEN)
SIDE_LOBES = Setting(15.0, "resolution of wave numbers, 2 π over the range of the joint",
    "distance of that next ripple, at least: slow motion covers a part of the range", CHOSEN)
SOFT_FRICTION_SUPPORT = Setting(25.0, "ln likelihood",
    "gain of dry friction that turns before the joint, over friction that sticks, at which it is "
    "taken for a simulator's", CHOSEN)
MOST_GAIN_RIPPLES = Count(2, "waves", "ripples of a joint's gain that are taken out", CHOSEN)

# Gravity that the configuration leaves out.
STANDARD_GRAVITY = Setting(9.81, "m/s²", "size of the gravity that is put in", PHYSICS)
GRAVITY_LEAST_SHARE = Setting(0.2, "energy of a joint's residual",
    "what gravity must take at one joint, at least", CHOSEN)
LEAST_GRAVITY = Setting(4.0, "m/s²",
    "gravity with the given masses, at least, or it is something else", CHOSEN)
MOST_GRAVITY = Setting(25.0, "m/s²", "the same, at most", CHOSEN)

# What an effect, a parameter error or a change of the law must bring to be accepted.
LEAST_SUPPORT = Setting(8.0, "ln likelihood",
    "gain beyond Schwarz's penalty (and the search's) of an effect, a cause or a group of the law",
    CHOSEN)
LEAST_SUPPORT_OF_DERIVATIVES = Setting(25.0, "ln likelihood",
    "the same for effects whose torque is made of high derivatives of the motion: noise of the "
    "encoders is then in both sides", CHOSEN)
LEAST_SUPPORT_OF_TERM = Setting(12.0, "ln likelihood",
    "gain of one more term of a shape, such as another wave", CHOSEN)
INDISTINGUISHABLE_SUPPORT = Setting(6.0, "ln likelihood",
    "difference of support up to which two candidates are equally good", CHOSEN)
INDISTINGUISHABLE_CORRELATION = Setting(0.5, "",
    "correlation of their torques from which on such parametric causes are listed together", CHOSEN)

# What is indistinguishable from an accepted effect: a model confidence set on held-out blocks.
CONFIDENCE_SET_SIZE = Setting(0.05, "",
    "probability up to which the best alternative may be missing from the set", CONVENTION)
CONFIDENCE_LEAST_BLOCK = Setting(5.0, "s", "blocks that are held out, at least", PHYSICS)
CONFIDENCE_FEWEST_BLOCKS = Count(4, "blocks", "the same in a short session, at least", NUMERICAL)
CONFIDENCE_MOST_BLOCKS = Count(24, "blocks", "the same in a long session, at most", NUMERICAL)
ALTERNATIVE_SUPPORT = Setting(0.5, "support of the accepted effect",
    "support from which on an alternative is tried again when the others are known", NUMERICAL)
ALTERNATIVE_GAIN = Setting(0.25, "gain of the accepted effect",
    "gain from which on a candidate is compared with it on held-out blocks: less leaves most of "
    "what the effect explains", CHOSEN)
ALTERNATIVE_CORRELATION = Setting(0.25, "",
    "correlation of the torques that both add, at least: with less it would be one cause more",
    CHOSEN)
MOST_ALTERNATIVES = Count(24, "candidates", "how many are compared, at most", NUMERICAL)
REFINED_ALTERNATIVES = Count(6, "candidates",
    "how many of them have their shape refined, the best supported first", NUMERICAL)
NULL_DRAWS = Count(199, "draws",
    "simulated recordings without the cause from which its p-value is read: it is at least "
    "1 / (draws + 1)", NUMERICAL)

# Structural effects: likelihood and search.
NOISE_MODEL_ORDER = Count(10, "", "order of each joint's autoregressive noise, at most", NUMERICAL)
NOISE_MODEL_STEPS = Count(3, "", "fits of the noise models from white noise", NUMERICAL)
NOISE_MODEL_MORE_STEPS = Count(2, "",
    "the same from the noise models of the model before", NUMERICAL)
LEAST_DENSITY = Setting(0.01, "mean spectral density",
    "noise that every frequency has at least: the model is wrong by a little everywhere", CHOSEN)
LEAST_INDEPENDENT = Setting(1e-4, "energy of a column",
    "what the model must leave of a candidate's column, at least", NUMERICAL)
MOST_EFFECTS = Count(4, "effects", "structural effects that are accepted, at most", CHOSEN)
LEAST_SHARE_OF_EFFECT = Setting(0.01, "energy of the residual",
    "what an effect must take of the whitened and of the plain residual at its joints, at least",
    CHOSEN)
LEAST_OF_LARGEST = Setting(0.67, "gap that the candidate with the largest share takes",
    "what a candidate must take to be accepted before it: small and fast effects come later",
    CHOSEN)
CATALOGUE_OVER_NONPARAMETRIC = Setting(0.75, "support of the best nonparametric alternative",
    "support from which on an effect of the catalogue is named instead", CHOSEN)
NONPARAMETRIC_BESIDE_EFFECT = Setting(0.33, "support of an accepted effect at the joint",
    "support of a nonparametric function beside it, at least: less corrects the effect's shape",
    CHOSEN)
LEAST_BESIDE_STRONGER = Setting(0.03, "energy that the stronger effect takes",
    "energy that another effect at the joint takes, at least: less corrects the stronger's shape",
    CHOSEN)
LEAST_NONPARAMETRIC = Setting(0.01, "torque of the joint (rms)",
    "size from which on what is not in the catalogue counts for the verdict", CHOSEN)
SHAPE_CHANGES = Count(4, "",
    "changes of a shape at each step of its refinement, at most", NUMERICAL)
SHAPE_GAIN = Setting(0.01, "chi-square",
    "gain from which on the refinement of a shape goes on", NUMERICAL)
SPREAD_SHAPES = Count(4, "shapes",
    "shapes of a grid by which an effect is judged from the motion alone", NUMERICAL)
STOP_RANGE = Setting(0.4, "range of the joint",
    "distance from either end in which a contact is looked for", CHOSEN)
PRISMATIC_LEVER = Setting(0.1, "m", "what counts as a radian of a prismatic joint", PHYSICS)
SHAPE_STEP = Setting(0.01, "number of the shape",
    "step by which a shape is moved for the standard deviations", NUMERICAL)
COEFFICIENT_STEP = Setting(1e-4, "coefficient",
    "step of the numerical slope of an effect's numbers", NUMERICAL)

# What may be named.
LEAST_BEYOND_KNEE = Setting(0.005, "rows",
    "rows of two folds, at least, beyond the knee of a saturation, or it was not reached: clipping "
    "that matters takes 1.5 % of the samples", PHYSICS)
MOST_BEYOND_KNEE = Setting(0.5, "rows",
    "rows beyond the knee, at most: a bend that most of the motion passes is no limit", PHYSICS)

# Held-out confirmation.
HELD_OUT_LEAST_GAIN = Setting(0.02, "energy of the whitened residual",
    "what an effect must take on data not used to fit, at least", CHOSEN)
HELD_OUT_LEAST_GAIN_OF_DRIFT = Setting(0.05, "energy of the whitened residual",
    "the same for what changes with time: every robot warms up, and a change of less than a "
    "quarter of the noise (rms) is no cause", CHOSEN)
LEAST_FOLDS_CHOSEN = Setting(0.6, "folds",
    "folds without which a search must choose an effect again, at least, or what is "
    "indistinguishable from it: 3 of 5; one that is chosen less often is a hint", CONVENTION)
HELD_OUT_LEAST_FOLDS = Setting(0.75, "folds that choose it",
    "folds on which an effect must help, at least, each counted by what the effect does there: "
    "one may act in some folds only; of blocks that have a vote in a contrast", CHOSEN)
HELD_OUT_LEAST_FOLDS_OF_DRIFT = Setting(0.5, "folds",
    "the same for what changes with time: much of it may lie in a part of the session", CHOSEN)
LEAST_FOLD = Setting(5.0, "s", "length of a fold where recordings are divided", CHOSEN)
FEWEST_FOLDS = Count(4, "folds", "folds where recordings are divided, at least", CHOSEN)
MOST_FOLDS = Count(6, "folds", "the same, at most", CHOSEN)
FOLD_GUARD = Setting(0.25, "s",
    "rows on either side of a border inside a recording that belong to no fold", CHOSEN)
INTERLEAVED_FOLD = Setting(3.0, "s",
    "length of the blocks that take turns where an effect changes with time", CHOSEN)
INTERLEAVED_TURNS = Count(4, "folds", "folds that take turns", CHOSEN)
FOLD_LEAK = Setting(1e-3, "",
    "weight of the held-out rows in the fit that predicts them: what only they show stays finite",
    NUMERICAL)
LEAST_TIME_BLOCK = Setting(1.0, "s", "blocks of the bootstrap, at least", CHOSEN)
TIME_BLOCK = Setting(5.0, "s",
    "length of such a block where the session is long enough: torques are predictable over "
    "seconds", PHYSICS)
FEWEST_TIME_BLOCKS = Count(8, "blocks",
    "blocks of the bootstrap in a short session: they are shorter then", NUMERICAL)
MOST_TIME_BLOCKS = Count(20, "blocks", "blocks of the bootstrap in one recording, at most", CHOSEN)
RESAMPLES = Count(1000, "", "resamples of the bootstrap", NUMERICAL)

LEAST_ROOM = Setting(1e-3, "gap",
    "what must lie above the noise floor for a shrinkage to be said", NUMERICAL)

# Significance.
NORMAL_95 = Setting(1.96, "standard deviations",
    "half-width of a 95 % interval: a number beyond differs from zero", CONVENTION)
SIGNIFICANCE_LEVEL = Setting(0.05, "",
    "level of the test of all numbers of a cause: Wald's, of an effect a likelihood ratio",
    CONVENTION)

# Parametric causes.
REFIT_LEAST_SHARE = Setting(0.01, "energy of the nominal model's gap",
    "what new base parameters must take before parametric causes are looked for", CHOSEN)
REFIT_LEAST_SHARE_BESIDE = Setting(0.05, "energy of the nominal model's gap",
    "the same where structural effects were accepted: what is left of them biases the refit",
    CHOSEN)
PARAMETRIC_LEAST_SHARE = Setting(0.02, "energy of the nominal model's gap",
    "what a parametric cause must take beside those before it, unless it takes "
    "LEAST_PARAMETER_ERROR", CHOSEN)
PARAMETRIC_LEAST_TORQUE = Setting(0.005, "torque of the joint (rms)",
    "what a parametric cause must take at a joint in any case: of a small gap each is a large "
    "share", CHOSEN)
LEAST_PARAMETER_ERROR = Setting(0.02, "torque of the joint (rms)",
    "size from which on a parameter error matters at a joint", CHOSEN)
PARAMETER_ERROR_OVER_REFIT = Setting(1.5, "gap of the refit",
    "gap with all causes from which on a parameter error remains", CHOSEN)
ENOUGH_OF_CHANGE = Setting(0.9, "change that the refit explains",
    "what the causes must explain together, at least", CHOSEN)
CHANGE_DEVIATIONS = Setting(2.0, "standard deviations",
    "what may be missing to that by chance", CONVENTION)
PARAMETRIC_LEVEL = Setting(0.01, "",
    "level of Wald's test of a parameter error beside errors of all other numbers: their sizes are "
    "estimated, and the surest of a dozen causes is looked at", CHOSEN)
LEAST_SURE_SHARE = Setting(0.75, "gap that a payload or a link takes",
    "what those of its numbers must take that leave out zero, for it to be named", CHOSEN)
LEAST_CONFIRMED = Setting(0.5, "size of the estimate",
    "what must remain of a wrong gain or gravity beside errors of all base parameters, or these "
    "imitate it", CHOSEN)
LEAST_PART_OF_CHANGE = Setting(0.02, "change that the refit explains",
    "what each cause must explain of it, at least", CHOSEN)
MOST_PARAMETRIC_CAUSES = Count(6, "causes",
    "parametric causes, at most: where more are needed, most numbers are in error", CHOSEN)
LEAST_PART_OF_JOINT = Setting(0.25, "energy missing at a joint",
    "what one more cause must take of it, at least", CHOSEN)
NEARLY_ALL_OF_JOINT = Setting(0.67, "energy that the best cause takes at the joint",
    "what a cause must take there to be chosen for its likelihood", CHOSEN)
CONFOUNDER_CORRELATION = Setting(0.98, "",
    "correlation from which on a structural effect's torque is that of a parameter error", CHOSEN)
LEAST_DIRECTION = Setting(1e-5, "unit column",
    "what must be left of a direction, or it counts as not excited", NUMERICAL)
LEAST_BESIDE_EFFECTS = Setting(1e-2, "norm of a column",
    "what accepted effects must leave of a change, at least", NUMERICAL)
LARGEST_SMALL_ERROR = Setting(0.6, "",
    "gain error, or tilt in rad, up to which an error beyond the base parameters is small", PHYSICS)
TILT_STEP = Setting(1e-4, "rad", "step of the numerical slope over a tilt of gravity", NUMERICAL)
LEAST_FREE_DIRECTIONS = Count(3, "directions",
    "directions beside the causes from which the size of all other parameter errors is estimated, "
    "at least", CHOSEN)
LEAST_RELATIVE_ERROR = Setting(1e-5, "", "relative size of all other errors, at least", NUMERICAL)
MOST_RELATIVE_ERROR = Setting(2.0, "", "the same, at most", NUMERICAL)
USUAL_RELATIVE_ERROR = Setting(0.05, "",
    "relative error of nominal models, where the recording hardly shows it", PHYSICS)
USUAL_ERROR_SPREAD = Setting(1.0, "ln",
    "standard deviation of its logarithm", PHYSICS)
LEAST_OWN_ENERGY = Setting(1e-8, "energy of a column",
    "what must be a cause's own beside the others", NUMERICAL)

# Whether one set of parameters holds for all recordings.
AGREEMENT_LEVEL = Setting(0.01, "",
    "probability of the F test, times the recordings, up to which they disagree", CONVENTION)
AGREEMENT_LEAST_SHARE = Setting(0.01, "torque of the joint (rms)",
    "held-out torque that must differ at one joint: a long recording rejects every model", PHYSICS)
AGREEMENT_LEAST_TAKEN = Setting(0.5, "residual with one set of parameters (rms)",
    "what a recording's own parameters may leave of it for a difference to be named", CHOSEN)
AGREEMENT_OVER_NOISE = Setting(2.0, "noise (innovations)",
    "or what they may leave at most", CHOSEN)
AGREEMENT_FOLDS = Count(5, "blocks", "blocks of a recording that are held out in turn", NUMERICAL)
AGREEMENT_LEAST_FOLDS = Count(4, "blocks",
    "blocks that parameters of its own must predict better", CONVENTION)

# What changed between two sets of recordings.
CONTRAST_ROUNDS = Count(2, "",
    "searches of MOST_EFFECTS structural effects each: what both sets have takes places", NUMERICAL)
CONTRAST_FEWEST_BLOCKS = Count(6, "blocks",
    "blocks of each set that are held out in turn, at least", NUMERICAL)
CONTRAST_MOST_BLOCKS = Count(12, "blocks", "the same, at most", NUMERICAL)
CONTRAST_LEAST_VOTE = Setting(1.0, "ln likelihood",
    "difference of two models on a held-out block from which on the block has a vote", CHOSEN)
CONTRAST_FEWEST_VOTES = Count(3, "blocks", "blocks that must vote for a change, at least", CHOSEN)
CONTRAST_LEAST_SHARE = Setting(0.01, "torque of the joint (rms)",
    "held-out torque by which the sets must differ at one joint: long recordings reject every "
    "model", PHYSICS)
CONTRAST_LEAST_EFFECT = Setting(0.003, "torque of the joint (rms)",
    "held-out torque of an effect that one set has, at least: less is a reversal that the "
    "simulated motion of one set misses", CHOSEN)
CONTRAST_LEAST_DELAY = Setting(1.0, "control periods",
    "change of the effort's shift from which on it is a cause: a command that is held over its "
    "period, recorded or not, makes half a period", PHYSICS)
CONTRAST_LAW_DEVIATIONS = Setting(3.0, "standard deviations",
    "change of a gain between the sets, at least", CONVENTION)

# Control law.
LIMITED_COMMAND = Setting(0.98, "torque limit", "size from which on a command is limited", CHOSEN)
LAW_LEAST_ROWS = Count(50, "rows", "rows from which on commands are compared, at least", NUMERICAL)
LAW_LEAST_DIFFERENCE = Setting(0.005, "command (rms)",
    "difference from which on commands are not those of the law", CHOSEN)
LAW_LEAST_SHARE = Setting(0.05, "energy that the law leaves",
    "what a change of the law must take, at least", CHOSEN)
LAW_BLOCKS = Count(20, "blocks of time",
    "parts into which the rows of the commands are split, to see that a change of the law lasts",
    CHOSEN)
LAW_BLOCKS_LEFT_OUT = Count(2, "blocks of time",
    "parts without which a change of the law must still be supported: those that speak for it most",
    CHOSEN)
LONGEST_LAG = Setting(2.0, "control periods",
    "time from the law to the torque up to which a command is only sampled and held", PHYSICS)
LAG_DIFFERENCE = Setting(0.5, "control periods",
    "lag beyond that of half of the joints from which on it is the law's", CHOSEN)
LAG_DEVIATIONS = Setting(3.0, "standard deviations",
    "distance of a lag from those limits that is noise", CONVENTION)
LAW_NOISE_MARGIN = Setting(3.0, "change that noise of the encoder makes",
    "change of a gain, at least", CHOSEN)
LAW_SPEED_GAIN = Setting(0.2, "commands' residual (rms)",
    "what another speed than the plain one must take, at least, to be the law's", CHOSEN)
MUCH_BEYOND_LAW = Setting(0.05, "command (rms)",
    "size from which on what commands hold beyond the law is said", CHOSEN)
LAW_EVENT_KURTOSIS = Setting(6.0, "excess kurtosis",
    "kurtosis from which on it acts at certain times only", CHOSEN)
LAW_EVENT_SIZE = Setting(8.0, "median size",
    "size from which on a row belongs to such an event", CHOSEN)
LAW_EVENT_EDGE = Setting(0.5, "peak of the event", "size at which it begins and ends", CHOSEN)
LAW_LEAST_EVENT = Setting(0.1, "energy of the largest event",
    "energy from which on another one is listed", CHOSEN)
LAW_EVENTS_APART = Setting(0.5, "s", "pause between two events, at least", CHOSEN)
LAW_MOST_EVENTS = Count(5, "events", "events that are listed, at most", CONVENTION)

# Transmissions, with encoders behind the gears.
STEP_TOLERANCE = Setting(0.01, "steps",
    "distance of an encoder's values from a grid, up to which they lie on it", NUMERICAL)
TWIST_OFFSET_STEPS = Count(3, "",
    "fits of the time offset between the channels, which enters to first order only", NUMERICAL)
LEAST_SIDE = Setting(0.05, "rows",
    "share on either side of zero load, at least, to look for play", CHOSEN)
ON_ONE_SIDE = Setting(0.98, "",
    "decimated sign of the load from which a link in play lies on one side", NUMERICAL)
SIDE_MARGIN = Count(2, "rows",
    "beside a change of side that say nothing of the gap: the link flies there", CHOSEN)
LINK_MOTION_STEPS = Count(3, "",
    "times that the load is computed again at the link's motion", NUMERICAL)
TWIST_POSITION_TERMS = Count(4, "cosines",
    "of an encoder's error over the position: slower than that of a gear", CHOSEN)
LEAST_TWIST_ROWS = Count(50, "rows", "at least, to measure a transmission", CHOSEN)
TWIST_FOLDS = Count(6, "blocks of time", "held out in turn from a twist", CONVENTION)
LEAST_LOAD_VARIATION = Setting(0.01, "largest load",
    "standard deviation of the load, at least, to show a stiffness", CHOSEN)
TWIST_DEVIATIONS = Setting(3.0, "standard deviations",
    "distance from zero of a stiffness' reciprocal, a gap or a damping, at least, with all that "
    "makes them unsure", CONVENTION)
LIGHT_DAMPING = Setting(0.03, "times critical",
    "damping of a measured shaft where none shows", PHYSICS)
STIFF_RESONANCE = Setting(100.0, "Hz",
    "resonance of the link against its motor from which a shaft counts as rigid: above what the "
    "catalogue looks for", PHYSICS)

# Localisation and what stays unexplained.
LEAST_OCCUPANCY = Setting(0.005, "samples", "size of a regime, at least", CHOSEN)
REGIME_LEAST_BLOCKS = Count(5, "blocks",
    "blocks of time behind a regime's interval, at least", CHOSEN)
FINDING_LEAST_LIFT = Setting(1.3, "",
    "energy share over occupancy from which on a regime is said", CHOSEN)
FINDING_LEAST_ENERGY = Setting(0.2, "energy of the gap", "the same of its energy share", CHOSEN)
NOMINAL_FINDINGS = Count(3, "findings", "findings about the nominal model, at most", CONVENTION)
REFIT_FINDINGS = Count(2, "findings", "findings about the refit, at most", CONVENTION)
REFIT_STRUCTURE = Setting(1.2, "energy of the noise floor",
    "energy of the refit's residual from which on it is described", CHOSEN)
SPECTRUM_SEGMENT = Setting(1.0, "s", "pieces of the residual's spectrum", CHOSEN)
SPECTRUM_LEAST_ROWS = Count(16, "rows", "rows of such a piece, at least", NUMERICAL)
SPECTRUM_LEAST_PIECES = Count(5, "pieces", "pieces, at least", NUMERICAL)
EVENT_KURTOSIS = Setting(4.0, "excess kurtosis",
    "kurtosis of the whitened residual from which on it may hold events", CHOSEN)
EVENT_SAMPLES = Setting(0.01, "samples", "the largest samples, which are taken for events", CHOSEN)
EVENT_ENERGY = Setting(0.12, "energy of the whitened residual",
    "energy of those samples, at least", CHOSEN)
EVENT_LEAST_ROWS = Count(200, "rows", "rows from which on events are looked for", NUMERICAL)
UNEXPLAINED_OVER_NOISE = Setting(3.0, "noise floor",
    "gap of the last model from which on it may be called unexplained", CHOSEN)
UNEXPLAINED_OF_TORQUE = Setting(0.1, "torque of the joint (rms)",
    "size from which on it is", CHOSEN)
UNEXPLAINED_OF_GAP = Setting(0.5, "gap of the first model", "or size from which on it is", CHOSEN)

# Identifiability: what the motion can show.
NONCENTRALITY = Setting(20.0, "chi-square", "noncentrality at which an effect is seen", CHOSEN)
ABSORBED = Setting(0.995, "energy of an effect's columns",
    "share that the model's parameters absorb, above which the effect is not testable", CHOSEN)
MOST_SCALED = Setting(1.5, "",
    "factor by which a shaft or a delay is scaled up to be seen, at most", CHOSEN)
LEAST_RANGE = Setting(0.01, "rad (levers)", "motion of a joint, at least, to show anything", CHOSEN)
LEAST_FASTEST = Setting(0.1, "rad/s (levers/s)",
    "largest speed of a joint, at least, to show any effect", CHOSEN)
SMALL_RANGE = Setting(0.1, "rad (levers)",
    "motion of a slower joint, at least, to show its parameters", CHOSEN)
LEAST_SPEED_RANGE = Setting(1.5, "slowest speed that counts",
    "largest speed of a joint, at least, to show any effect", CHOSEN)
LARGEST_TORQUE = Setting(1e6, "N m",
    "torque from which on a shape's transmission has run away", NUMERICAL)

# Simulated motion, sentences and notes.
SIMULATION_LOST = Setting(1.0, "range of the joint",
    "tracking error from which on the simulation has not followed", CHOSEN)
MOST_POINTS = Count(1500, "points", "points of a curve of the tracking error, at most", CONVENTION)
MOST_CAUSES_IN_SUMMARY = Count(4, "causes", "causes in the summary, at most", CONVENTION)
MOST_NUMBERS_IN_SENTENCE = Count(4, "numbers",
    "numbers of a cause in a sentence, at most", CONVENTION)
SHORT_RECORDING = Setting(10.0, "s", "length below which a note asks for more", CHOSEN)
# fmt: on


def all_settings() -> dict[str, Setting | Count]:
    """Every setting by its name, in the order of this file."""
    return {name: each for name, each in globals().items() if isinstance(each, Setting | Count)}


def readers() -> dict[str, list[str]]:
    """Files of this folder that read each setting, by its name."""
    folder = Path(__file__).parent
    found: dict[str, list[str]] = {name: [] for name in all_settings()}
    for file in sorted(folder.rglob("*.py")):
        for name in dict.fromkeys(re.findall(r"\bsettings\.([A-Z][A-Z0-9_]+)", file.read_text())):
            found[name].append(str(file.relative_to(folder)))
    return found


def table() -> Iterator[str]:
    """Lines of docs/settings.md."""
    files = readers()
    yield "# Every threshold of the diagnosis"
    yield ""
    yield "Made by `python -m idim_iv_ros.diagnosis.settings > docs/settings.md`."
    yield ""
    yield "| name | value | unit | decides | origin | read in `idim_iv_ros/diagnosis/` |"
    yield "|---|---|---|---|---|---|"
    for name, each in all_settings().items():
        read = ", ".join(files[name])
        yield f"| `{name}` | {each:g} | {each.unit} | {each.decides} | {each.origin} | {read} |"


if __name__ == "__main__":
    print("\n".join(table()))
