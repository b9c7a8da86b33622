"""The words of the diagnosis report."""

from idim_iv_ros.report.markup import Html, section, tag

_WORDS = (
    (
        "Nominal model",
        "what the simulator holds now: inertials and friction of the URDF, drive inertia of the "
        "configuration",
    ),
    ("Refit", "the same equations with parameters identified from this recording (IDIM-IV)"),
    ("Extended model", "the refit with the accepted effects added and all parameters refitted"),
    (
        "Gap",
        "measured torque less that of a model at the measured motion; in closed loop, simulated "
        "less recorded motion",
    ),
    (
        "Noise floor",
        "what no model can explain: the spread between repeats of the same motion, or a lower "
        "bound from the unpredictable part of the residual where nothing was repeated",
    ),
    ("Parametric cause", "the equations are right and a number in the nominal model is wrong"),
    ("Structural cause", "physics is missing: no numbers in the refitted equations explain it"),
    (
        "Shrinkage",
        "share of the gap above the noise floor that goes when a cause is added, on data that "
        "was not used to find it",
    ),
    (
        "Held-out blocks",
        "blocks of time that were kept out of a fit and then predicted; an effect is accepted "
        "only if it helps on them",
    ),
    ("Lift", "share of the gap energy over share of the samples; 1 means evenly spread"),
    (
        "Cannot be told from",
        "another effect explains this recording as well; the truth may be either",
    ),
    (
        "Not testable",
        "the motion does not excite the effect, or the refit absorbs it: neither found nor "
        "excluded",
    ),
    ("Load", "torque of the rigid bodies alone: gravity, inertia, Coriolis"),
)


def gap_glossary_section() -> Html:
    """Return the glossary."""
    entries = [(tag("dt", word), tag("dd", meaning)) for word, meaning in _WORDS]
    return section("Glossary", "glossary", tag("dl", entries, css="glossary"))
