"""Memory that was freed goes back to the system."""

import ctypes


def return_freed_memory() -> None:
    """Give the pages back that the C library keeps of freed arrays; nothing where it is not glibc.

    glibc keeps what was freed for what comes next. Between stages of a diagnosis that is a tenth of
    the memory, in pieces that the arrays of the next stage do not fit into.
    """
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
    if trim is not None:
        trim(0)
