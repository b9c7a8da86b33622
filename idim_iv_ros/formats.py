"""Files of a result: their names and formats, for whoever reads them without the rest."""

from typing import Final

RESULT, GAP, REPORT = "result.json", "gap.json", "report.html"

# The first part of every format, and how HTML and MCAP files name what wrote them.
PROGRAM = "idim_iv_ros"

IDENTIFICATION_FORMAT: Final = "idim_iv_ros/identification/1"  # of result.json
GAP_FORMAT: Final = "idim_iv_ros/gap/1"
CHECK_FORMAT: Final = "idim_iv_ros/check/1"
IMPORT_FORMAT = f"{PROGRAM}/import/1"
INIT_FORMAT = f"{PROGRAM}/init/1"
SIMULATION_FORMAT = f"{PROGRAM}/simulation/1"
TRUTH_FORMAT = f"{PROGRAM}/truth/1"  # of BAG.truth.json
