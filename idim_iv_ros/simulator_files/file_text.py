"""Files that are text around numbers: their templates."""

from jinja2 import Environment, PackageLoader, StrictUndefined

_TEMPLATES = Environment(
    loader=PackageLoader("idim_iv_ros.simulator_files"),
    undefined=StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
    keep_trailing_newline=True,
)


def file_text(template: str, **shown: object) -> str:
    """Return the text of a file from its template under ``templates/``."""
    return _TEMPLATES.get_template(f"{template}.j2").render(shown)
