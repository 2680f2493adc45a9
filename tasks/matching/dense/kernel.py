"""How the kernels of dense matching are compiled: without counting references to arrays.

A view of an array (a row of sums, the plane of a node) adds one to the references of the array, and takes it back: at every window,
in a counter that all threads share, that takes as long as all the sums. A kernel that makes no array needs no counter.
"""

from typing import Any

from orthomill.kernels.kernel_compilation import njit

_OPTIONS: dict[str, Any] = {"error_model": "numpy", "_nrt": False}


def kernel(**options: Any) -> Any:
    """The decorator of a function that makes no array: what it needs it is given. options: of `numba.njit`."""
    return njit(**_OPTIONS, **options)
