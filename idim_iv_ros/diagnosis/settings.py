"""Thresholds of the diagnosis: value, what it decides, and where it comes from.

They are read from this module when they are needed, so that `benchmarks.sensitivity` can change
one at run time.

Shares that decide whether something is large enough differ in what they are a share of: of the
whitened energy of a residual, which is what the likelihood sees; of the torque gap's energy, which
is what goes when a cause is corrected; or of a joint's torque (rms), which is what the user of a
simulator sees. Where two steps ask the same of the same quantity they read one setting.

Not here, but in the only file that reads it: what belongs to one effect (grids, physical bounds),
decides only what is shown or listed, or is a matter of arithmetic (steps, tests for zero, guards
against overflow).
"""

from typing import Self

PAPER = "paper"
PHYSICS = "physics"
NUMERICAL = "numerical"
CONVENTION = "convention"
CHOSEN = "chosen on the development cells"


class _Declared:
    """A number with its unit, what it decides, and origin: `CHOSEN` where none is given."""

    unit: str
    decides: str
    origin: str

    def __new__(cls, value: float, unit: str, decides: str, origin: str = CHOSEN) -> Self:
        """Make one."""
        made = super().__new__(cls, value)  # type: ignore[call-arg]
        made.unit, made.decides, made.origin = unit, decides, origin
        return made


class Setting(_Declared, float):
    """A threshold that is measured."""


class Count(_Declared, int):
    """A threshold that is counted."""


# fmt: off
# Refit: the band of the rows, the motion of the candidates, the noise floor, the signal chain.
WIDEST_BAND = Setting(25.0, "Hz",
    "decimation cut-off that is proposed at most: arms have no rigid-body torque beyond, and "
    "loops are slower", PHYSICS)
POSITION_OVER_DECIMATION = Setting(2.5, "",
    "cut-off of the positions over that of the decimation", PAPER)
ACCELERATION_NOISE = Setting(8.0, "standard deviation of the torque's noise",
    "what noise of the acceleration may add in the band that is proposed")
MEASURED_NOISE = Setting(1.0, "standard deviation of the torque's noise",
    "the same where no loop is simulated: the measured motion's noise is in all columns", PHYSICS)
LEAST_SPEED_SHARE = Setting(0.005, "largest speed of the joint",
    "speed below which the direction of a joint is unknown, where the configuration names none")
MEASURED_BELOW = Setting(0.6, "decimation cut-off",
    "frequency below which candidates see the measured motion, above it the simulated one")
SAMPLES_PER_ROW = Count(5, "samples",
    "samples for each row at which candidates are computed, at least", NUMERICAL)
REVERSAL_SPEED = Setting(0.3, "slowest speed that counts",
    "speed the other way from which on a joint has turned: noise does not turn it")
LEAST_DRY_FRICTION = Setting(0.01, "largest torque of the joint",
    "dry friction below which a joint is taken to have none", PHYSICS)
REPEAT_TOLERANCE = Setting(0.01, "spread of the reference (rms)",
    "difference up to which a reference repeats another")
REPEAT_LEAST_OVERLAP = Setting(2.0, "s", "length of a repeat, at least")
REPEAT_LEAST_SHARE = Setting(0.3, "shorter recording",
    "part of a recording that repeats another, at least")
SHIFT_AGREEMENT = Setting(0.15, "control period",
    "difference up to which joints share the shift of the effort: clocks of one bus are no better")
CLEAR_DEVIATIONS = Setting(3.0, "standard deviations",
    "distance that is no noise: of a shift, a lag, a changed gain, of what encoders behind the "
    "gears measure", CONVENTION)
SOFT_FRICTION_SUPPORT = Setting(25.0, "ln likelihood",
    "gain of dry friction that turns before the joint, over friction that sticks, at which it is "
    "taken for a simulator's")

# The comparison of numbers and effects; shares are of the joint's torque (rms).
MISFIT = Setting(0.0004, "torque of the joint (rms)",
    "torque that shapes of the catalogue miss of a robot's, whatever its evidence")
MISFIT_OF_OTHERS = Setting(0.1, "torque of the other effects at the joint",
    "the same beside other effects")
VISIBLE_OF_OTHERS = Setting(0.05, "torque of the largest other effect at the joint",
    "torque beside errors of all numbers and the other effects that a term needs")
LEAST_SHARE = Setting(0.003, "torque of the joint (rms)",
    "torque of a cause at one of its joints, at least")
LEAST_PROBABILITY = Setting(0.6, "", "probability of a cause, at least; what has less is a hint")
ADEQUATE = Setting(0.5, "torque beyond the noise at its joint",
    "part of it that a structural cause takes, at least")
PRIOR_OF_CURVE = Setting(0.2, "prior weight of an effect", "prior weight of a free curve")
TEMPER = Setting(1.5, "",
    "divides the evidence of whole models: rows are less independent than they seem")
ERROR_COST = Setting(5.0, "ln likelihood",
    "cost of each e-fold by which errors of the nominal numbers exceed the least size")
LINKS_WORSE = Setting(0.3, "ln ratio",
    "spread of the size of errors of links over that of drives, where links are worse")
DRIVES_WORSE = Setting(0.7, "ln ratio",
    "the same where drives are worse: friction and drive inertia are hardest to come by")
MISFIT_OF_EVIDENCE = Setting(1e-3, "evidence explained at the joints",
    "evidence that misfit may make: a smaller set of terms may lack it")
PRESENCE = Setting(0.95, "", "posterior probability against nothing of a term, at least")
NEAR = Setting(12.0, "ln evidence",
    "distance from the best option up to which another one is in its set")
LEAST_EVIDENCE_OF_TERM = Setting(6.0, "ln evidence",
    "evidence that one term more of a shape must bring")

# What an effect, a parameter error or a change of the law must bring to be accepted.
LEAST_SUPPORT = Setting(8.0, "ln likelihood",
    "gain beyond Schwarz's penalty (and the search's) of an effect, a cause or a group of the law")

# Structural effects.
LEAST_NONPARAMETRIC = Setting(0.01, "torque of the joint (rms)",
    "size from which on counts what is not in the catalogue, and what is left between two sets of "
    "recordings: long ones reject every model")

# Held-out confirmation.
FOLDS = Count(4, "folds", "parts of the time, each of which is predicted from the others")
INTERLEAVED_FOLD = Setting(3.0, "s",
    "length of the blocks that take turns where an effect changes with time")
LEAST_TIME_BLOCK = Setting(1.0, "s", "blocks of the bootstrap, at least")
TIME_BLOCK = Setting(5.0, "s",
    "blocks of the bootstrap where the session is long enough: torques are "
    "predictable over seconds", PHYSICS)

# Significance.
NORMAL_95 = Setting(1.96, "standard deviations",
    "half-width of a 95 % interval: a number beyond differs from zero", CONVENTION)

# Parametric causes.
PARAMETRIC_LEAST_TORQUE = Setting(0.005, "torque of the joint (rms)",
    "what a parametric cause must take at a joint in any case: of a small gap each is a large "
    "share")
LEAST_PARAMETER_ERROR = Setting(0.02, "torque of the joint (rms)",
    "size from which on a parameter error matters at a joint")
PARAMETER_ERROR_OVER_REFIT = Setting(1.5, "gap of the refit",
    "gap with all causes from which on a parameter error remains")

# What changed between two sets of recordings.
CONTRAST_LEAST_DELAY = Setting(1.0, "control periods",
    "change of the effort's shift from which on it is a cause: a command that is held over its "
    "period, recorded or not, makes half a period", PHYSICS)

# Control law.
LEAST_ROWS = Count(50, "rows",
    "rows from which on commands are compared, a transmission is measured and, beyond the "
    "parameters' number, a noise floor is computed", NUMERICAL)
LAW_LEAST_DIFFERENCE = Setting(0.005, "command (rms)",
    "difference from which on commands are not those of the law")
LAW_LEAST_SUPPORT = Setting(20.0, "ln likelihood",
    "evidence of a change of the law, at least: what it explains else is the recording's")
LONGEST_LAG = Setting(2.0, "control periods",
    "time from the law to the torque up to which a command is only sampled and held: half a period "
    "of hold, one of computing, and half of one until a cycle takes it; more is a delay", PHYSICS)
LAG_DIFFERENCE = Setting(0.5, "control periods, or intervals of the recording by two",
    "lag beyond that of half of the joints from which on it is the law's")
LAW_SPEED_GAIN = Setting(0.1, "commands' residual (rms)",
    "what another speed than the plain one must take, at least, to be the law's")
MUCH_BEYOND_LAW = Setting(0.1, "command (rms)",
    "size from which on what commands hold beyond the law is said, and nothing of a lag")
LAW_EVENT_KURTOSIS = Setting(6.0, "excess kurtosis",
    "kurtosis from which on it acts at certain times only")
LAW_EVENT_SIZE = Setting(8.0, "median size", "size from which on a row belongs to such an event")
LAW_EVENTS_APART = Setting(0.5, "s", "pause between two events, at least")

# Localisation and what stays unexplained.
EVENT_KURTOSIS = Setting(4.0, "excess kurtosis",
    "kurtosis of the whitened residual from which on it may hold events")
EVENT_SAMPLES = Setting(0.01, "samples", "the largest samples, which are taken for events")
EVENT_ENERGY = Setting(0.12, "energy of the whitened residual", "energy of those samples, at least")
STRUCTURE_OVER_NOISE = Setting(1.2, "energy of the noise floor",
    "energy of a refit's residual from which on something is left in it that is not noise")
UNEXPLAINED_OVER_NOISE = Setting(3.0, "noise floor",
    "gap of the last model from which on it may be called unexplained")
UNEXPLAINED_OF_TORQUE = Setting(0.1, "torque of the joint (rms)", "size from which on it is")
UNEXPLAINED_OF_GAP = Setting(0.5, "gap of the first model", "or size from which on it is")

# Identifiability: what the motion can show.
ABSORBED = Setting(0.995, "energy of an effect's columns",
    "share that the model's parameters absorb, above which the effect is not testable")
LEAST_RANGE = Setting(0.01, "rad (levers)", "motion of a joint, at least, to show anything")
LEAST_FASTEST = Setting(0.1, "rad/s (levers/s)",
    "largest speed of a joint, at least, to show any effect")
SMALL_RANGE = Setting(0.1, "rad (levers)",
    "motion of a slower joint, at least, to show its parameters")
LEAST_SPEED_RANGE = Setting(1.5, "slowest speed that counts",
    "largest speed of a joint, at least, to show any effect")

# Simulated motion, sentences and notes.
SIMULATION_LOST = Setting(1.0, "range of the joint",
    "tracking error from which on the simulation has not followed")
MOST_POINTS = Count(1500, "points", "points of a curve of a motion, at most", CONVENTION)
WORDS_OF_SUMMARY = Count(120, "words", "length of a summary, at most", CONVENTION)
LEAST_WEIGHT_OF_RIVAL = Setting(0.02, "of the set's probability",
    "weight from which on another effect is in the set of a cause", CONVENTION)
SHORT_RECORDING = Setting(10.0, "s", "length below which a note asks for more")
# fmt: on


def all_settings() -> dict[str, Setting | Count]:
    """Every setting by its name, in the order of this file."""
    return {name: value for name, value in globals().items() if isinstance(value, Setting | Count)}
