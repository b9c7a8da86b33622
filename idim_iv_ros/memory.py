"""Memory that was freed goes back to the system."""

import ctypes


def return_freed_memory() -> None:
    """Give back the pages that glibc keeps of freed arrays, a tenth of a diagnosis' memory."""
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
    if trim is not None:
        trim(0)
