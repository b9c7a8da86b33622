"""The words of the field that the report uses."""

from idim_iv_ros.report.markup import Html, section, tag

_WORDS = (
    (
        "Base parameters",
        "the combinations of masses, moments, inertias and friction that the torque depends on; "
        "single ones among them cannot be told apart, the grouped expression says which were "
        "joined",
    ),
    (
        "Essential parameters",
        "the base parameters that this recording needs to explain the torque (backward "
        "elimination by F-test)",
    ),
    (
        "σ, %σ",
        "standard deviation of an estimate, and in percent of its absolute value; a parameter "
        "with a small %σ is well known",
    ),
    (
        "Refined",
        "estimated on rows that an autoregressive filter made white, so that the standard "
        "deviations count no sample twice",
    ),
    ("IDIM-LS", "least squares on the inverse dynamic model, with the measured motion"),
    (
        "IDIM-IV",
        "the same with instrumental variables, a simulated motion in place of the noisy one: "
        "free of the bias that noise in closed loop gives to least squares",
    ),
    (
        "Names",
        "XX … ZZ inertia, MX MY MZ first moments, M mass of a link about its joint frame; Ia "
        "drive inertia, Fv viscous and Fc Coulomb friction, off offset; Fvm, Fcm friction of a "
        "coupling. The number is the link, from 1",
    ),
)


def glossary_section() -> Html:
    """Return the glossary."""
    entries = [(tag("dt", word), tag("dd", meaning)) for word, meaning in _WORDS]
    return section("Glossary", "glossary", tag("dl", entries, css="glossary"))
