"""One thread of linear algebra for each worker: the workers share the cores.

Small matrices on several threads take several times the processor time of one. The variables count
when numpy is loaded, and go on to the commands and nodes that the tests start.
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")
