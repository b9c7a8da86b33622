"""Values of an effect or of the extended model, as a table."""

from collections.abc import Mapping

from idim_iv_ros.diagnosis.result import EffectParameter
from idim_iv_ros.report.markup import Html, tag
from idim_iv_ros.report.numerals import measured_cells


def parameter_table(parameters: Mapping[str, EffectParameter]) -> Html:
    """Return a row for each parameter: name, value, interval and unit."""
    rows = [
        tag(
            "tr",
            tag("th", name, scope="row"),
            measured_cells(each.value, each.std),
            tag("td", each.unit, css="unit"),
        )
        for name, each in parameters.items()
    ]
    heads = (("Parameter", None), ("Value", "num"), ("± 95 %", None), ("Unit", None))
    head = tag("tr", [tag("th", text, scope="col", css=css) for text, css in heads])
    return tag("table", tag("thead", head), tag("tbody", rows))
