"""Files of a result: their names and formats, for whoever reads them without the rest."""

RESULT, GAP, REPORT = "result.json", "gap.json", "report.html"

IDENTIFICATION_FORMAT = "idim_iv_ros/identification/1"  # of result.json
GAP_FORMAT = "idim_iv_ros/gap/1"
