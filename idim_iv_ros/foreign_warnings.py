"""Warnings of the libraries beneath, which are for developers and not for users."""

import os
import warnings


def silence_foreign_warnings() -> None:
    """Show no Python warning from here on, unless someone asked for it.

    What a user must know is a note of the result, or one line of ours. The filter stands behind
    all others: ``python -W``, ``PYTHONWARNINGS`` and a test's own filters hold, and with
    ``IDIM_IV_TRACEBACK`` everything is shown.
    """
    if not os.environ.get("IDIM_IV_TRACEBACK"):
        warnings.simplefilter("ignore", append=True)
