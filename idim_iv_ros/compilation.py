"""How numbers are computed: compiled loops, their cache, one thread, and freed memory."""

import ctypes
import hashlib
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from pathlib import Path
from types import ModuleType
from typing import Any

from numba import njit
from threadpoolctl import threadpool_limits

# Divisions in the kernels are guarded where they need to be: no check for zero in each. Arrays come
# from Python, and none is made here: without numba's runtime (`_nrt`) none is counted, which takes
# three quarters of the time of a simulation. What only compiled code calls needs no wrappers.
_OPTIONS: dict[str, Any] = {"error_model": "numpy", "_nrt": False, "no_cfunc_wrapper": True}
kernel = njit(**_OPTIONS | {"no_cpython_wrapper": True})
entry = njit(**_OPTIONS | {"cache": True, "nogil": True})


def source_digest(*modules: ModuleType) -> str:
    """Digest of the modules' source text, which becomes part of the key of numba's cache.

    That watches only the file of the function that Python calls (`entry`), and after an edit in
    another file would run stale machine code. Functions that these call are not cached (`kernel`).
    """
    digest = hashlib.sha256()
    for module in modules:
        digest.update(Path(str(module.__file__)).read_bytes())
    return digest.hexdigest()


def one_thread() -> AbstractContextManager[object]:
    """One thread for linear algebra: its matrices are small, and waiting for threads is not.

    The limit holds for libraries that are loaded: scipy's comes with `scipy.linalg`, imported here.
    """
    import scipy.linalg  # noqa: F401

    limits: AbstractContextManager[object] = threadpool_limits(limits=1, user_api="blas")
    return limits


def dispatcher(functions: Mapping[int, Callable[..., Any]], arguments: str) -> Callable[..., Any]:
    """Return a compiled ``f(kind, …)`` that calls the compiled function of a kind.

    `functions` are by kind, none but these; `arguments` their names, separated by commas. numba
    cannot call what it finds in a list at run time: the branches are written out.
    """
    *others, last = functions
    calls = [f"    if kind == {kind}:\n        return f{kind}({arguments})" for kind in others]
    lines = [f"def call(kind, {arguments}):", *calls, f"    return f{last}({arguments})"]
    names: dict[str, Any] = {f"f{kind}": function for kind, function in functions.items()}
    exec("\n".join(lines), names)
    compiled: Callable[..., Any] = kernel(names["call"])
    return compiled


def return_freed_memory() -> None:
    """Give back the pages that glibc keeps of freed arrays, a tenth of a diagnosis' memory."""
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
    if trim is not None:
        trim(0)
