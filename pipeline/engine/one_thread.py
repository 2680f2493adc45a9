"""One thread for the libraries that would divide a sum or an image among several: results must not depend on the number of cores.

A worker is one of several processes, and gains nothing from threads of its own. Nothing is changed by importing the product: the
command sets its own process when it starts, Dask its workers, and a job asks for one thread while it runs.
"""

import os
from collections.abc import Iterator
from contextlib import contextmanager

_VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")


def one_thread_from_here() -> None:
    """For a process of our own and its children, before numerical libraries are loaded: they read these variables then."""
    os.environ.update(dict.fromkeys(_VARIABLES, "1"))


@contextmanager
def opencv_on_one_thread() -> Iterator[None]:
    """OpenCV works on one thread inside, and as before afterwards."""
    import cv2

    before = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        yield
    finally:
        cv2.setNumThreads(before)


@contextmanager
def linear_algebra_on_one_thread() -> Iterator[None]:
    """BLAS works on one thread inside, and as before afterwards: for jobs in a process of somebody else, a notebook's say."""
    import scipy.linalg  # noqa: F401  its own BLAS is to be found as well
    from threadpoolctl import threadpool_limits

    with threadpool_limits(limits=1):
        yield
