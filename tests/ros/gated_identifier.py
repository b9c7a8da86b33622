"""The node `identifier` as it is, but for its worker: see `gated_worker`."""

import os
import sys
from pathlib import Path

from idim_iv_ros.nodes.identifier import job_queue
from idim_iv_ros.nodes.identifier.node import run

ROOT = Path(__file__).resolve().parents[2]

os.environ["PYTHONPATH"] = f"{ROOT}{os.pathsep}{os.environ.get('PYTHONPATH', '')}"
job_queue._START = "from tests.ros.gated_worker import main; main()"
sys.exit(run(sys.argv))
