"""One thread for linear algebra, wherever an answer is computed."""

from contextlib import AbstractContextManager

from threadpoolctl import threadpool_limits


def one_thread() -> AbstractContextManager[object]:
    """One thread for linear algebra: its matrices are small, and waiting for threads is not.

    Results then do not depend on the number of cores either. The limit holds for the libraries
    that are loaded: scipy's comes with `scipy.linalg`, which is therefore imported here.
    """
    import scipy.linalg  # noqa: F401

    limits: AbstractContextManager[object] = threadpool_limits(limits=1, user_api="blas")
    return limits
