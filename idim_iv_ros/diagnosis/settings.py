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

# What is indistinguishable from an accepted effect: a model confidence set on held-out blocks.

# Structural effects: likelihood and search.
NOISE_MODEL_ORDER = Count(10, "", "order of each joint's autoregressive noise, at most", NUMERICAL)
NOISE_MODEL_STEPS = Count(3, "", "fits of the noise models from white noise", NUMERICAL)
NOISE_MODEL_MORE_STEPS = Count(2, "",
    "the same from the noise models of the model before", NUMERICAL)
LEAST_DENSITY = Setting(0.01, "mean spectral density",
    "noise that every frequency has at least: the model is wrong by a little everywhere", CHOSEN)
LEAST_INDEPENDENT = Setting(1e-4, "energy of a column",
    "what the model must leave of a candidate's column, at least", NUMERICAL)
LEAST_SHARE_OF_EFFECT = Setting(0.01, "energy of the residual",
    "what an effect must take of the whitened and of the plain residual at its joints, at least",
    CHOSEN)
LEAST_NONPARAMETRIC = Setting(0.01, "torque of the joint (rms)",
    "size from which on what is not in the catalogue counts for the verdict", CHOSEN)
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

# Held-out confirmation.
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

# Parametric causes.
PARAMETRIC_LEAST_TORQUE = Setting(0.005, "torque of the joint (rms)",
    "what a parametric cause must take at a joint in any case: of a small gap each is a large "
    "share", CHOSEN)
LEAST_PARAMETER_ERROR = Setting(0.02, "torque of the joint (rms)",
    "size from which on a parameter error matters at a joint", CHOSEN)
PARAMETER_ERROR_OVER_REFIT = Setting(1.5, "gap of the refit",
    "gap with all causes from which on a parameter error remains", CHOSEN)

# Whether one set of parameters holds for all recordings.

# What changed between two sets of recordings.
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
WORDS_OF_SUMMARY = Count(120, "words", "length of a summary, at most", CONVENTION)
LEAST_WEIGHT_OF_RIVAL = Setting(0.05, "of the set's probability",
    "weight from which on another effect is in the set of a cause", CONVENTION)
MOST_CAUSES_IN_SUMMARY = Count(4, "causes",
    "causes after the first in the summary, at most", CONVENTION)
MOST_NUMBERS_IN_SENTENCE = Count(3, "numbers",
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
